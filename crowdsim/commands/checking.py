"""The commands that check files and runs: ``validate``, ``schema``, ``verify``, ``status``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import Json, complete_either, detail, note, print_json, say
from crowdsim.commands.process import opened_run
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError


def validate(
    files: Annotated[
        list[str],
        typer.Argument(metavar="FILE", help="Scenarios and recipes, or their names.", autocompletion=complete_either),
    ],
    as_json: Json = False,
) -> None:
    """Check scenarios and recipes; print every finding with its line and column."""
    from crowdsim.preparation.validation import check_file, find_checked_file

    findings_by_file: dict[str, list[str]] = {}
    warnings: list[str] = []
    for name in files:
        try:
            path = find_checked_file(name)
        except CrowdsimError as error:
            findings_by_file[name] = [str(error)]
            continue
        detail(f"{name}: checking {path}")
        findings_by_file[str(path)], more = check_file(path)
        warnings += more
    found = any(findings_by_file.values())
    for findings in findings_by_file.values():
        for finding in findings:
            print(finding, file=sys.stderr)
    if as_json:
        checked = [
            {"file": path, "valid": not findings, "findings": findings} for path, findings in findings_by_file.items()
        ]
        print_json({"valid": not found, "files": checked})
    if found:
        sys.exit(2)
    for warning in warnings:
        note(warning)
    if not as_json:
        count = len(findings_by_file)
        say(f"{count} file{'s' if count > 1 else ''} checked, nothing is wrong")


class Kind(str, Enum):
    """What a schema is of."""

    SCENARIO = "scenario"
    RECIPE = "recipe"
    BATCH = "batch"


def schema(
    kind: Annotated[Kind, typer.Argument(metavar="[scenario|recipe|batch]", help="What it is of.")] = Kind.SCENARIO,
) -> None:
    """Print the JSON Schema of scenario, recipe or batch files, for editors."""
    from crowdsim.batch.description import batch_schema
    from crowdsim.scenario.scenario import scenario_schema
    from crowdsim.training.recipe import recipe_schema

    write = {Kind.SCENARIO: scenario_schema, Kind.RECIPE: recipe_schema, Kind.BATCH: batch_schema}[kind]
    print(write(), end="")


def verify(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder, or its archive.")], as_json: Json = False
) -> None:
    """Hold every file of a run against the checksums in its manifest."""
    from crowdsim.runs.manifest import read_manifest, verify

    with opened_run(folder) as unpacked:
        verdict = verify(unpacked, CORES)
        count = len(read_manifest(unpacked)["files"])
    for finding in verdict.findings:
        print(finding, file=sys.stderr)
    if as_json:
        print_json(
            {
                "folder": str(folder),
                "intact": not verdict.findings,
                "files": count,
                "findings": verdict.findings,
                "unfinished": verdict.unfinished,
                "foreign": verdict.foreign,
            }
        )
    if verdict.findings:
        sys.exit(1)
    for what, names in (
        ("a command was not finished", verdict.unfinished),
        ("not written by crowdsim", verdict.foreign),
    ):
        if names:
            some = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
            note(f"{folder}: {what}: {some}")
    if not as_json:
        say(f"{folder}: {count} files, all as they were written")


def status(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run, a folder of several, or a batch.")],
    as_json: Json = False,
) -> None:
    """List the runs in a folder: done, running or interrupted, how far they are, and which process is at work.

    Exit code 1 says that a run is damaged, or one of a batch has failed.
    """
    from crowdsim.batch.plan import is_batch
    from crowdsim.runs.status import describe_run

    if not folder.is_dir():
        raise CrowdsimError(f"{folder}: no such folder, expected runs")
    if is_batch(folder):
        if _print_batch(folder, as_json):
            sys.exit(1)
        return
    runs = {str(path): describe_run(path) for path in [folder, *sorted(folder.glob("[!.]*"))] if path.is_dir()}
    runs = {path: facts for path, facts in runs.items() if facts["state"] != "none"}
    if not runs:
        raise CrowdsimError(f"{folder}: holds no run")
    if as_json:
        print_json(runs)
    else:
        for path, facts in runs.items():
            print(f"{facts['state']:<12} {path}{_details(facts)}")
    if _has_failed(runs):
        sys.exit(1)


def _has_failed(runs: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether a run is damaged or has failed."""
    return any(facts["state"] in ("damaged", "failed") for facts in runs.values())


def _print_batch(folder: Path, as_json: bool) -> bool:
    """Print how far a batch is, and the runs that are at work or have failed; return whether there are failed ones."""
    from crowdsim.batch.results import describe_batch
    from crowdsim.commands.batching import time_text

    facts = describe_batch(folder)
    has_failed = _has_failed(facts["runs"])
    if as_json:
        print_json(facts)
        return has_failed
    counts = [f"{facts[state]:,} {state}" for state in ("done", "failed", "running", "interrupted", "waiting")]
    left = facts.get("seconds_left")
    owner = _details({"owner": facts["owner"]}) if "owner" in facts else ""
    print(f"{facts['state']:<12} {folder}  {', '.join(counts)} of {facts['total']:,} runs", end="")
    print(f"{', about ' + time_text(left) + ' left' if left else ''}{owner}")
    if facts.get("dashboard"):
        print(f"dashboard    {facts['dashboard']}")
    for path, run in facts["runs"].items():
        if run["state"] in ("running", "interrupted", "failed", "damaged"):
            what = f"  {run['message']}; {run['command']}" if run["state"] == "failed" else _details(run)
            task = f", {run['task']['stage']}" if "task" in run else ""
            print(f"{run['state']:<12} {path}{what}{task}")
    return has_failed


def _details(facts: dict[str, Any]) -> str:
    """Return how far a run is, in words."""
    parts = [facts["why"]] if "why" in facts else []
    if "avatars" in facts:
        parts.append(f"{facts['avatars']:,} avatars")
    if facts.get("control_frames") or "avatars" in facts:
        planned = facts.get("planned_frames", facts["control_frames"])
        of = "" if planned == facts["control_frames"] else f" of {planned:,}"
        parts.append(f"{facts['control_frames']:,}{of} control frames")
    for kind, counts in facts.get("outputs", {}).items():
        if counts["done"] < counts["planned"]:
            parts.append(f"{kind} {counts['done']:,} of {counts['planned']:,}")
    if "extension" in facts:
        longer = facts["extension"]
        parts.append(f"extension {longer['control_frames']:,} of {longer.get('planned_frames', 0):,}")
    if "owner" in facts:
        owner = facts["owner"]
        parts.append(f"process {owner['pid']} on {owner['host']} since {owner['since']} ({owner['command']})")
    return "  " + ", ".join(parts) if parts else ""

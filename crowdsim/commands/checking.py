"""The commands that check files and runs: ``validate``, ``schema``, ``verify``, ``status``."""

from __future__ import annotations

import sys
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from crowdsim.commands.common import Json, complete_either, detail, note, print_json, say
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
    from crowdsim.runs.validation import find_checked_file, find_file_faults, find_file_warnings

    findings_by_file: dict[str, list[str]] = {}
    for name in files:
        try:
            path = find_checked_file(name)
        except CrowdsimError as error:
            findings_by_file[name] = [str(error)]
            continue
        detail(f"{name}: checking {path}")
        findings_by_file[str(path)] = find_file_faults(path)
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
    warnings = [warning for path in findings_by_file for warning in find_file_warnings(Path(path))]
    for warning in warnings:
        note(warning)
    if not as_json:
        say(f"{len(findings_by_file)} file{'s' if len(findings_by_file) > 1 else ''} without a finding")


class Kind(str, Enum):
    """What a schema is of."""

    SCENARIO = "scenario"
    RECIPE = "recipe"


def schema(
    kind: Annotated[Kind, typer.Argument(metavar="[scenario|recipe]", help="What it is of.")] = Kind.SCENARIO,
) -> None:
    """Print the JSON Schema of scenario or recipe files, for editors."""
    from crowdsim.scenario.scenario import scenario_schema
    from crowdsim.training.recipe_reference import recipe_schema

    print(scenario_schema() if kind is Kind.SCENARIO else recipe_schema(), end="")


def verify(folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")], as_json: Json = False) -> None:
    """Hold every file of a run against the checksums in its manifest."""
    from crowdsim.runs.manifest import read_manifest, verify

    verdict = verify(folder, CORES)
    for finding in verdict.findings:
        print(finding, file=sys.stderr)
    count = len(read_manifest(folder)["files"])
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
        ("an export or a rendering was not finished", verdict.unfinished),
        ("not written by crowdsim", verdict.foreign),
    ):
        if names:
            some = ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")
            note(f"{folder}: {what}: {some}")
    if not as_json:
        say(f"{folder}: {count} files, all as they were written")


def status(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run folder, or a folder of several.")],
    as_json: Json = False,
) -> None:
    """List which runs in a folder are done, interrupted or unfinished."""
    from crowdsim.runs.folder import describe_run

    if not folder.is_dir():
        raise CrowdsimError(f"{folder}: no such folder, expected runs")
    runs = {str(path): describe_run(path) for path in [folder, *sorted(folder.iterdir())] if path.is_dir()}
    runs = {path: facts for path, facts in runs.items() if facts["state"] != "none"}
    if not runs:
        raise CrowdsimError(f"{folder}: holds no run")
    if as_json:
        print_json(runs)
        return
    for path, facts in runs.items():
        more = f"  {facts['why']}" if "why" in facts else ""
        if "avatars" in facts:
            more = f"  {facts['avatars']:,} avatars, {facts['control_frames']:,} control frames"
        print(f"{facts['state']:<12} {path}{more}")

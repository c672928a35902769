"""The commands that check files and runs: ``validate``, ``schema``, ``verify``, ``status``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from crowdsim.commands.common import CORES, Json, complete_either, detail, note, print_json, say
from crowdsim.errors import CrowdsimError


def validate(
    files: Annotated[
        list[str],
        typer.Argument(metavar="FILE", help="Scenarios and recipes, or their names.", autocompletion=complete_either),
    ],
    as_json: Json = False,
) -> None:
    """Check scenarios and recipes; print every finding with its line and column."""
    from crowdsim.validation import find_checked_file, find_file_faults

    told: dict[str, list[str]] = {}
    for name in files:
        try:
            path = find_checked_file(name)
        except CrowdsimError as error:
            told[name] = [str(error)]
            continue
        detail(f"{name}: checking {path}")
        told[str(path)] = find_file_faults(path)
    found = any(told.values())
    for findings in told.values():
        for finding in findings:
            print(finding, file=sys.stderr)
    if as_json:
        files_told = [{"file": path, "valid": not findings, "findings": findings} for path, findings in told.items()]
        print_json({"valid": not found, "files": files_told})
    if found:
        sys.exit(2)
    if not as_json:
        say(f"{len(told)} file{'s' if len(told) > 1 else ''} without a finding")


def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from crowdsim.crowd.scenario import scenario_schema

    print(scenario_schema(), end="")


def verify(folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")], as_json: Json = False) -> None:
    """Hold every file of a run against the checksums in its manifest."""
    from crowdsim.manifest import read_manifest, verify

    findings, more = verify(folder, CORES)
    for finding in findings:
        print(finding, file=sys.stderr)
    if more and not findings:
        some = ", ".join(more[:3]) + (", ..." if len(more) > 3 else "")
        note(f"{folder}: not written by the run: {some}")
    count = len(read_manifest(folder)["files"])
    if as_json:
        print_json(
            {"folder": str(folder), "intact": not findings, "files": count, "findings": findings, "unlisted": more}
        )
    if findings:
        sys.exit(1)
    if not as_json:
        say(f"{folder}: {count} files, all as they were written")


def status(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run folder, or a folder of several.")],
    as_json: Json = False,
) -> None:
    """Tell which runs in a folder are done, interrupted or unfinished."""
    from crowdsim.run_folder import describe_run

    if not folder.is_dir():
        raise CrowdsimError(f"{folder}: no such folder, expected runs")
    runs = {str(path): describe_run(path) for path in [folder, *sorted(folder.iterdir())] if path.is_dir()}
    runs = {path: told for path, told in runs.items() if told["state"] != "none"}
    if not runs:
        raise CrowdsimError(f"{folder}: holds no run")
    if as_json:
        print_json(runs)
        return
    for path, told in runs.items():
        more = f"  {told['why']}" if "why" in told else ""
        if "avatars" in told:
            more = f"  {told['avatars']:,} avatars, {told['control_frames']:,} control frames"
        print(f"{told['state']:<12} {path}{more}")

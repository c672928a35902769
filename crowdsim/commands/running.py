"""The command ``run``."""

from __future__ import annotations

import shlex
import sys
import traceback
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import (
    Device,
    Force,
    Json,
    Mocap,
    Search,
    Threads,
    complete_scenario,
    detail,
    print_json,
    size_text,
    talk,
)
from crowdsim.commands.progress import Bars
from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError


def run(
    scenarios: Annotated[
        list[str],
        typer.Argument(metavar="SCENARIO", help="Scenario files, or their names.", autocompletion=complete_scenario),
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Run folder; with several scenarios the folder they go into.")
    ] = None,
    threads: Threads = CORES,
    seed: Annotated[int | None, typer.Option(metavar="N", min=0, help="Another seed.")] = None,
    override: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value, groups[0].count=12 say.")
    ] = None,
    frames: Annotated[
        str | None, typer.Option(metavar="N", help="Another length in control frames, or in seconds as in 20s.")
    ] = None,
    extend: Annotated[
        str | None,
        typer.Option(metavar="N", help="Continue a finished run by so many control frames, or seconds as in 20s."),
    ] = None,
    fraction: Annotated[
        float | None, typer.Option(metavar="F", help="Share of every group's avatars, 0.01 say.")
    ] = None,
    search: Search = None,
    device: Device = "cpu",
    mocap: Mocap = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Run scenarios: simulate, and write take and outputs."""
    from crowdsim.jit.environment import load_numba
    from crowdsim.runs.folder import forget_extension
    from crowdsim.runs.run import Interrupted
    from crowdsim.runs.runner import run_to
    from crowdsim.scenario.frame_ranges import parse_length
    from crowdsim.scenario.scenario import load_scenario

    more = None if extend is None else parse_length(extend)
    if more is not None and (force or frames is not None):
        raise CrowdsimError("run --extend: goes on with a finished run, expected neither --force nor --frames")
    documents: list[dict[str, Any]] = []
    reported: list[Path] = []
    command = shlex.join(["crowdsim", *sys.argv[1:]])
    several, failures = len(scenarios) > 1, []
    for name in scenarios:
        try:
            scenario = load_scenario(name, override or (), seed, frames, fraction, search)
            load_numba()
            folder = Path("output") / scenario.name if out is None else out / scenario.name if several else out
            detail(f"{scenario.name}: {scenario.avatar_count:,} avatars, {threads} threads, into {folder}")
            with Bars() as bars:
                report = run_to(folder, scenario, threads, mocap, force, command, bars, bars.note, None, more, device)
            if as_json:
                documents.append(_describe_report(scenario.name, report))
            elif not talk.quiet:
                _print_report(report)
            reported.append(folder)
        except Interrupted as stop:
            print(stop, file=sys.stderr)
            sys.exit(128 + stop.number)
        except Exception as error:
            if not several:
                raise
            if talk.verbose or not isinstance(error, CrowdsimError):
                traceback.print_exc()
            print(error, file=sys.stderr)
            failures.append(name)
            documents.append({"scenario": name, "state": "failed", "error": str(error)})
    if as_json:
        print_json({"runs": documents})
    sys.stdout.flush()
    for folder in reported:
        forget_extension(folder)
    if failures:
        print(f"{len(failures)} of {len(scenarios)} runs failed: {', '.join(failures)}", file=sys.stderr)
        sys.exit(1)


def _print_report(report: Any) -> None:
    """Print what a run did, on one screen."""
    if report.done_before:
        print(f"{report.folder}: this run is done already; --force does it again")
        return
    from crowdsim.crowd.ending import outcome_text

    figures, seconds = report.statistics, report.seconds
    total = seconds["total"]
    fresh = figures.control_frames - report.continued_at
    print(report.folder)
    print(f"  avatars         {figures.avatars:,}")
    print(f"  control frames  {figures.control_frames:,} ({figures.seconds:.1f} s)")
    if report.outcome is not None:
        rate = figures.control_frames / figures.seconds
        print(f"  outcome         {outcome_text(report.outcome, rate)}")
    print(
        f"  strikes         {figures.strikes_thrown:,} thrown, {figures.strikes_landed:,} landed, "
        f"{figures.strikes_blocked:,} blocked, {figures.strikes_evaded:,} evaded"
    )
    if figures.knock_downs:
        print(f"  knock-downs     {figures.knock_downs:,}")
    print(f"  hits            {figures.hits_per_minute_per_avatar:.1f} per avatar per minute")
    print(f"  overlap         {figures.overlap_share:.2%} of avatar-frames")
    if fresh:
        control = seconds["control"]
        print(f"  control         {1000 * control / fresh:.3f} ms a frame, {control / total:.2%} of the time")
    if report.compiled:
        print(f"  compilation     {seconds['compile']:.1f} s, no part of control; kernels are kept for later runs")
    for kind, (path, count, size) in report.outputs.items():
        files = f"{count:,} file{'s' if count > 1 else ''}, " if kind != "take" else ""
        print(f"  {kind:<14}  {path} ({files}{size_text(size)})")
    stages = ", ".join(f"{stage} {value:.2f}" for stage, value in seconds.items() if stage != "total")
    print(f"  seconds         {total:.2f}: {stages}")


def _describe_report(name: str, report: Any) -> dict[str, Any]:
    """Return what a run did as plain data; of one that was done before as its manifest says."""
    from crowdsim.runs.manifest import read_manifest

    manifest = read_manifest(report.folder, ("avatars", "control_frames", "seed", "statistics", "seconds"))
    return {
        "scenario": name,
        "folder": str(report.folder),
        "state": "done before" if report.done_before else "done",
        "avatars": manifest["avatars"],
        "control_frames": manifest["control_frames"],
        "seed": manifest["seed"],
        "outcome": manifest.get("outcome"),
        "statistics": manifest["statistics"],
        "seconds": manifest["seconds"],
        "outputs": {
            kind: {"path": str(path), "files": count, "bytes": size}
            for kind, (path, count, size) in report.outputs.items()
        },
        "notes": report.notes,
    }

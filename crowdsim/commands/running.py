"""The commands ``run`` and ``export``."""

from __future__ import annotations

import shlex
import sys
import traceback
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim.commands.common import CORES, Force, Mocap, Search, Threads, size_text
from crowdsim.commands.progress import Bars
from crowdsim.errors import CrowdsimError


def run(
    scenarios: Annotated[list[str], typer.Argument(metavar="SCENARIO", help="Scenario files, or their names.")],
    out: Annotated[
        Path | None, typer.Option(help="Run folder; with several scenarios the folder they go into.")
    ] = None,
    threads: Threads = CORES,
    seed: Annotated[int | None, typer.Option(min=0, help="Another seed.")] = None,
    override: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value, groups[0].count=12 say.")
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Another length [control frames].")] = None,
    fraction: Annotated[float | None, typer.Option(help="Share of every group's avatars, 0.01 say.")] = None,
    search: Search = None,
    mocap: Mocap = None,
    force: Force = False,
) -> None:
    """Run scenarios: simulate, and write take and outputs."""
    from crowdsim.crowd.scenario import load_scenario
    from crowdsim.kernel_cache import load_numba
    from crowdsim.runner import Interrupted, run_to

    def tell(words: str) -> None:
        print(words, file=sys.stderr, flush=True)

    command = shlex.join(["crowdsim", *sys.argv[1:]])
    several, failures = len(scenarios) > 1, []
    for name in scenarios:
        try:
            scenario = load_scenario(name, override or (), seed, frames, fraction, search)
            load_numba()
            folder = Path("output") / scenario.name if out is None else out / scenario.name if several else out
            with Bars() as bars:
                report = run_to(folder, scenario, threads, mocap, force, command, bars, tell)
            _print_report(report)
        except Interrupted as stop:
            print(stop, file=sys.stderr)
            sys.exit(128 + stop.number)
        except Exception as error:
            if not several:
                raise
            if not isinstance(error, CrowdsimError):
                traceback.print_exc()
            print(error, file=sys.stderr)
            failures.append(name)
    if failures:
        print(f"{len(failures)} of {len(scenarios)} runs failed: {', '.join(failures)}", file=sys.stderr)
        sys.exit(1)


def _print_report(report: Any) -> None:
    """Print what a run did, on one screen."""
    for note in report.notes:
        print(note, file=sys.stderr)
    if report.done_before:
        print(f"{report.folder}: this run is done already; --force does it again")
        return
    told, seconds = report.statistics, report.seconds
    total = seconds["total"]
    frame = 1000 * seconds["control"] / told.control_frames
    print(report.folder)
    print(f"  avatars         {told.avatars:,}")
    print(f"  control frames  {told.control_frames:,} ({told.seconds:.1f} s)")
    print(f"  strikes         {told.strikes_thrown:,} thrown, {told.strikes_landed:,} landed")
    print(f"  hits            {told.hits_per_minute_per_avatar:.1f} a minute and avatar")
    print(f"  overlap         {told.overlap_share:.2%} of avatar-frames")
    print(f"  control         {frame:.3f} ms a frame, {seconds['control'] / total:.2%} of the time")
    for kind, (path, count, size) in report.outputs.items():
        files = f"{count:,} file{'s' if count > 1 else ''}, " if kind != "take" else ""
        print(f"  {kind:<14}  {path} ({files}{size_text(size)})")
    stages = ", ".join(f"{stage} {value:.2f}" for stage, value in seconds.items() if stage != "total")
    print(f"  seconds         {total:.2f}: {stages}")


def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    bvh: Annotated[bool, typer.Option("--bvh", help="Write BVH, one file an avatar.")] = False,
    ply: Annotated[bool, typer.Option("--ply", help="Write PLY point clouds, one file a frame.")] = False,
    pcd: Annotated[bool, typer.Option("--pcd", help="Write PCD point clouds, one file a frame.")] = False,
    avatars: Annotated[str | None, typer.Option(help="Numbers of avatars: 0-9 or 0,3,5-7; all by default.")] = None,
    frames: Annotated[str | None, typer.Option(help="Output frames A:B, half-open; all by default.")] = None,
    fps: Annotated[float, typer.Option(min=1.0, max=1000.0, help="Output frames a second.")] = 60.0,
    every: Annotated[int, typer.Option(min=1, help="Write every n-th output frame of point clouds.")] = 1,
    points: Annotated[int, typer.Option(min=1, max=100_000, help="Points an avatar.")] = 500,
    out: Annotated[Path | None, typer.Option(help="Folder that bvh/, ply/ and pcd/ go into; the run's.")] = None,
    threads: Threads = CORES,
) -> None:
    """Export a run's take as BVH or point clouds, without simulating again; in the run's folder it replaces them."""
    from crowdsim.outputs import ExportOptions, export_take
    from crowdsim.runner import open_run

    take, policies, notes = open_run(folder)
    for note in notes:
        print(note, file=sys.stderr)
    kinds = [kind for kind, wanted in (("bvh", bvh), ("ply", ply), ("pcd", pcd)) if wanted]
    options = ExportOptions(kinds, avatars, frames, fps, every, points)
    with Bars() as bars:
        written = export_take(folder, take, policies, options, out, threads, bars)
    for kind, files in written.items():
        size = sum(path.stat().st_size for path in files)
        print(f"{(out or folder) / kind}: {len(files):,} file{'s' if len(files) > 1 else ''}, {size_text(size)}")

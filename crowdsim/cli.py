"""The commands; the only place that prints, catches and exits."""

from __future__ import annotations

import json
import shlex
import signal
import sys
import traceback
from pathlib import Path
from typing import Annotated, Any

import typer

from crowdsim import __version__
from crowdsim.errors import CrowdsimError, OutputError

app = typer.Typer(
    name="crowdsim",
    help="Data-driven fight crowds: motion capture in, a trained crowd out.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]


def main() -> None:
    """Run the command line and leave with its exit code: 0 done, 1 failed, 2 invalid input, 130 or 143 interrupted."""
    signal.signal(signal.SIGTERM, _terminate)
    try:
        app(standalone_mode=True)
    except CrowdsimError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        # Whoever read standard output has gone; that is no failure of ours.
        sys.stderr.close()
        sys.exit(0)


def _terminate(number: int, frame: Any) -> None:
    print("terminated", file=sys.stderr)
    sys.exit(128 + number)


def _print_json(document: Any) -> None:
    print(json.dumps(document, indent=2, allow_nan=False))


class Bars:
    """Progress bars on standard error, one a stage: called with (stage, done, total)."""

    def __init__(self) -> None:
        self._stage = ""
        self._bar: Any = None

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Move the bar of a stage to ``done`` of ``total``."""
        from tqdm import tqdm

        if stage != self._stage:
            self.close()
            self._stage = stage
            self._bar = tqdm(total=total, desc=stage, file=sys.stderr, dynamic_ncols=True, mininterval=0.2)
        self._bar.total = total
        self._bar.update(done - self._bar.n)
        if done >= total:
            self.close()

    def close(self) -> None:
        """Finish the bar that is shown."""
        if self._bar is not None:
            self._bar.close()
            self._bar, self._stage = None, ""

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"crowdsim {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    pass


@app.command()
def perform(
    seconds: Annotated[float, typer.Option(min=2.0, max=86400.0, help="Length of all clips together [s].")] = 437.0,
    seed: Annotated[int, typer.Option(min=0, help="Another seed, another session.")] = 1,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the BVH files.")] = Path("output/performer"),
) -> None:
    """Write clips of the embedded boxer as BVH at 60 Hz."""
    from crowdsim.motion.performer import write_performance

    _make_folder(out)
    with Bars() as bars:
        paths = write_performance(out, seconds, seed, progress=bars)
    print(f"{len(paths)} clips in {out}")


@app.command()
def inspect(
    thing: Annotated[str, typer.Argument(help="A BVH file, a policy bundle or its name, or a run folder.")],
    as_json: Json = False,
    plots: Annotated[Path | None, typer.Option(help="Folder for pictures.")] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of a BVH file: m, cm, mm, inch, cmu or metres; found by default.")
    ] = None,
    up: Annotated[str | None, typer.Option(help="Up axis of a BVH file: y, z, -y ...; found by default.")] = None,
) -> None:
    """Tell what is in a BVH file, a trained policy or a run, and draw it."""
    path = Path(thing)
    if path.is_dir() and not (path / "policy.json").exists():
        _inspect_run(path, as_json, plots)
    elif path.is_file() and path.suffix not in (".yaml", ".yml"):
        _inspect_bvh(path, as_json, plots, unit, up)
    elif path.suffix.lower() == ".bvh":
        raise CrowdsimError(f"{path}: no such file")
    else:
        _inspect_bundle(thing, as_json, plots)


def _inspect_bundle(name: str, as_json: bool, plots: Path | None) -> None:
    from crowdsim import assets
    from crowdsim.policy.bundle import read_bundle, read_timings
    from crowdsim.policy.statistics import inspect_bundle

    folder = assets.find_bundle(name)
    policy = read_bundle(folder)
    told = inspect_bundle(policy, read_timings(folder))
    if plots is not None:
        from crowdsim.graph.plots import plot_graph
        from crowdsim.graph.settings import GraphSettings
        from crowdsim.policy.plots import plot_bundle

        _make_folder(plots)
        settings = GraphSettings.model_validate(policy.recipe["graph"])
        for picture in [*plot_graph(policy.database, policy.graph, settings, plots), *plot_bundle(policy, plots)]:
            print(picture, file=sys.stderr)
    if as_json:
        _print_json(told)
        return
    print(folder)
    _print_tree(told, 1)


def _inspect_run(folder: Path, as_json: bool, plots: Path | None) -> None:
    from crowdsim.manifest import NAME, read_manifest
    from crowdsim.runner import open_run
    from crowdsim.take.poses import PoseSampler
    from crowdsim.take.quality import measure_take

    take, policies, notes = open_run(folder)
    for note in notes:
        print(note, file=sys.stderr)
    sampler = PoseSampler(take, policies, _CORES)
    with Bars() as bars:
        told = measure_take(sampler, progress=bars)
    seconds = read_manifest(folder)["seconds"] if (folder / NAME).exists() else {}
    told["control_seconds"], told["wall_seconds"] = seconds.get("control"), seconds.get("total")
    if plots is not None:
        from crowdsim.take.plots import plot_take

        _make_folder(plots)
        for picture in plot_take(sampler, plots):
            print(picture, file=sys.stderr)
    if as_json:
        _print_json(told)
        return
    print(folder)
    _print_tree(told, 1)


def _print_tree(told: Any, depth: int) -> None:
    """Print plain data as indented lines, numbers to four digits."""
    for key, value in told.items():
        if isinstance(value, dict):
            print("  " * depth + f"{key}:")
            _print_tree(value, depth + 1)
        else:
            print("  " * depth + f"{key}: {f'{value:.4g}' if isinstance(value, float) else value}")


def _inspect_bvh(path: Path, as_json: bool, plots: Path | None, unit: str | None, up: str | None) -> None:
    from crowdsim.motion.capture import load_capture
    from crowdsim.motion.report import describe_capture, study_capture

    capture = load_capture(path, unit, up)
    study = study_capture(capture)
    told = describe_capture(capture, study)
    if plots is not None:
        from crowdsim.motion.plots import plot_capture

        _make_folder(plots)
        for picture in plot_capture(capture, study, plots):
            print(picture, file=sys.stderr)
    if as_json:
        _print_json(told)
        return
    _print_capture(path, told)


def _print_capture(path: Path, told: dict[str, Any]) -> None:
    scale, height = told["unit_scale"], told["height_m"]
    print(f"{path}")
    print(f"  {told['joints']} joints, {told['end_sites']} end sites, {told['channels']} channels")
    print(f"  {told['frames']} frames at {told['fps']:g} a second, {told['seconds']:.2f} s")
    print(f"  unit {f'{scale:g} m' if scale else 'unknown'}, up axis {told['up_axis'] or 'unknown'}", end="")
    print(f", body {height:.2f} m tall" if height else "")
    for role, joint in told["roles"].items():
        print(f"    {role:15} {joint}")
    if told["contacts"] is not None:
        shares = " and ".join(f"{share:.0%}" for share in told["contact_share"])
        print(f"  lead-in of {told['lead_in_frames']} frames cut off; floor at {told['floor_m']:+.3f} m")
        print(f"  {told['contacts']} foot contacts, left and right foot planted {shares} of the time")
        print(f"  {told['strikes']} strikes, highest fist speed {told['highest_fist_speed']:.1f} m/s")
        for strike in told["strike_list"]:
            place = ", ".join(f"{value:+.2f}" for value in strike["place"])
            print(f"    {strike['seconds']:8.2f} s  {strike['hand']:5}  {strike['speed']:5.1f} m/s  at ({place})")
    for finding in told["findings"]:
        print(f"{path}: {finding}", file=sys.stderr)


def _count_cores() -> int:
    import os

    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_CORES = _count_cores()

Threads = Annotated[int, typer.Option("--threads", min=1, max=1024, help="Threads; results never depend on them.")]
Force = Annotated[bool, typer.Option("--force", help="Do it again although it is done.")]
Mocap = Annotated[
    Path | None,
    typer.Option(help="Folder of motion capture, for recipes that train from it.", envvar="CROWDSIM_MOCAP"),
]


@app.command()
def train(
    recipe: Annotated[str, typer.Argument(help="A recipe's file, or its name.")],
    mocap: Mocap = None,
    threads: Threads = _CORES,
    force: Force = False,
) -> None:
    """Train a policy from motion capture or from the embedded boxer."""
    from crowdsim.policy.train import train_recipe

    with Bars() as bars:
        folder, trained = train_recipe(recipe, mocap, threads, force, bars)
    print(f"{folder}: {'trained' if trained else 'up to date'}")


@app.command()
def run(
    scenarios: Annotated[list[str], typer.Argument(metavar="SCENARIO ...", help="Scenario files, or their names.")],
    out: Annotated[
        Path | None, typer.Option(help="Run folder; with several scenarios the folder they go into.")
    ] = None,
    threads: Threads = _CORES,
    seed: Annotated[int | None, typer.Option(min=0, help="Another seed.")] = None,
    override: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value, groups[0].count=12 say.")
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Another length [control frames].")] = None,
    fraction: Annotated[float | None, typer.Option(help="Share of every group's avatars, 0.01 say.")] = None,
    mocap: Mocap = None,
    force: Force = False,
) -> None:
    """Run scenarios: simulate, and write take and outputs."""
    from crowdsim.crowd.scenario import load_scenario
    from crowdsim.runner import Interrupted, run_to

    command = shlex.join(["crowdsim", *sys.argv[1:]])
    several, failures = len(scenarios) > 1, []
    for name in scenarios:
        try:
            scenario = load_scenario(name, override or (), seed, frames, fraction)
            folder = Path("output") / scenario.name if out is None else out / scenario.name if several else out
            with Bars() as bars:
                report = run_to(folder, scenario, threads, mocap, force, command, bars)
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
        print(f"  {kind:<14}  {path} ({files}{_size(size)})")
    stages = ", ".join(f"{stage} {value:.2f}" for stage, value in seconds.items() if stage != "total")
    print(f"  seconds         {total:.2f}: {stages}")


def _size(count: float) -> str:
    for unit in ("bytes", "kB", "MB"):
        if count < 1000:
            return f"{count:.0f} {unit}" if unit == "bytes" else f"{count:.1f} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


@app.command()
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
    threads: Threads = _CORES,
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
        print(f"{(out or folder) / kind}: {len(files):,} file{'s' if len(files) > 1 else ''}, {_size(size)}")


@app.command()
def render(
    things: Annotated[list[Path], typer.Argument(metavar="RUN|FILE.bvh ...", help="Run folders and BVH files.")],
    out: Annotated[Path | None, typer.Option(help="Folder of the pictures; with several things their parent.")] = None,
    size: Annotated[str, typer.Option(help="Width and height, 1280x720 say.")] = "1280x720",
    fps: Annotated[
        float | None, typer.Option(min=1.0, max=1000.0, help="Pictures a second; 30, or a BVH file's own rate.")
    ] = None,
    frames: Annotated[str | None, typer.Option(help="Output frames A:B, half-open; all by default.")] = None,
    camera: Annotated[
        str | None, typer.Option(help="auto, orbit, top, side, follow:AVATAR; front+side for BVH files.")
    ] = None,
    png: Annotated[bool, typer.Option("--png", help="Write numbered PNG.")] = False,
    mp4: Annotated[bool, typer.Option("--mp4", help="Write video.mp4; so it is when nothing else is named.")] = False,
    contact_sheet: Annotated[int, typer.Option(min=0, max=400, help="Write one PNG of N moments.")] = 0,
    caption: Annotated[bool, typer.Option(help="A small caption in the picture.")] = True,
    threads: Threads = _CORES,
    jobs: Annotated[int, typer.Option(min=1, max=256, help="Processes that draw.")] = 1,
) -> None:
    """Render runs and BVH files to PNG, MP4 and contact sheets."""
    from crowdsim.render.command import RenderOptions, parse_frames, parse_size, render_many
    from crowdsim.render.take_source import TakeSource
    from crowdsim.runner import open_run

    options = RenderOptions(
        size=parse_size(size),
        fps=fps,
        frames=None if frames is None else parse_frames(frames),
        camera=camera,
        mp4=mp4 or not (png or contact_sheet),
        png=png,
        contact_sheet=contact_sheet,
        caption=caption,
        threads=threads,
        jobs=jobs,
    )

    def open_source(path: Path, wanted: RenderOptions) -> tuple[TakeSource, tuple[str, ...]]:
        take, policies, notes = open_run(path)
        return TakeSource(take, policies, wanted.fps or 30.0, threads=threads), tuple(notes)

    if out is not None and len(things) == 1:
        outs = [out]
    else:
        outs = [
            out / thing.stem if out is not None else thing.with_suffix("") if thing.suffix.lower() == ".bvh" else thing
            for thing in things
        ]
    with Bars() as bars:
        outcomes = render_many(things, outs, options, open_source, bars)
    failed = [outcome for outcome in outcomes if outcome.error is not None]
    for outcome in outcomes:
        for note in outcome.notes:
            print(f"{outcome.path}: {note}", file=sys.stderr)
        if outcome.rendered is not None:
            for path in outcome.rendered.files[:4]:
                print(path)
        else:
            print(outcome.error, file=sys.stderr)
    if failed:
        error = failed[0].error
        sys.exit(1 if len(things) > 1 or error is None else error.exit_code)


@app.command()
def profile(
    scenario: Annotated[str, typer.Argument(metavar="SCENARIO", help="A scenario file, or its name.")],
    avatars: Annotated[
        str | None, typer.Option(help="Numbers of avatars, 30,1000,10k say; the scenario's own.")
    ] = None,
    threads: Annotated[str, typer.Option(help="Numbers of threads, 1,2 say.")] = "1",
    frames: Annotated[
        int | None, typer.Option(min=1, help="Control frames to measure; the scenario's duration.")
    ] = None,
    as_json: Json = False,
    out: Annotated[Path | None, typer.Option(help="Folder for profile.csv, profile.png and scaling.png.")] = None,
    trace: Annotated[bool, typer.Option("--trace", help="Write trace.json for Perfetto, too; needs --out.")] = False,
    writing: Annotated[bool, typer.Option("--writing", help="Tell what writing the outputs costs, too.")] = False,
    override: Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Another value.")] = None,
    mocap: Mocap = None,
) -> None:
    """Tell what control costs a frame, by stage, for any number of avatars and threads."""
    from crowdsim import profiling
    from crowdsim.crowd.profile import draw_profile, draw_scaling, profile_table, write_csv
    from crowdsim.crowd.scenario import load_scenario
    from crowdsim.runner import load_policies

    counts = profiling.parse_counts(avatars, "--avatars") if avatars is not None else []
    numbers = profiling.parse_counts(threads, "--threads")
    if trace and out is None:
        raise CrowdsimError("--trace needs a folder to write into, expected --out DIR")
    loaded = load_scenario(scenario, override or ())
    with Bars() as bars:
        policies = load_policies(loaded, mocap, max(numbers), bars)
        profiles = profiling.profile_scenario(loaded, policies, counts, numbers, frames, bars)
    seconds = profiling.time_writing(loaded, policies, max(numbers), frames) if writing else None
    if out is not None:
        _make_folder(out)
        first = profiles[0]
        write_csv(out / "profile.csv", first.timings, first.avatars)
        draw_profile(out / "profile.png", first.timings, first.avatars)
        draw_scaling(out / "scaling.png", profiles)
        if trace:
            profiling.write_trace(out / "trace.json", first)
    if as_json:
        told: dict[str, Any] = {"scenario": loaded.name, "profiles": [profiling.describe(one) for one in profiles]}
        _print_json(told if seconds is None else {**told, "writing_seconds": seconds})
        return
    print("\n\n".join(profile_table(one) for one in profiles))
    if seconds is not None:
        print("\na whole run: " + ", ".join(f"{stage} {value:.2f} s" for stage, value in seconds.items()))


@app.command()
def validate(files: Annotated[list[Path], typer.Argument(metavar="FILE ...", help="Scenarios and recipes.")]) -> None:
    """Check scenarios and recipes; print every finding with its line and column."""
    from crowdsim.validation import find_file_faults

    findings = [finding for path in files for finding in find_file_faults(path)]
    for finding in findings:
        print(finding, file=sys.stderr)
    if findings:
        sys.exit(2)
    print(f"{len(files)} file{'s' if len(files) > 1 else ''} without a finding")


@app.command()
def schema() -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from crowdsim.crowd.scenario import scenario_schema

    print(scenario_schema(), end="")


@app.command()
def verify(folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")]) -> None:
    """Hold every file of a run against the checksums in its manifest."""
    from crowdsim.manifest import read_manifest, verify

    findings, more = verify(folder, _CORES)
    for finding in findings:
        print(finding, file=sys.stderr)
    if findings:
        sys.exit(1)
    if more:
        some = ", ".join(more[:3]) + (", ..." if len(more) > 3 else "")
        print(f"{folder}: not written by the run: {some}", file=sys.stderr)
    print(f"{folder}: {len(read_manifest(folder)['files'])} files, all as they were written")


@app.command()
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
        _print_json(runs)
        return
    for path, told in runs.items():
        more = f"  {told['why']}" if "why" in told else ""
        if "avatars" in told:
            more = f"  {told['avatars']:,} avatars, {told['control_frames']:,} control frames"
        print(f"{told['state']:<12} {path}{more}")


def _make_folder(folder: Path) -> None:
    """Make a folder for outputs.

    Raises:
        OutputError: It cannot be made or is a file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file, expected a folder to write into") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}") from None


if __name__ == "__main__":
    main()

"""What a scenario wants written of a take, handed to the exporters and the renderer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.core.types import Progress
from crowdsim.errors import CrowdsimError, under_way
from crowdsim.files import make_folder
from crowdsim.runs.journal import series_name
from crowdsim.scenario.frame_ranges import output_frames, parse_frames

if TYPE_CHECKING:
    from crowdsim.export.stream import Sink
    from crowdsim.policy.policy import Policy
    from crowdsim.runs.run import Run
    from crowdsim.scenario.scenario import Scenario
    from crowdsim.take.poses import PoseSampler
    from crowdsim.take.take import Take


def expect_outputs(scenario: Scenario) -> None:
    """Begin what outputs of a scenario need later and what can go on beside the simulation."""
    if scenario.outputs.pcd is not None:
        from crowdsim.export.cloud_files import begin_probe

        begin_probe()


def plan_outputs(scenario: Scenario, avatars: Sequence[str], control_frames: int, control_rate: float) -> list[str]:
    """Return the names of all files that the outputs of a scenario may have in the run folder, as a journal notes them.

    Args:
        scenario: The scenario, resolved.
        avatars: Name of each avatar.
        control_frames: Control frames of the run.
        control_rate: Control frames a second.
    """
    wanted, names = scenario.outputs, []
    if wanted.bvh is not None:
        from crowdsim.export.bvh import bvh_name

        numbers = range(len(avatars)) if wanted.bvh.avatars is None else wanted.bvh.avatars
        names += [f"bvh/{bvh_name(avatars[number])}" for number in numbers]
    for kind in ("ply", "pcd"):
        cloud = getattr(wanted, kind)
        if cloud is not None:
            fps = cloud.fps or scenario.fps
            count = output_frames(control_frames, control_rate, fps)
            start, stop = _limited(cloud.frames_at(fps), count) or (0, count)
            names.append(series_name(kind, range(start, stop, cloud.every), kind))
    if wanted.render is not None:
        from crowdsim.render.batch import picture_files

        count = output_frames(control_frames, control_rate, wanted.render.fps)
        frames = _limited(wanted.render.frames_at(wanted.render.fps), count) or (0, count)
        sheet = wanted.render.contact_sheet or 0
        names += [path.as_posix() for path in picture_files(Path(), frames, wanted.render.mp4, False, sheet)]
        if wanted.render.png:
            names.append(series_name("frames", range(*frames), "png"))
    if wanted.profile is not None:
        names += ["profile.csv"] * wanted.profile.csv + ["profile.png"] * wanted.profile.plots
    return names


def write_outputs(run: Run, take: Take, policies: Sequence[Policy]) -> dict[str, list[Path]]:
    """Write the outputs that a run's scenario asks for from its take; return the files of each kind.

    Outputs at one rate share their poses.

    Raises:
        OutputError: A file cannot be written.
        Interrupted: A signal has come.
    """
    from crowdsim.export.stream import stream_poses
    from crowdsim.take.poses import PoseSampler

    found: dict[str, list[Path]] = {}
    scenario, threads, progress = run.scenario, run.threads, run.advance_outputs
    wanted = scenario.outputs
    if wanted.bvh is not None or wanted.ply is not None or wanted.pcd is not None:
        sampler = PoseSampler(take, policies, threads)
        rates: dict[float, list[Sink]] = {}
        for fps, sink in _sinks(sampler, run.folder, scenario):
            rates.setdefault(fps, []).append(sink)
        for fps, sinks in rates.items():
            files = stream_poses(sampler, fps, sinks, threads, progress)
            found.update({sink.kind: written for sink, written in zip(sinks, files, strict=True)})
        run.clock.lap("export")
    if wanted.render is not None:
        from crowdsim.crowd.cast import pack_arena
        from crowdsim.render.batch import render
        from crowdsim.render.command import scenario_options
        from crowdsim.render.take_source import TakeSource

        arena = pack_arena(scenario.arena)
        source = TakeSource(take, policies, wanted.render.fps, threads=threads, arena=arena)
        options = scenario_options(wanted.render, threads)
        shown = take.output_frames(wanted.render.fps)
        options = replace(options, frames=_limited(wanted.render.frames_at(wanted.render.fps), shown))
        rendered = render(source, run.folder, options, progress, _note)
        found["pictures"] = list(rendered.files)
        run.clock.lap("render")
    return found


@contextmanager
def _note(folder: Path, planned: Sequence[Path]) -> Iterator[Callable[[Sequence[Path]], None]]:
    """Note pictures of a run that is going on in its journal."""
    from crowdsim.runs.recorder import note_files

    note_files(folder, [path.relative_to(folder).as_posix() for path in planned])
    yield lambda files: None


def _sinks(sampler: PoseSampler, folder: Path, scenario: Scenario) -> list[tuple[float, Sink]]:
    """Return writers of the motion that a scenario asks for, each with its rate, and make their folders."""
    from crowdsim.export.bvh import BvhSink

    take, wanted = sampler.take, scenario.outputs
    sinks: list[tuple[float, Any]] = []
    if wanted.bvh is not None:
        fps = wanted.bvh.fps or scenario.fps
        frames = _limited(wanted.bvh.frames_at(fps), take.output_frames(fps))
        make_folder(folder / "bvh")
        sinks.append((fps, BvhSink(sampler, folder / "bvh", fps, frames, wanted.bvh.avatars)))
    for kind in ("ply", "pcd"):
        cloud = getattr(wanted, kind)
        if cloud is None:
            continue
        from crowdsim.export.pointcloud import CloudSink

        fps = cloud.fps or scenario.fps
        frames = _limited(cloud.frames_at(fps), take.output_frames(fps))
        make_folder(folder / kind)
        sink = CloudSink(sampler, folder / kind, kind, fps, cloud.points, frames, cloud.every, cloud.avatars)
        sinks.append((fps, sink))
    return sinks


@dataclass(frozen=True)
class ExportOptions:
    """What to export of a run, in a user's words.

    Attributes:
        kinds: ``bvh``, ``ply``, ``pcd``.
        avatars: Their numbers, ``0-9`` or ``0,3,5-7``; all when None.
        frames: Output frames ``A:B``, in frames or seconds; all when None.
        fps: Output frames a second.
        every: Write every n-th output frame of point clouds.
        points: Points an avatar.
    """

    kinds: Sequence[str]
    avatars: str | None = None
    frames: str | None = None
    fps: float = 60.0
    every: int = 1
    points: int = 500


def export_take(
    folder: Path,
    take: Take,
    policies: Sequence[Policy],
    options: ExportOptions,
    out: Path | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> dict[str, list[Path]]:
    """Export a run's take again; return the files of each kind.

    In the run's own folder, exports take the place of those of their kind, and the manifest says so.

    Args:
        folder: The run folder.
        take: Its take.
        policies: Its policies.
        options: What to export.
        out: Another folder for ``bvh/``, ``ply/`` and ``pcd/``.
        threads: Threads.
        progress: Called with stage, done and total.

    Raises:
        TakeError: Avatars or frames are asked for that the take does not have, or the manifest is damaged.
        OutputError: A folder cannot be made, or holds other files of these names beside a run's.
        RunError: A file cannot be written.
    """
    from crowdsim.export.bvh import bvh_name
    from crowdsim.export.select import parse_avatars
    from crowdsim.export.stream import stream_poses
    from crowdsim.runs.recorder import record_files
    from crowdsim.take.poses import PoseSampler

    if not options.kinds:
        raise CrowdsimError("nothing to export, expected --bvh, --ply or --pcd")
    fps = options.fps
    avatars = parse_avatars(options.avatars, take.avatar_count)
    frames = None
    if options.frames is not None:
        frames = parse_frames(options.frames).resolve(take.output_frames(fps), fps, take.frame_limit(fps))
    start, stop = frames or (0, take.output_frames(fps))
    target = out or folder
    planned: list[Path] = []
    for kind in options.kinds:
        if kind == "bvh":
            numbers = range(take.avatar_count) if avatars is None else avatars
            planned += [target / kind / bvh_name(take.cast.names[number]) for number in numbers]
        else:
            planned.append(target / series_name(kind, range(start, stop, options.every), kind))
    with record_files(target, planned) as recorder:
        sampler = PoseSampler(take, policies, threads)
        sinks = [_sink(kind, sampler, target, options, frames, avatars) for kind in options.kinds]
        with under_way():
            written = stream_poses(sampler, fps, sinks, threads, progress)
            found = dict(zip(options.kinds, written, strict=True))
            for kind, files in found.items():
                recorder.settle(kind, files, asdict(options), True, threads)
    return found


def _sink(
    kind: str,
    sampler: PoseSampler,
    target: Path,
    options: ExportOptions,
    frames: tuple[int, int] | None,
    avatars: Sequence[int] | None,
) -> Sink:
    """Return the writer of one kind of export, whose folder is made."""
    make_folder(target / kind)
    if kind == "bvh":
        from crowdsim.export.bvh import BvhSink

        return BvhSink(sampler, target / kind, options.fps, frames, avatars)
    from crowdsim.export.pointcloud import CloudSink

    return CloudSink(sampler, target / kind, kind, options.fps, options.points, frames, options.every, avatars)


def _limited(frames: Sequence[int] | None, count: int) -> tuple[int, int] | None:
    """Return a checked range of a scenario's output frames, cut to the ``count`` that there are."""
    return None if frames is None else (frames[0], min(frames[1], count))

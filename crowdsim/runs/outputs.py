"""What a scenario wants written of a take, handed to the exporters and the renderer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.files import make_folder
from crowdsim.runs.journal import series_name
from crowdsim.scenario.frame_ranges import output_frames

if TYPE_CHECKING:
    from crowdsim.export.stream import Sink
    from crowdsim.policy.policy import Policy
    from crowdsim.runs.run import Run
    from crowdsim.scenario.scenario import Scenario
    from crowdsim.take.data import TakeData
    from crowdsim.take.poses import PoseSampler
    from crowdsim.take.take import Take


def expect_outputs(scenario: Scenario) -> None:
    """Begin what outputs of a scenario need later and what can go on beside the simulation.

    Raises:
        OutputError: A video is wanted, and there is no ffmpeg.
    """
    if scenario.outputs.render is not None and scenario.outputs.render.mp4:
        from crowdsim.render.video import ffmpeg

        ffmpeg()
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

    Outputs at one rate share their poses. Files that are there already are whole, and are not written again.

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
        for fps, sink in _sinks(sampler, run.folder, scenario, found):
            rates.setdefault(fps, []).append(sink)
        for fps, sinks in rates.items():
            files = stream_poses(sampler, fps, sinks, threads, progress)
            for sink, written in zip(sinks, files, strict=True):
                found[sink.kind] = in_order(take, [*found[sink.kind], *written])
        run.clock.lap("export")
    if wanted.render is not None:
        found["pictures"] = _render(run, take, policies)
        run.clock.lap("render")
    return found


def _render(run: Run, take: Take, policies: Sequence[Policy]) -> list[Path]:
    """Write the pictures that a run's scenario asks for; return their files."""
    from crowdsim.crowd.cast import pack_arena
    from crowdsim.render.batch import picture_files, render
    from crowdsim.render.command import scenario_options
    from crowdsim.render.take_source import TakeSource

    wanted, folder = run.scenario.outputs.render, run.folder
    assert wanted is not None
    count = take.output_frames(wanted.fps)
    frames = _limited(wanted.frames_at(wanted.fps), count)
    if frames is not None and frames[0] == frames[1]:
        return []
    options = replace(scenario_options(wanted, run.threads), frames=frames)
    files = picture_files(folder, frames or (0, count), wanted.mp4, wanted.png, wanted.contact_sheet or 0)
    is_there = {name: (folder / name).exists() for name in ("video.mp4", "contact_sheet.png")}
    if all(path.exists() for path in files):
        return files
    options = replace(
        options,
        mp4=options.mp4 and not is_there["video.mp4"],
        contact_sheet=0 if is_there["contact_sheet.png"] else options.contact_sheet,
    )
    source = TakeSource(take, policies, wanted.fps, threads=run.threads, arena=pack_arena(run.scenario.arena))
    render(source, folder, options, run.advance_outputs, _note)
    return files


@contextmanager
def _note(folder: Path, planned: Sequence[Path]) -> Iterator[Callable[[Sequence[Path]], None]]:
    """Note pictures of a run that is going on in its journal."""
    from crowdsim.runs.recorder import note_files

    note_files(folder, [path.relative_to(folder).as_posix() for path in planned], of_run=True)
    yield lambda files: None


def _sinks(
    sampler: PoseSampler, folder: Path, scenario: Scenario, found: dict[str, list[Path]]
) -> list[tuple[float, Sink]]:
    """Return writers of the motion that a scenario asks for, each with its rate, and make their folders.

    Files that are there already go to ``found``, and what writes them is left out.
    """
    from crowdsim.export.bvh import BvhSink

    take, wanted = sampler.take, scenario.outputs
    sinks: list[tuple[float, Any]] = []
    if wanted.bvh is not None:
        fps = wanted.bvh.fps or scenario.fps
        frames = _limited(wanted.bvh.frames_at(fps), take.output_frames(fps))
        make_folder(folder / "bvh")
        chosen = range(take.avatar_count) if wanted.bvh.avatars is None else wanted.bvh.avatars
        found["bvh"], missing = divide_avatars(folder / "bvh", take, chosen)
        if missing and (frames is None or frames[0] < frames[1]):
            sinks.append((fps, BvhSink(sampler, folder / "bvh", fps, frames, missing)))
    for kind in ("ply", "pcd"):
        cloud = getattr(wanted, kind)
        if cloud is None:
            continue
        from crowdsim.export.pointcloud import CloudSink

        fps = cloud.fps or scenario.fps
        start, stop = _limited(cloud.frames_at(fps), take.output_frames(fps)) or (0, take.output_frames(fps))
        make_folder(folder / kind)
        found[kind], start = divide_frames(folder / kind, kind, range(start, stop, cloud.every))
        if start < stop:
            frames = (start, stop)
            sink = CloudSink(sampler, folder / kind, kind, fps, cloud.points, frames, cloud.every, cloud.avatars)
            sinks.append((fps, sink))
    return sinks


def divide_avatars(folder: Path, take: TakeData, chosen: Sequence[int]) -> tuple[list[Path], list[int]]:
    """Return the BVH files of some avatars that are there, and the numbers of the other avatars."""
    from crowdsim.export.bvh import bvh_name

    paths = {number: folder / bvh_name(take.cast.names[number]) for number in chosen}
    there = [path for path in paths.values() if path.exists()]
    return there, [number for number, path in paths.items() if path not in there]


def divide_frames(folder: Path, kind: str, frames: range) -> tuple[list[Path], int]:
    """Return the clouds of some frames that are there, up to the first one that is not, and that frame."""
    there: list[Path] = []
    for frame in frames:
        path = folder / f"{frame:06d}.{kind}"
        if not path.exists():
            return there, frame
        there.append(path)
    return there, frames.stop


def in_order(take: TakeData, files: Sequence[Path]) -> list[Path]:
    """Return files, each once, by avatar or by frame."""
    numbers = {str(name): number for number, name in enumerate(take.cast.names)}
    return sorted(set(files), key=lambda path: numbers[path.stem] if path.suffix == ".bvh" else int(path.stem))


def _limited(frames: Sequence[int] | None, count: int) -> tuple[int, int] | None:
    """Return a checked range of a scenario's output frames, cut to the ``count`` that there are.

    It is empty where the run has ended before.
    """
    return None if frames is None else (min(frames[0], count), min(frames[1], count))

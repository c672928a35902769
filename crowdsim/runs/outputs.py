"""What is wanted of a take, by a scenario or by a command, handed to the exporters and the renderer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from crowdsim.core.types import Progress
from crowdsim.files import exists_plain, make_inside
from crowdsim.runs.stage import Plan
from crowdsim.scenario.frame_ranges import output_frames

if TYPE_CHECKING:
    from crowdsim.crowd.record import TakeData
    from crowdsim.export.stream import Sink
    from crowdsim.policy.policy import Policy
    from crowdsim.poses.sampler import PoseSampler
    from crowdsim.runs.run import Run
    from crowdsim.scenario.scenario import Scenario
    from crowdsim.take.take import Take


@dataclass(frozen=True)
class Export:
    """One kind of file that is wanted of a take.

    Attributes:
        kind: ``bvh``, ``ply`` or ``pcd``; the folder of the files.
        fps: Output frames a second.
        frames: First output frame and one past the last.
        avatars: Their numbers; all when None.
        every: Every n-th output frame of point clouds is written.
        points: Points an avatar.
    """

    kind: str
    fps: float
    frames: tuple[int, int]
    avatars: Sequence[int] | None = None
    every: int = 1
    points: int = 500

    def plan(self, plan: Plan, names: Sequence[str]) -> None:
        """Add the names of the files to a plan; ``names`` are those of all avatars."""
        if self.kind != "bvh":
            plan.series.append((self.kind, range(*self.frames, self.every), self.kind))
            return
        from crowdsim.export.bvh import bvh_name

        numbers = range(len(names)) if self.avatars is None else self.avatars
        plan.files |= {f"bvh/{bvh_name(names[number])}" for number in numbers}

    def open(self, sampler: PoseSampler, folder: Path) -> tuple[list[Path], Sink | None]:
        """Return the files that are there already, which are whole, and the writer of the others; None without any."""
        place, take = make_inside(folder, self.kind), sampler.take
        if self.kind == "bvh":
            from crowdsim.export.bvh import BvhSink, bvh_name

            chosen = range(take.avatar_count) if self.avatars is None else self.avatars
            names = {number: bvh_name(take.cast.names[number]) for number in chosen}
            there = [number for number, name in names.items() if exists_plain(place, name)]
            missing = [number for number in names if number not in set(there)]
            is_empty = not missing or self.frames[0] >= self.frames[1]
            sink = None if is_empty else BvhSink(sampler, place, self.fps, self.frames, missing)
            return [place / names[number] for number in there], sink
        from crowdsim.export.pointcloud import CloudSink

        frames = range(*self.frames, self.every)
        start = next((frame for frame in frames if not exists_plain(place, f"{frame:06d}.{self.kind}")), self.frames[1])
        files = [place / f"{frame:06d}.{self.kind}" for frame in frames if frame < start]
        if start >= self.frames[1]:
            return files, None
        left = (start, self.frames[1])
        return files, CloudSink(sampler, place, self.kind, self.fps, self.points, left, self.every, self.avatars)


def wanted_exports(scenario: Scenario, control_frames: int, control_rate: float) -> list[Export]:
    """Return what a scenario wants written of a take of so many control frames."""
    found = []
    for kind in ("bvh", "ply", "pcd"):
        wanted = getattr(scenario.outputs, kind)
        if wanted is not None:
            fps = wanted.fps or scenario.fps
            frames = _limited(wanted.frames_at(fps), output_frames(control_frames, control_rate, fps))
            more = {} if kind == "bvh" else {"every": wanted.every, "points": wanted.points}
            found.append(Export(kind, fps, frames, wanted.avatars, **more))
    return found


def write_exports(
    sampler: PoseSampler, folder: Path, wanted: Iterable[Export], threads: int = 1, progress: Progress | None = None
) -> dict[str, list[Path]]:
    """Write what is missing of exports into a folder; return all files of each kind. Those at one rate share poses.

    Raises:
        OutputError: A file cannot be written.
    """
    from crowdsim.export.stream import stream_poses

    found: dict[str, list[Path]] = {}
    rates: dict[float, list[Sink]] = {}
    for export in wanted:
        found[export.kind], sink = export.open(sampler, folder)
        if sink is not None:
            rates.setdefault(export.fps, []).append(sink)
    for fps, sinks in rates.items():
        for sink, written in zip(sinks, stream_poses(sampler, fps, sinks, threads, progress), strict=True):
            found[sink.kind] = _in_order(sampler.take, [*found[sink.kind], *written])
    return found


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


def plan_outputs(scenario: Scenario, avatars: Sequence[str], control_frames: int, control_rate: float) -> Plan:
    """Return the names of all files that the outputs of a scenario may have in the run folder.

    Args:
        scenario: The scenario, resolved.
        avatars: Name of each avatar.
        control_frames: Control frames of the run.
        control_rate: Control frames a second.
    """
    wanted, plan = scenario.outputs, Plan()
    for export in wanted_exports(scenario, control_frames, control_rate):
        export.plan(plan, avatars)
    if wanted.render is not None:
        count = output_frames(control_frames, control_rate, wanted.render.fps)
        plan.files |= {"video.mp4"} if wanted.render.mp4 else set()
        plan.files |= {"contact_sheet.png"} if wanted.render.contact_sheet else set()
        if wanted.render.png:
            plan.series.append(("frames", range(*_limited(wanted.render.frames_at(wanted.render.fps), count)), "png"))
    if wanted.profile is not None:
        plan.files |= {"profile.csv"} if wanted.profile.csv else set()
        plan.files |= {"profile.png"} if wanted.profile.plots else set()
    return plan


def write_outputs(run: Run, take: Take, policies: Sequence[Policy]) -> dict[str, list[Path]]:
    """Write the outputs that a run's scenario asks for from its take; return the files of each kind.

    Files that are there already are whole, and are not written again.

    Raises:
        OutputError: A file cannot be written.
        Interrupted: A signal has come.
    """
    from crowdsim.poses.sampler import PoseSampler

    found: dict[str, list[Path]] = {}
    wanted = wanted_exports(run.scenario, take.frame_count, take.control_rate)
    if wanted:
        sampler = PoseSampler(take, policies, run.threads)
        found = write_exports(sampler, run.work, wanted, run.threads, run.advance_outputs)
        run.clock.lap("export")
    if run.scenario.outputs.render is not None:
        found["pictures"] = _render(run, take, policies)
        run.clock.lap("render")
    return found


def _render(run: Run, take: Take, policies: Sequence[Policy]) -> list[Path]:
    """Write the pictures that a run's scenario asks for; return their files."""
    from crowdsim.crowd.draw import pack_arena
    from crowdsim.render.batch import picture_files, render
    from crowdsim.render.command import scenario_options
    from crowdsim.render.take_source import TakeSource

    wanted, folder = run.scenario.outputs.render, run.work
    assert wanted is not None
    count = take.output_frames(wanted.fps)
    frames = _limited(wanted.frames_at(wanted.fps), count)
    if frames[0] == frames[1]:
        return []
    options = replace(scenario_options(wanted, run.threads), frames=frames)
    files = picture_files(folder, frames, wanted.mp4, wanted.png, wanted.contact_sheet or 0)
    is_there = {name: (folder / name).exists() for name in ("video.mp4", "contact_sheet.png")}
    if all(path.exists() for path in files):
        return files
    options = replace(
        options,
        mp4=options.mp4 and not is_there["video.mp4"],
        contact_sheet=0 if is_there["contact_sheet.png"] else options.contact_sheet,
    )
    source = TakeSource(take, policies, wanted.fps, threads=run.threads, arena=pack_arena(run.scenario.arena))
    render(source, folder, options, run.advance_outputs)
    return files


def _in_order(take: TakeData, files: Sequence[Path]) -> list[Path]:
    """Return files, each once, by avatar or by frame."""
    numbers = {str(name): number for number, name in enumerate(take.cast.names)}
    return sorted(set(files), key=lambda path: numbers[path.stem] if path.suffix == ".bvh" else int(path.stem))


def _limited(frames: Sequence[int] | None, count: int) -> tuple[int, int]:
    """Return a checked range of a scenario's output frames, all when None, cut to the ``count`` that there are.

    It is empty where the run has ended before.
    """
    return (0, count) if frames is None else (min(frames[0], count), min(frames[1], count))

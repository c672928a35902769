"""Exports of a run that was written before: all of them appear together, when they are whole."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Progress
from crowdsim.errors import CrowdsimError
from crowdsim.files import is_folder, make_folder, move_plain, walk
from crowdsim.runs.manifest import EXPORT
from crowdsim.runs.origin import sources_hash
from crowdsim.runs.outputs import divide_avatars, divide_frames, in_order
from crowdsim.runs.stage import Plan, write_together
from crowdsim.scenario.frame_ranges import parse_frames

if TYPE_CHECKING:
    from crowdsim.export.stream import Sink
    from crowdsim.policy.policy import Policy
    from crowdsim.take.poses import PoseSampler
    from crowdsim.take.take import Take


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


@dataclass(frozen=True)
class _Range:
    """Which avatars, all when None, and output frames are exported: the first, and one past the last."""

    avatars: Sequence[int] | None
    frames: tuple[int, int]


def export_take(
    folder: Path,
    take: Take,
    policies: Sequence[Policy],
    options: ExportOptions,
    out: Path | None = None,
    threads: int = 1,
    progress: Progress | None = None,
    force: bool = False,
) -> dict[str, list[Path]]:
    """Export a run's take again; return the files of each kind.

    What an interrupted export has finished is kept for the same export, and removed by another one. In the run's own
    folder, exports take the place of those of their kind; in another one only with ``force``.

    Args:
        folder: The run folder.
        take: Its take.
        policies: Its policies.
        options: What to export.
        out: Another folder for ``bvh/``, ``ply/`` and ``pcd/``.
        threads: Threads.
        progress: Called with stage, done and total.
        force: Whether to do it again although it is done, and to replace exports in another folder.

    Raises:
        TakeError: Avatars or frames are asked for that the take does not have, or the manifest is damaged.
        OutputError: A folder cannot be made or is in use, or holds other files of these names.
        RunError: A file cannot be written.
    """
    from crowdsim.export.select import parse_avatars
    from crowdsim.take.poses import PoseSampler

    if not options.kinds:
        raise CrowdsimError("nothing to export, expected --bvh, --ply or --pcd")
    count, fps = take.output_frames(options.fps), options.fps
    frames = (0, count)
    if options.frames is not None:
        frames = parse_frames(options.frames).resolve(count, fps, take.frame_limit(fps))
    wanted = _Range(parse_avatars(options.avatars, take.avatar_count), frames)
    made_from = {"take": _mark(take), "frames": frames, "avatars": wanted.avatars and list(wanted.avatars)}
    plan = plan_exports(take, options, wanted)
    with write_together(
        out or folder, EXPORT, options.kinds, asdict(options), plan, made_from, folder, options.kinds, force, threads
    ) as writing:
        written = (
            {kind: [path for path in writing.done if path.parent.name == kind] for kind in options.kinds}
            if writing.done
            else _write(PoseSampler(take, policies, threads), writing.folder, options, wanted, threads, progress)
        )
    return {kind: [(out or folder) / kind / path.name for path in files] for kind, files in written.items()}


def adopt_exports(folder: Path, apart: Path, options: ExportOptions, threads: int = 1) -> None:
    """Put exports of a finished run that ``export_take`` wrote into another folder in their places in the run's.

    They appear under their names all together. A process that takes over from one that was killed completes it.

    Args:
        folder: The run folder.
        apart: The other folder, on the same disk, with a folder for each kind.
        options: What was exported.
        threads: Threads that sum up files.

    Raises:
        TakeError: The manifest is damaged.
        OutputError: The folder is in use, or holds other files of these names beside a run's.
        RunError: A file cannot be written.
    """
    folders = [(place, kind) for place in (apart, folder / EXPORT) for kind in options.kinds if is_folder(place, kind)]
    names = {name for place, kind in folders for name in walk(place, kind)}
    if not names:
        return
    with write_together(
        folder, EXPORT, options.kinds, asdict(options), Plan(names), None, folder, options.kinds, threads=threads
    ) as writing:
        for kind in options.kinds if not writing.done else ():
            for name in walk(apart, kind) if is_folder(apart, kind) else ():
                move_plain(apart, name, writing.folder)


def plan_exports(take: Take, options: ExportOptions, wanted: _Range) -> Plan:
    """Return the names of all files of an export."""
    from crowdsim.export.bvh import bvh_name

    plan = Plan()
    for kind in options.kinds:
        if kind == "bvh":
            numbers = range(take.avatar_count) if wanted.avatars is None else wanted.avatars
            plan.files |= {f"bvh/{bvh_name(take.cast.names[number])}" for number in numbers}
        else:
            plan.series.append((kind, range(*wanted.frames, options.every), kind))
    return plan


def _mark(take: Take) -> str:
    """Return a checksum of what the files of an export depend on beside the options."""
    last = [np.ascontiguousarray(values[-1:]).tobytes() for values in (take.action, take.x, take.z, take.heading)]
    made = [take.scenario, str(take.seed), *take.fingerprints, str(take.frame_count), sources_hash()]
    return hashlib.sha256(b"".join(last) + "\n".join(made).encode()).hexdigest()


def _write(
    sampler: PoseSampler,
    folder: Path,
    options: ExportOptions,
    wanted: _Range,
    threads: int,
    progress: Progress | None,
) -> dict[str, list[Path]]:
    """Write what is missing of an export into a folder; return all its files, by kind."""
    from crowdsim.export.bvh import BvhSink
    from crowdsim.export.pointcloud import CloudSink
    from crowdsim.export.stream import stream_poses

    take, found = sampler.take, {}
    sinks: list[Sink] = []
    fps, points, every = options.fps, options.points, options.every
    for kind in options.kinds:
        place = folder / kind
        make_folder(place)
        if kind == "bvh":
            chosen = range(take.avatar_count) if wanted.avatars is None else wanted.avatars
            found[kind], missing = divide_avatars(place, take, chosen)
            if missing:
                sinks.append(BvhSink(sampler, place, fps, wanted.frames, missing))
        else:
            found[kind], start = divide_frames(place, kind, range(*wanted.frames, every))
            frames = (start, wanted.frames[1])
            if frames[0] < frames[1]:
                sinks.append(CloudSink(sampler, place, kind, fps, points, frames, every, wanted.avatars))
    if sinks:
        for sink, written in zip(sinks, stream_poses(sampler, fps, sinks, threads, progress), strict=True):
            found[sink.kind] = in_order(take, [*found[sink.kind], *written])
    return found

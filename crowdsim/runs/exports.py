"""Exports of a run that was written before: written apart, and put in their places all together when they are whole."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Progress
from crowdsim.errors import CrowdsimError, under_way
from crowdsim.files import make_folder
from crowdsim.runs.journal import series_name
from crowdsim.runs.lock import find_owner, hold_folder
from crowdsim.runs.manifest import checksums, stage_manifest
from crowdsim.runs.origin import sources_hash
from crowdsim.runs.outputs import divide_avatars, divide_frames, in_order
from crowdsim.runs.recorder import record_files
from crowdsim.runs.signed_json import checksum
from crowdsim.runs.staging import commit, complete, discard
from crowdsim.scenario.frame_ranges import parse_frames

if TYPE_CHECKING:
    from crowdsim.export.stream import Sink
    from crowdsim.policy.policy import Policy
    from crowdsim.take.poses import PoseSampler
    from crowdsim.take.take import Take

PREFIX = ".export-"


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
class _Plan:
    """What is exported, in numbers.

    Attributes:
        kinds: ``bvh``, ``ply``, ``pcd``.
        avatars: Numbers of the avatars; all when None.
        frames: First output frame and one past the last.
        options: What a user asked for.
    """

    kinds: Sequence[str]
    avatars: Sequence[int] | None
    frames: tuple[int, int]
    options: ExportOptions

    def names(self, take: Take) -> list[str]:
        """Return the names of all files, numbered ones by one name."""
        from crowdsim.export.bvh import bvh_name

        names = []
        for kind in self.kinds:
            if kind == "bvh":
                numbers = range(take.avatar_count) if self.avatars is None else self.avatars
                names += [f"bvh/{bvh_name(take.cast.names[number])}" for number in numbers]
            else:
                names.append(series_name(kind, range(*self.frames, self.options.every), kind))
        return names


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

    They appear under their names all together, when all are whole. What an interrupted export has finished is kept for
    the same export, and removed by another one. In the run's own folder, exports take the place of those of their kind,
    and the manifest says so.

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
        OutputError: A folder cannot be made or is in use, or holds other files of these names beside a run's.
        RunError: A file cannot be written.
    """
    from crowdsim.export.select import parse_avatars
    from crowdsim.take.poses import PoseSampler

    if not options.kinds:
        raise CrowdsimError("nothing to export, expected --bvh, --ply or --pcd")
    fps, target = options.fps, out or folder
    count = take.output_frames(fps)
    frames = (0, count)
    if options.frames is not None:
        frames = parse_frames(options.frames).resolve(count, fps, take.frame_limit(fps))
    plan = _Plan(options.kinds, parse_avatars(options.avatars, take.avatar_count), frames, options)
    staged_name = f"{PREFIX}{_mark(take, plan)[:16]}"
    with record_files(target, [target / name for name in plan.names(take)], [staged_name]) as recorder:
        base, above = recorder.base(target)
        make_folder(target)
        with under_way(), _staging(base, staged_name) as staged:
            sampler = PoseSampler(take, policies, threads)
            found = _write(sampler, staged / above, plan, threads, progress)
            names = {kind: [path.relative_to(staged).as_posix() for path in files] for kind, files in found.items()}
            _settle(base, staged, above, names, asdict(options), threads)
    return {kind: [base / name for name in files] for kind, files in names.items()}


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
    name = f"{PREFIX}{checksum({'adopted': asdict(options)})[:16]}"
    staged = folder / name
    names = {}
    for kind in options.kinds:
        places = [place for place in (apart / kind, staged / kind) if place.is_dir()]
        names[kind] = sorted(f"{kind}/{path.name}" for path in places[0].iterdir()) if places else []
    kept = {kind: files for kind, files in names.items() if files}
    with record_files(folder, [folder / name for files in kept.values() for name in files], [name]):
        if not any((apart / kind).is_dir() or (staged / kind).is_dir() for kind in kept):
            return
        make_folder(staged)
        with under_way(), hold_folder(staged):
            for kind in kept:
                if (apart / kind).is_dir():
                    os.replace(apart / kind, staged / kind)
            _settle(folder, staged, Path(), kept, asdict(options), threads)


def _mark(take: Take, plan: _Plan) -> str:
    """Return a checksum of all that the files of an export depend on."""
    last = [np.ascontiguousarray(values[-1:]).tobytes() for values in (take.action, take.x, take.z, take.heading)]
    asked = {**asdict(plan.options), "frames": plan.frames, "avatars": plan.avatars}
    made = [take.scenario, take.seed, take.fingerprints, take.frame_count, sources_hash()]
    return checksum({"take": hashlib.sha256(b"".join(last)).hexdigest(), "made": made, "asked": asked})


@contextmanager
def _staging(base: Path, name: str) -> Iterator[Path]:
    """Hold a staging folder; those that other exports have left are completed or removed."""
    complete(base)
    for other in base.glob(f"{PREFIX}*"):
        if other.name != name and other.is_dir() and not other.is_symlink() and find_owner(other) is None:
            discard(other)
    with ExitStack() as held:
        held.enter_context(hold_folder(base / name))
        yield base / name


def _write(
    sampler: PoseSampler, folder: Path, plan: _Plan, threads: int, progress: Progress | None
) -> dict[str, list[Path]]:
    """Write what is missing of an export into a folder; return all its files, by kind."""
    from crowdsim.export.stream import stream_poses

    take, found, sinks = sampler.take, {}, []
    for kind in plan.kinds:
        make_folder(folder / kind)
        if kind == "bvh":
            chosen = range(take.avatar_count) if plan.avatars is None else plan.avatars
            found[kind], missing = divide_avatars(folder / kind, take, chosen)
            sinks += [_sink(kind, sampler, folder, plan, missing, plan.frames)] if missing else []
        else:
            found[kind], start = divide_frames(folder / kind, kind, range(*plan.frames, plan.options.every))
            frames = (start, plan.frames[1])
            sinks += [_sink(kind, sampler, folder, plan, plan.avatars, frames)] if frames[0] < frames[1] else []
    if sinks:
        files = stream_poses(sampler, plan.options.fps, sinks, threads, progress)
        for sink, written in zip(sinks, files, strict=True):
            found[sink.kind] = in_order(take, [*found[sink.kind], *written])
    return found


def _sink(
    kind: str,
    sampler: PoseSampler,
    folder: Path,
    plan: _Plan,
    avatars: Sequence[int] | None,
    frames: tuple[int, int],
) -> Sink:
    """Return the writer of one kind of export."""
    options = plan.options
    if kind == "bvh":
        from crowdsim.export.bvh import BvhSink

        return BvhSink(sampler, folder / kind, options.fps, frames, avatars)
    from crowdsim.export.pointcloud import CloudSink

    return CloudSink(sampler, folder / kind, kind, options.fps, options.points, frames, options.every, avatars)


def _settle(
    base: Path,
    staged: Path,
    above: Path,
    names: Mapping[str, Sequence[str]],
    result: Mapping[str, Any],
    threads: int,
) -> None:
    """Put files that were written apart in their places, and record them in the manifest where there is one."""
    every = [name for files in names.values() for name in files]
    kinds = {(above / kind).as_posix(): files for kind, files in names.items()}
    stale = stage_manifest(base, staged, kinds, result, checksums(staged, every, threads))
    commit(base, staged, every, stale)

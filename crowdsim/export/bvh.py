"""Avatars of a take as BVH files, one each, in the world: centimetres, y up, end sites."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import OutputError
from crowdsim.motion.bvh import BvhWriter
from crowdsim.take.poses import PoseSampler

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]

_POSES_AT_ONCE = 60_000
_FRAMES_AT_ONCE = 512


def export_bvh(
    sampler: PoseSampler,
    folder: Path,
    fps: float,
    frames: tuple[int, int] | None = None,
    avatars: Sequence[int] | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Write ``<avatar name>.bvh`` for avatars of a take.

    Memory does not grow with the take: avatars are written in groups and frames in chunks. An avatar that is absent for
    a time, because its group comes late or leaves, has the frames in which it is there.

    Args:
        sampler: Poses of the take.
        folder: Folder for the files; made when missing.
        fps: Output frames a second.
        frames: First output frame and one past the last; all when None.
        avatars: Numbers of the avatars; all when None.
        progress: Called with ("bvh", files done, files).

    Returns:
        The files, in the order of the avatars.

    Raises:
        OutputError: A file cannot be written.
    """
    take = sampler.take
    start, stop = frames or (0, take.output_frames(fps))
    numbers = np.arange(take.avatar_count) if avatars is None else np.unique(np.asarray(avatars, dtype=np.int64))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror or error}") from None
    at_once = max(1, _POSES_AT_ONCE // min(_FRAMES_AT_ONCE, max(1, stop - start)))
    written: list[Path] = []
    for low in range(0, len(numbers), at_once):
        group = numbers[low : low + at_once]
        with ExitStack() as stack:
            writers = {int(number): _open(sampler, int(number), folder, fps, start, stop, stack) for number in group}
            for first in range(start, stop, _FRAMES_AT_ONCE):
                _append(sampler, writers, group, first, min(first + _FRAMES_AT_ONCE, stop), fps)
        written.extend(writer.path for writer in writers.values() if writer is not None)
        if progress is not None:
            progress("bvh", low + len(group), len(numbers))
    return written


def _open(
    sampler: PoseSampler, number: int, folder: Path, fps: float, start: int, stop: int, stack: ExitStack
) -> BvhWriter | None:
    """A writer for an avatar's frames; None where it is absent all the time."""
    take = sampler.take
    present = sampler.present(number, start, stop, fps)
    if not present:
        return None
    skeleton = sampler.policies[int(take.cast.policies[number])].database.skeleton
    scaled = skeleton.scaled(float(take.cast.scales[number]))
    path = folder / f"{take.cast.names[number]}.bvh"
    return stack.enter_context(BvhWriter(path, scaled, fps, present))


def _append(
    sampler: PoseSampler, writers: dict[int, BvhWriter | None], group: Array, first: int, stop: int, fps: float
) -> None:
    for poses in sampler.sample(first, stop, fps, group):
        for column, number in enumerate(poses.avatars):
            writer = writers[int(number)]
            if writer is None:
                continue
            roots, rotations = poses.root_positions[:, column], poses.rotations[:, column]
            there = np.isfinite(roots[:, 0])
            if there.all():
                writer.append(roots, rotations)
            elif there.any():
                writer.append(roots[there], rotations[there])

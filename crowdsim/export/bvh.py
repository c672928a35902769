"""Avatars of a take as BVH files, one each, in the world: centimetres, y up, end sites."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from crowdsim.bvh.io import BvhWriter
from crowdsim.core.types import Array, Progress
from crowdsim.export.stream import Block, run_all, stream_poses
from crowdsim.files import make_folder
from crowdsim.poses.builds import build_skeleton
from crowdsim.poses.sampler import Poses, PoseSampler

_DECIMALS = 5
"""Of a centimetre and of a degree: far finer than what is blended and carried."""
_FILES_AT_ONCE = 128


class BvhSink:
    """Writes ``<avatar name>.bvh`` for avatars of a take; a ``Sink``.

    An avatar that is absent for a time, because its group comes late or leaves, has the frames in which it is there.

    Args:
        sampler: Poses of the take.
        folder: Folder for the files, which is there when the first is written.
        fps: Output frames a second.
        frames: First output frame and one past the last; all when None.
        avatars: Numbers of the avatars; all when None.
    """

    kind = "bvh"
    margin = 0

    def __init__(
        self,
        sampler: PoseSampler,
        folder: Path,
        fps: float,
        frames: tuple[int, int] | None = None,
        avatars: Sequence[int] | Array | None = None,
    ) -> None:
        take = sampler.take
        self.start, self.stop = frames or (0, take.output_frames(fps))
        self.avatars: Array = np.arange(take.avatar_count) if avatars is None else np.unique(np.asarray(avatars))
        self.done = 0
        self._sampler, self._folder, self._fps = sampler, folder, fps
        self._writers: dict[int, BvhWriter] | None = None

    @property
    def total(self) -> int:
        """Number of files, those of avatars that are never there included."""
        return len(self.avatars)

    def split(self, most: int) -> list[BvhSink]:
        """Return sinks of a few avatars each, whatever ``most`` says, since each writes the whole time anyway."""
        size = min(most, _FILES_AT_ONCE)
        parts = [self.avatars[low : low + size] for low in range(0, len(self.avatars), size)]
        frames = (self.start, self.stop)
        return [BvhSink(self._sampler, self._folder, self._fps, frames, part) for part in parts]

    def write(self, block: Block, pool: ThreadPoolExecutor) -> None:
        """Append a block of frames to every file."""
        if self._writers is None:
            self._writers = self._open()
        writers = self._writers
        low, high = max(block.first_output, self.start), min(block.stop_output, self.stop)
        rows = slice(low - block.first, high - block.first)

        def append(poses: Poses, column: int) -> None:
            writer = writers.get(int(poses.avatars[column]))
            if writer is None:
                return
            roots, rotations = poses.root_positions[rows, column], poses.rotations[rows, column]
            there = np.isfinite(roots[:, 0])
            if there.all():
                writer.append(roots, rotations)
            elif there.any():
                writer.append(roots[there], rotations[there])

        work = [(poses, column) for poses in block.poses for column in range(len(poses.avatars))]
        run_all(pool, lambda item: append(*item), work)
        self.done = self.total * (high - self.start) // (self.stop - self.start)

    def close(self) -> list[Path]:
        """Give the files their names and return them, in the order of the avatars."""
        writers = self._writers or {}
        for writer in writers.values():
            writer.close()
        return [writer.path for writer in writers.values()]

    def abandon(self) -> None:
        """Remove what is half-written."""
        for writer in (self._writers or {}).values():
            writer.abandon()

    def _open(self) -> dict[int, BvhWriter]:
        """Writers of the avatars that are there at some time."""
        sampler, writers = self._sampler, {}
        cast = sampler.take.cast
        for number in map(int, self.avatars):
            present = sampler.present(number, self.start, self.stop, self._fps)
            if present:
                motion = sampler.motions[int(cast.policies[number])]
                sizes = float(cast.scales[number]) * cast.stretches[number]
                skeleton = build_skeleton(motion.skeleton, motion.segments, sizes)
                path = self._folder / bvh_name(cast.names[number])
                writers[number] = BvhWriter(path, skeleton, self._fps, present, decimals=_DECIMALS)
        return writers


def export_bvh(
    sampler: PoseSampler,
    folder: Path,
    fps: float,
    frames: tuple[int, int] | None = None,
    avatars: Sequence[int] | Array | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> list[Path]:
    """Write ``<avatar name>.bvh`` for avatars of a take; see ``BvhSink``.

    Args:
        sampler: Poses of the take.
        folder: Folder for the files; made when missing.
        fps: Output frames a second.
        frames: First output frame and one past the last; all when None.
        avatars: Numbers of the avatars; all when None.
        threads: Threads that write.
        progress: Called with ("bvh", files done, files).

    Returns:
        The files, in the order of the avatars.

    Raises:
        OutputError: The folder cannot be made, or a file cannot be written.
    """
    make_folder(folder)
    return stream_poses(sampler, fps, [BvhSink(sampler, folder, fps, frames, avatars)], threads, progress)[0]


def bvh_name(avatar: str) -> str:
    """Return the name of an avatar's BVH file."""
    return f"{avatar}.bvh"

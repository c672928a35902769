"""Poses of a take passed on to exporters in blocks of frames, so that each frame is posed once for all of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from crowdsim.core.types import Array, Progress

if TYPE_CHECKING:
    from crowdsim.poses.sampler import Poses, PoseSampler

Item = TypeVar("Item")
Result = TypeVar("Result")

_POSES_AT_ONCE = 16_000
_FRAMES_AT_ONCE = 512
_AHEAD = 2
"""Blocks that are posed at once: while the one plans, the other is worked on by all threads."""
_MANY_AVATARS = 512
"""From so many avatars on, those who want whole avatars and those who want whole frames no longer share blocks."""


@dataclass(frozen=True)
class Block:
    """Poses of a stretch of output frames.

    Attributes:
        first: Output frame of the first row.
        first_output: First frame that is to be written; rows before it only serve as neighbours.
        stop_output: One past the last frame that is to be written.
        poses: The poses, an item a policy.
    """

    first: int
    first_output: int
    stop_output: int
    poses: Sequence[Poses]

    @cached_property
    def joints(self) -> list[tuple[Array, Array]]:
        """Places (T, n, J, 3) [m] and rotations (T, n, J, 4) of all joints in the world, an item a policy."""
        return [poses.joints() for poses in self.poses]


class Sink(Protocol):
    """Writes files from blocks of poses.

    Attributes:
        kind: What it writes, for progress.
        start: First output frame.
        stop: One past the last.
        avatars: Numbers of its avatars, ascending.
        margin: Frames before and after each that it looks at.
        reads_joints: Whether it reads the joints of blocks, which are then worked out once, ahead of it.
        total: Number of files.
        done: Number of files written.
    """

    kind: str
    start: int
    stop: int
    avatars: Array
    margin: int
    reads_joints: bool

    @property
    def total(self) -> int:
        """Number of files."""

    @property
    def done(self) -> int:
        """Number of files written so far, or their share."""

    def split(self, most: int) -> Sequence[Sink]:
        """Return sinks of at most so many avatars that write the same, or itself where that cannot be."""

    def write(self, block: Block, pool: ThreadPoolExecutor) -> None:
        """Write a block; blocks come in the order of time."""

    def close(self) -> list[Path]:
        """Finish the files and return them."""

    def abandon(self) -> None:
        """Give up: remove unfinished files, or keep them for the next call."""


def stream_poses(
    sampler: PoseSampler, fps: float, sinks: Sequence[Sink], threads: int = 1, progress: Progress | None = None
) -> list[list[Path]]:
    """Pose a take block by block and let every sink write; return the files of each.

    Memory does not grow with the take. Where a sink fails, it removes its unfinished files, or keeps them for the
    next call.

    Args:
        sampler: Poses of the take.
        fps: Output frames a second, of all sinks.
        sinks: What writes.
        threads: Threads that write.
        progress: Called with what is written, how many files are done and how many there are.
    """
    shared = len(sinks) > 1 and len(_union(sinks)) <= _MANY_AVATARS
    with ThreadPoolExecutor(max(1, threads)) as pool:
        if shared:
            return _stream(sampler, fps, sinks, pool, progress)
        written = []
        for sink in sinks:
            files: list[Path] = []
            before = 0
            for part in sink.split(_MANY_AVATARS):
                files += _stream(sampler, fps, [part], pool, _after(progress, before, sink.total))[0]
                before += part.total
            written.append(files)
        return written


def _after(progress: Progress | None, before: int, total: int) -> Progress | None:
    """Report a part of some files, of which others were written before."""
    return progress and (lambda kind, done, _: progress(kind, before + done, total))


def _stream(
    sampler: PoseSampler, fps: float, sinks: Sequence[Sink], pool: ThreadPoolExecutor, progress: Progress | None
) -> list[list[Path]]:
    avatars = _union(sinks)
    start, stop = min(sink.start for sink in sinks), max(sink.stop for sink in sinks)
    margin, reads_joints = max(sink.margin for sink in sinks), any(sink.reads_joints for sink in sinks)
    last = sampler.take.output_frames(fps)
    size = int(np.clip(_POSES_AT_ONCE // max(1, len(avatars)), 1, _FRAMES_AT_ONCE))
    kinds = " and ".join(sink.kind for sink in sinks)

    def pose(first: int) -> Block:
        end = min(first + size, stop)
        low, high = max(first - margin, 0), min(end + margin, last)
        block = Block(low, first, end, sampler.sample(low, high, fps, avatars))
        if reads_joints:
            _ = block.joints
        return block

    ahead, firsts = ThreadPoolExecutor(_AHEAD), iter(range(start, stop, size))
    try:
        # The next blocks are posed while this one is written.
        coming = deque(ahead.submit(pose, first) for first in islice(firsts, _AHEAD))
        for first in range(start, stop, size):
            block = coming.popleft().result()
            coming.extend(ahead.submit(pose, following) for following in islice(firsts, 1))
            for sink in sinks:
                if max(first, sink.start) < min(block.stop_output, sink.stop):
                    sink.write(block, pool)
                if progress is not None:
                    progress(kinds, sum(sink.done for sink in sinks), sum(sink.total for sink in sinks))
        return [sink.close() for sink in sinks]
    except BaseException:
        for sink in sinks:
            sink.abandon()
        raise
    finally:
        # A block that is still being posed is of no use, and for a large crowd it takes minutes.
        ahead.shutdown(wait=False, cancel_futures=True)


def run_all(pool: ThreadPoolExecutor, work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return what work makes of every item, in order; where one fails, no other is still going on afterwards."""
    futures = [pool.submit(work, item) for item in items]
    try:
        return [future.result() for future in futures]
    finally:
        for future in futures:
            future.cancel()
        wait(futures)


def _union(sinks: Sequence[Sink]) -> Array:
    return np.unique(np.concatenate([sink.avatars for sink in sinks]))

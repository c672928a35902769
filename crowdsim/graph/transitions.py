"""Transitions: pairs of frames that look alike, found as local minima of their distance.

After frame i the frame j may be shown where the cost of (i, j - 1) is below a threshold and the lowest among its
neighbours in the plane (as far as ``radius`` in both directions), where the same feet are planted in i and j - 1, and
where the two are not near in time (the paper's section 3). The cost is symmetric, so a pair (i, k) stands for two
transitions: i to k + 1 and k to i + 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.graph.transitions_kernels import local_minima, square_distances
from crowdsim.motion.database import MotionDatabase

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]

_BLOCK_BYTES = 16e6
"""Size of a block of distances, which bounds memory and says how often progress is told."""


@dataclass(frozen=True)
class Pairs:
    """Pairs of frames that look alike, in the order of (first, second); N of them.

    Attributes:
        first: The earlier frame of each pair. Shape (N,), int32.
        second: The later frame. Shape (N,), int32.
        costs: Distance of the two [m]. Shape (N,), float32.
    """

    first: Array
    second: Array
    costs: Array

    def __len__(self) -> int:
        return len(self.first)

    def chosen(self, which: Array) -> Pairs:
        """Return the pairs that ``which`` indexes."""
        return Pairs(self.first[which], self.second[which], self.costs[which])


def find_pairs(
    features: Array,
    clip_starts: Array,
    contacts: Array,
    near: int,
    radius: int = 1,
    ceiling: float = np.inf,
    most: int | None = None,
    progress: Progress | None = None,
) -> Pairs:
    """Return the pairs of frames that are local minima of the distance between their features.

    Blocks of frames go through all threads one after another; the result is the same for any number of threads.

    Args:
        features: One row for each frame [m]. Shape (F, D).
        clip_starts: First frame of each clip, and F. Shape (C + 1,). Frames beside each other in different clips are no
            neighbours.
        contacts: Whether the left and right foot are planted. Shape (F, 2).
        near: Frames of one clip must be this far apart, at least 1.
        radius: How far the neighbours reach among which a pair must be the cheapest; 1 compares with eight of them.
        ceiling: Largest cost [m].
        most: About how many pairs to keep, the cheapest; between once and twice as many come back where there are more.
        progress: Called with ('transitions', frames done, F).
    """
    frames = len(features)
    # The columns that vary most come first, so that distant frames are known as such early.
    order = np.argsort(-features.var(axis=0, dtype=np.float64), kind="stable")
    rows = np.ascontiguousarray(features[:, order], dtype=np.float32)
    columns = np.ascontiguousarray(rows.T)
    clips = np.repeat(np.arange(len(clip_starts) - 1, dtype=np.int32), np.diff(clip_starts))
    feet = (contacts[:, 0] + 2 * contacts[:, 1].astype(np.uint8)).astype(np.uint8)
    block = int(np.clip(_BLOCK_BYTES // (4 * max(frames, 1)), 16, 512))
    squares = np.empty((block + 2 * radius, frames), np.float32)
    found_columns = np.empty((block, frames), np.int32)
    found_squares = np.empty((block, frames), np.float32)
    counts = np.zeros(block, np.int64)
    parts: list[Pairs] = []
    total = 0
    limit = np.float32(min(float(ceiling) ** 2, np.finfo(np.float32).max))
    for start in range(0, frames, block):
        stop = min(frames, start + block)
        top, bottom = max(0, start - radius), min(frames, stop + radius)
        square_distances(rows, columns, top, bottom, limit, squares)
        local_minima(
            squares, top, start, stop, clips, feet, max(near, 1), radius, limit, found_columns, found_squares, counts
        )
        used = counts[: stop - start]
        mask = np.arange(frames) < used[:, None]
        parts.append(
            Pairs(
                np.repeat(np.arange(start, stop, dtype=np.int32), used),
                found_columns[: stop - start][mask],
                np.sqrt(found_squares[: stop - start][mask]),
            )
        )
        total += len(parts[-1])
        if most is not None and total > 2 * most:
            parts = [cheapest(_joined(parts), most)]
            total = len(parts[0])
            limit = np.float32(min(limit, parts[0].costs.max() ** 2))
        if progress is not None:
            progress("transitions", stop, frames)
    return _joined(parts)


def cheapest(pairs: Pairs, most: int) -> Pairs:
    """Return the ``most`` cheapest pairs, and those as cheap as the last of them."""
    if len(pairs) <= most:
        return pairs
    bound = np.partition(pairs.costs, most - 1)[most - 1]
    return pairs.chosen(np.flatnonzero(pairs.costs <= bound))


def directed(pairs: Pairs, clip_starts: Array) -> tuple[Array, Array, Array]:
    """Return both transitions of each pair, where the frame to show lies in its clip, sorted by (from, to).

    Returns:
        Frame after which each transition happens (N,) int32, frame shown next (N,) int32, cost (N,) float32.
    """
    sources = np.concatenate([pairs.first, pairs.second])
    targets = np.concatenate([pairs.second, pairs.first]) + np.int32(1)
    costs = np.concatenate([pairs.costs, pairs.costs])
    inside = ~np.isin(targets, clip_starts)
    sources, targets, costs = sources[inside], targets[inside], costs[inside]
    order = np.lexsort((targets, sources))
    return sources[order], targets[order], costs[order]


def control_contacts(database: MotionDatabase) -> Array:
    """Return whether the left and right foot are planted at each control frame. Shape (F, 2), bool."""
    return np.ascontiguousarray(database.contacts[:: database.stride][: database.frame_count])


def _joined(parts: list[Pairs]) -> Pairs:
    """Return pairs of several blocks as one."""
    if not parts:
        return Pairs(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.float32))
    return Pairs(
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.second for part in parts]),
        np.concatenate([part.costs for part in parts]),
    )

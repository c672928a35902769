"""Transitions: from a frame to one that follows a frame much like it.

After frame i the frame j may be shown where the cost of (i, j - 1) is below a threshold and the lowest among its eight
neighbours in the plane, where the same feet are planted in i and j - 1, and where the two are not near in time (the
paper's section 3, after Lee et al. 2002). Of each frame's transitions the cheapest few are kept: the poses of a guard,
to which a boxer comes back all the time, look like hundreds of others, and more of them would add nothing but work.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.core.workers import share
from crowdsim.graph.transitions_kernels import Frames, Minima, keep_cheapest, local_minima, square_distances

_BLOCK_BYTES = 16e6
"""Size of a block of distances, which bounds memory and sets how often progress is reported."""


_TILE = 128
"""Frames whose distances to a frame are reckoned side by side."""


@dataclass(frozen=True)
class Transitions:
    """Transitions in the order of (source, target); T of them.

    Attributes:
        sources: Frame after which each transition happens. Shape (T,), int32.
        targets: Frame shown next. Shape (T,), int32.
        costs: Distance of ``sources`` and ``targets - 1`` [m]. Shape (T,), float32.
    """

    sources: Array
    targets: Array
    costs: Array

    def __len__(self) -> int:
        return len(self.sources)

    def chosen(self, which: Array) -> Transitions:
        """Return the transitions for which ``which`` is true."""
        return Transitions(self.sources[which], self.targets[which], self.costs[which])


def find_transitions(
    features: Array,
    clip_starts: Array,
    contacts: Array,
    near: int,
    most: int,
    ceiling: float = np.inf,
    progress: Progress | None = None,
    leading: int | None = None,
    telling: Array | None = None,
) -> Transitions:
    """Return the cheapest transitions of each frame, or of the leading frames.

    Blocks of frames go through all threads one after another; the result is the same for any number of threads. Where
    costs are equal the earlier frame is taken.

    Args:
        features: One row for each frame, whose distances are the costs [m]. Shape (F, D).
        clip_starts: First frame of each clip, and F. Shape (C + 1,). Frames beside each other in different clips are no
            neighbours.
        contacts: Whether the left and right foot are planted. Shape (F, 2).
        near: Frames of one clip must be this far apart, at least 1.
        most: Transitions to keep of each frame, at least 1.
        ceiling: Largest cost [m].
        progress: Called with ('transitions', frames done, frames whose transitions are found).
        leading: Number of frames, from the first on, whose transitions are found; all when None.
        telling: Frames that tell which features vary most, and are summed first; all when None. Shape (F,), bool.
    """
    frames = len(features)
    leading = frames if leading is None else leading
    rows = _prepared(features, slice(None) if telling is None else telling)
    tiles = np.ascontiguousarray(rows.reshape(-1, _TILE, rows.shape[1]).transpose(0, 2, 1))
    clips = np.repeat(np.arange(len(clip_starts) - 1, dtype=np.int32), np.diff(clip_starts))
    last = np.zeros(frames, bool)
    last[np.asarray(clip_starts)[1:] - 1] = True
    feet = (contacts[:, 0] + 2 * contacts[:, 1].astype(np.uint8)).astype(np.uint8)
    block = int(np.clip(_BLOCK_BYTES // (4 * max(frames, 1)), 16, 512))
    squares = np.empty((block + 3, len(rows)), np.float32)
    minima = Minima(
        np.empty((block, frames), np.int32), np.empty((block, frames), np.float32), np.zeros(block, np.int64)
    )
    facts = Frames(clips, feet, max(near, 1))
    best_frames = np.zeros((frames, most), np.int32)
    best_squares = np.full((frames, most), np.inf, np.float32)
    # One rounding above, so that a cost of exactly the ceiling is met; the last word is the caller's comparison below.
    highest = np.float32(min(np.nextafter(np.float32(ceiling), np.float32(np.inf)).astype(float) ** 2, 1e30))
    for start in range(0, leading, block):
        stop = min(leading, start + block)
        top = max(0, start - 1)
        pairs = -(-(min(frames, stop + 1) - top) // 2)
        limit = min(highest, best_squares[:leading, -1].max())
        share(pairs, square_distances, rows, tiles, top, limit, squares, least=1)
        share(stop - start, local_minima, squares, top, start, facts, limit, minima, least=1)
        keep_cheapest(start, stop - start, minima, last, best_frames, best_squares)
        if progress is not None:
            progress("transitions", stop, leading)
    return _kept(best_frames[:leading], best_squares[:leading], ceiling)


def _kept(best_frames: Array, best_squares: Array, ceiling: float) -> Transitions:
    """Return the transitions up to a ceiling, of partners of frames and their squared distances, shapes (F, N)."""
    costs = np.sqrt(best_squares)
    kept = np.isfinite(best_squares) & (costs <= np.float32(ceiling))
    sources = np.repeat(np.arange(len(costs), dtype=np.int32), kept.sum(axis=1))
    targets = best_frames[kept] + np.int32(1)
    order = np.lexsort((targets, sources))
    return Transitions(sources[order], targets[order], costs[kept][order])


def with_images(transitions: Transitions, captured: int, frames: int) -> Transitions:
    """Return transitions out of captured frames and, after them, their mirror images.

    Args:
        transitions: The transitions; all sources are captured frames.
        captured: Number of captured frames, behind which their mirror images lie; F where there are none.
        frames: Number of all frames F.
    """
    if captured == frames:
        return transitions
    order = np.lexsort(((transitions.targets + captured) % frames, transitions.sources))
    sources, targets = transitions.sources + np.int32(captured), (transitions.targets + np.int32(captured)) % frames
    return Transitions(
        np.concatenate([transitions.sources, sources[order]]),
        np.concatenate([transitions.targets, targets[order].astype(np.int32)]),
        np.concatenate([transitions.costs, transitions.costs[order]]),
    )


def decision_frames(transitions: Transitions, worth: Array, clip_starts: Array, spacing: int) -> Array:
    """Choose the frames at which transitions may happen: at least ``spacing`` apart in a clip, of the largest worth.

    Decisions at every frame would make a body no quicker than decisions every 0.2 s, and tables three times as large
    (``benchmarks/graph.py``).

    Args:
        transitions: The transitions.
        worth: What each is worth, above 0. Shape (T,).
        clip_starts: First frame of each clip, and F. Shape (C + 1,).
        spacing: Least number of frames from one decision to the next; 1 keeps every frame.

    Returns:
        Whether each frame is chosen. Shape (F,), bool.
    """
    frames = int(clip_starts[-1])
    totals = np.bincount(transitions.sources, weights=worth, minlength=frames)
    if spacing <= 1:
        return totals > 0
    chosen = np.zeros(frames, bool)
    for start, stop in itertools.pairwise(clip_starts):
        gains = totals[start:stop].tolist()
        # best[f] is the largest worth of the first f frames: leave frame f - 1, or take it and what lies apart from it.
        best = [0.0] * (len(gains) + 1)
        for frame, gain in enumerate(gains, 1):
            best[frame] = max(best[frame - 1], best[max(0, frame - spacing)] + gain)
        frame = len(gains)
        while frame > 0:
            if best[frame] > best[frame - 1]:
                chosen[start + frame - 1] = True
                frame -= spacing
            else:
                frame -= 1
    return chosen


def _prepared(features: Array, telling: Array | slice) -> Array:
    """Return features as the kernels take them: columns that vary most first, rows and columns padded.

    Distances between frames stay, and distant ones are known as such early. Frames that pad are far from all others.
    """
    frames, depth = features.shape
    order = np.argsort(-features[telling].var(axis=0, dtype=np.float64), kind="stable")
    rows = np.zeros((-(-(frames + 1) // _TILE) * _TILE, -(-depth // 4) * 4), np.float32)
    rows[:frames, :depth] = features[:, order]
    rows[frames:] = 1e17
    return rows

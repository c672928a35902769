"""How much the avatars of a run differ: what each throws, lands, and how far it keeps from its opponents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.take.data import TakeData
from crowdsim.take.measures import AFTER, chunks_of, opponent_offsets

ENOUGH = 5.0
"""Counted time from which on an avatar is compared with others [s]."""
PERCENTILES = (10.0, 50.0, 90.0)
_BLOCK_AVATAR_FRAMES = 500_000
_SAMPLED_AVATAR_FRAMES = 2_000_000


@dataclass(frozen=True)
class Spreads:
    """The 10th, 50th and 90th percentile over avatars; None where no avatar has ``ENOUGH`` counted time.

    *Counted time* is that of ``FightMeasures``: an avatar is there, and so is its opponent, from ``after`` on.

    Attributes:
        thrown_per_minute_spread: Strikes that an avatar throws in a minute of its counted time.
        landed_per_minute_spread: Those that land.
        distance_spread: Median distance of an avatar to its opponents in its counted time [m]; of frames evenly picked
            in long runs of large crowds.
    """

    thrown_per_minute_spread: list[float] | None
    landed_per_minute_spread: list[float] | None
    distance_spread: list[float] | None


def measure_spreads(take: TakeData, after: float = AFTER) -> Spreads:
    """Return how much the avatars of a take differ, read a few frames at a time.

    Args:
        take: The take, in memory or lazily read.
        after: Time from which on avatars are compared [s].
    """
    count, begin = take.avatar_count, int(np.ceil(after * take.control_rate - 1e-6))
    every = max(1, -(-take.frame_count * count // _SAMPLED_AVATAR_FRAMES))
    step = max(1, _BLOCK_AVATAR_FRAMES // max(count, 1))
    counted = np.zeros(count, np.int64)
    owners, distances = [np.zeros(0, np.int32)], [np.zeros(0, np.float32)]
    for chunk in chunks_of(take):
        for first in range(max(begin - chunk.first, 0), chunk.frames, step):
            dx, dz, known = opponent_offsets(chunk, slice(first, min(first + step, chunk.frames)))
            counted += np.count_nonzero(known, axis=0)
            some = slice(-(chunk.first + first - begin) % every, None, every)
            owners.append(np.nonzero(known[some])[1].astype(np.int32))
            distances.append(np.hypot(dx[some], dz[some])[known[some]].astype(np.float32))
    frames, attackers = np.asarray(take.events.frame), np.asarray(take.events.attacker, np.int64)
    late, landed = frames >= begin, np.asarray(take.events.landed, bool)
    enough = counted >= ENOUGH * take.control_rate
    minutes = counted[enough] / take.control_rate / 60.0
    thrown, hits = (np.bincount(attackers[which], minlength=count)[enough] for which in (late, late & landed))
    medians = medians_of(np.concatenate(owners), np.concatenate(distances), count)[enough]
    return Spreads(_spread(thrown / minutes), _spread(hits / minutes), _spread(medians[np.isfinite(medians)]))


def medians_of(owners: Array, values: Array, count: int) -> Array:
    """Return the median of the values of each owner, NaN for one without.

    Args:
        owners: Whose each value is, less than ``count``. Shape (n,).
        values: Shape (n,).
        count: Number of owners.

    Returns:
        Array of float64 of shape (count,).
    """
    ordered = np.append(np.asarray(values, np.float64)[np.lexsort((values, owners))], np.nan)
    held = np.bincount(owners, minlength=count)
    first = np.cumsum(held) - held
    low, high = first + (held - 1) // 2, first + held // 2
    none = held == 0
    low[none] = high[none] = len(ordered) - 1
    return np.asarray(0.5 * (ordered[low] + ordered[high]))


def _spread(values: Array) -> list[float] | None:
    return [float(value) for value in np.percentile(values, PERCENTILES)] if len(values) else None

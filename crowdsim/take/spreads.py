"""How much the avatars of a run differ: what each throws, lands, and how far it keeps from its opponents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.take.measures import AFTER, OUT_OF_REACH, chunks_of, opponent_offsets

ENOUGH = 20.0
"""Time of fighting from which on an avatar is compared with others [s]."""
PERCENTILES = (10.0, 50.0, 90.0)
_BLOCK_AVATAR_FRAMES = 500_000
_SAMPLED_AVATAR_FRAMES = 2_000_000


@dataclass(frozen=True)
class Spreads:
    """The 10th, 50th and 90th percentile over avatars; None where no avatar fights for as long as ``ENOUGH``.

    An avatar *fights* while it is there and so is its opponent, no further away than ``OUT_OF_REACH``; those who wait
    for others, chase or lie do not.

    Attributes:
        thrown_per_minute_spread: Strikes that an avatar throws in a minute of fighting.
        landed_per_minute_spread: Those that land.
        distance_spread: Median distance of an avatar to its opponents while it fights [m]; of frames evenly picked in
            long runs of large crowds.
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
    fought, thrown, landed = np.zeros((3, count), np.int64)
    owners, distances = [np.zeros(0, np.int32)], [np.zeros(0, np.float32)]
    for chunk in chunks_of(take):
        # A strike belongs to the control frame in which it is noted, the next one.
        noted = np.minimum(np.ceil(np.asarray(chunk.events.frame)).astype(np.int64) - chunk.first, chunk.frames - 1)
        attackers, hits = np.asarray(chunk.events.attacker, np.int64), np.asarray(chunk.events.landed, bool)
        for first in range(max(begin - chunk.first, 0), chunk.frames, step):
            dx, dz, known = opponent_offsets(chunk, slice(first, min(first + step, chunk.frames)))
            apart = np.hypot(dx, dz)
            fights = known & (apart <= OUT_OF_REACH)
            fought += np.count_nonzero(fights, axis=0)
            own = np.flatnonzero((noted >= first) & (noted < first + len(fights)))
            own = own[fights[noted[own] - first, attackers[own]]]
            thrown += np.bincount(attackers[own], minlength=count)
            landed += np.bincount(attackers[own[hits[own]]], minlength=count)
            some = slice(-(chunk.first + first - begin) % every, None, every)
            owners.append(np.nonzero(fights[some])[1].astype(np.int32))
            distances.append(apart[some][fights[some]].astype(np.float32))
    enough = fought >= ENOUGH * take.control_rate
    minutes = fought[enough] / take.control_rate / 60.0
    medians = medians_of(np.concatenate(owners), np.concatenate(distances), count)[enough]
    return Spreads(
        _spread(thrown[enough] / minutes), _spread(landed[enough] / minutes), _spread(medians[np.isfinite(medians)])
    )


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

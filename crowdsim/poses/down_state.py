"""Avatars that are down: falling, lying or getting up. What poses add for bodies that stand leaves them alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.neighbours import near_avatars

_SOON = 0.2
"""Time before a fall in which a hit does not add a reaction to it [s]."""


def fallen_rows(
    take: TakeData, motions: Sequence[PoseMotion], first: int, stop: int, avatars: Array | None = None
) -> Array:
    """Return which avatars (n,), or all, are down at control frames ``first`` to ``stop``.

    Shape (stop - first, n), bool.
    """
    some = slice(None) if avatars is None else avatars
    action, policies = np.asarray(take.action[first:stop])[:, some], take.cast.policies[some]
    down = np.zeros(action.shape, bool)
    for index, motion in enumerate(motions):
        if motion.down.any():
            here = (action >= 0) & (policies == index)
            done = np.asarray(take.action_frame[first:stop])[:, some][here]
            down[here] = motion.down[motion.frames_at(action[here], done.astype(float))]
    return down


def near_fallen(
    take: TakeData, motions: Sequence[PoseMotion], first: int, stop: int, avatars: Array, distance: float
) -> Array:
    """Return whether avatars (n,) are nearer than a distance of no more than ``TOUCH`` to one that is down.

    They may be down themselves. At control frames ``first`` to ``stop``; positions are those on the ground. Shape
    (stop - first, n), bool.
    """
    around = near_avatars(take, avatars, first, stop)
    down = fallen_rows(take, motions, first, stop, around)
    near = np.zeros((len(down), len(avatars)), bool)
    for row in np.flatnonzero(down.any(axis=1)):
        places = np.stack([np.asarray(values[first + row], dtype=float) for values in (take.x, take.z)], axis=-1)
        here = np.flatnonzero(np.isfinite(places[avatars, 0]))
        ways = places[avatars[here], None] - places[around[down[row]]]
        near[row, here] = (np.sqrt(np.sum(ways * ways, axis=-1)) < distance).any(axis=1)
    return near


def falls_soon(take: TakeData, motions: Sequence[PoseMotion], avatars: Array, times: Array) -> Array:
    """Return whether avatars (E,) are down at times (E,) [s], or will be within ``_SOON``. Shape (E,), bool."""
    if not len(times) or not any(motion.down.any() for motion in motions):
        return np.zeros(len(times), bool)
    rate, last = take.control_rate, take.frame_count - 1
    rows = np.clip((times * rate).astype(np.int64), 0, last)
    ends = np.clip(np.ceil((times + _SOON) * rate).astype(np.int64), 0, last)
    first, stop = int(rows.min()), int(ends.max()) + 1
    some, columns = np.unique(avatars, return_inverse=True)
    down = fallen_rows(take, motions, first, stop, some)
    counts = np.concatenate([np.zeros((1, down.shape[1]), np.int64), np.cumsum(down, axis=0)])
    result: Array = counts[ends + 1 - first, columns] > counts[rows - first, columns]
    return result

"""Avatars that are down: falling, lying or getting up. What poses add for bodies that stand leaves them alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.poses.motion import PoseMotion

_SOON = 0.2
"""Time before a fall in which a hit does not add a reaction to it [s]."""


def fallen_rows(take: TakeData, motions: Sequence[PoseMotion], first: int, stop: int) -> Array:
    """Return who is down at control frames ``first`` to ``stop``. Shape (stop - first, N), bool."""
    action, done = np.asarray(take.action[first:stop]), np.asarray(take.action_frame[first:stop], dtype=float)
    down = np.zeros(action.shape, bool)
    for index, motion in enumerate(motions):
        if motion.down.any():
            here = (action >= 0) & (take.cast.policies == index)
            down[here] = motion.down[motion.frames_at(action[here], done[here])]
    return down


def near_fallen(
    take: TakeData, motions: Sequence[PoseMotion], first: int, stop: int, avatars: Array, distance: float
) -> Array:
    """Return whether avatars (n,) are nearer than a distance [m] to one that is down, itself among them.

    At control frames ``first`` to ``stop``; positions are those on the ground. Shape (stop - first, n), bool.
    """
    down = fallen_rows(take, motions, first, stop)
    near = np.zeros((len(down), len(avatars)), bool)
    places = np.stack([np.asarray(values[first:stop], dtype=float) for values in (take.x, take.z)], axis=-1)
    for row in np.flatnonzero(down.any(axis=1)):
        here = np.flatnonzero(np.isfinite(places[row, avatars, 0]))
        far, _ = cKDTree(places[row, down[row]]).query(places[row, avatars[here]])
        near[row, here] = far < distance
    return near


def falls_soon(take: TakeData, motions: Sequence[PoseMotion], avatars: Array, times: Array) -> Array:
    """Return whether avatars (E,) are down at times (E,) [s], or will be within ``_SOON``. Shape (E,), bool."""
    if not len(times) or not any(motion.down.any() for motion in motions):
        return np.zeros(len(times), bool)
    rate, last = take.control_rate, take.frame_count - 1
    rows = np.clip((times * rate).astype(np.int64), 0, last)
    ends = np.clip(np.ceil((times + _SOON) * rate).astype(np.int64), 0, last)
    first, stop = int(rows.min()), int(ends.max()) + 1
    down = fallen_rows(take, motions, first, stop)
    counts = np.concatenate([np.zeros((1, down.shape[1]), np.int64), np.cumsum(down, axis=0)])
    result: Array = counts[ends + 1 - first, avatars] > counts[rows - first, avatars]
    return result

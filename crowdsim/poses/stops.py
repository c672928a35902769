"""What stops fists that land: head and trunk of those they hit, as pictures show them, around the strike."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.contacts import PoseAt
from crowdsim.poses.hits import Landed
from crowdsim.poses.kernels.fists import MOTION
from crowdsim.poses.outlines import GIVES, upper_capsules

ENDS, RADII = slice(0, 6), slice(6, 8)
"""Columns of a stop: start and end of a capsule, and how near to it a fist may come at either end [m]."""


def find_stops(take: TakeData, near: Landed, goals: Array, stopped: Array, pose_at: PoseAt) -> Array:
    """Return the capsules that fists do not go into before and after strikes, no deeper than they are at them.

    Args:
        take: The take.
        near: Strikes.
        goals: Where fists touch [m]. Shape (E, 3).
        stopped: Whether a body stops each. Shape (E,), bool.
        pose_at: Poses avatars.

    Returns:
        ``MOTION`` seconds before strikes, at them and after them, NaN where there are fewer. Shape (E, 3, K, 8) [m].
    """
    hit = np.flatnonzero(stopped & (near.victims >= 0) & np.isfinite(goals).all(axis=1))
    times = (near.times[hit] + np.array([[-MOTION], [0.0], [MOTION]])).ravel()
    victims, found = np.tile(near.victims[hit], 3), np.zeros((len(times), 0, 8))
    for which, body, scales, positions, rotations in pose_at(victims, times):
        numbers = victims[which]
        build = scales, take.cast.girths[numbers], take.cast.stretches[numbers]
        bodies = PosedBodies(body, np.arange(len(which)), *build, positions[None], rotations[None])
        starts, axes, radii = upper_capsules(bodies)
        more = max(starts.shape[1] - found.shape[1], 0)
        found = np.pad(found, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
        own = np.arange(starts.shape[1])
        found[which[:, None], own] = np.concatenate([starts, starts + axes, radii + GIVES], axis=-1)
    stops = np.full((len(near.times), 3, found.shape[1], 8), np.nan)
    stops[hit] = found.reshape(3, len(hit), found.shape[1], 8).swapaxes(0, 1)
    # What a fist is in at the strike, it may be in before and after it.
    start, axis = stops[:, 1, :, :3], stops[:, 1, :, 3:6] - stops[:, 1, :, :3]
    way = goals[:, None] - start
    along = np.clip(np.sum(way * axis, axis=-1) / np.maximum(np.sum(axis * axis, axis=-1), 1e-12), 0.0, 1.0)
    far = np.linalg.norm(way - along[..., None] * axis, axis=-1)
    radii = stops[:, 1, :, RADII]
    depths = np.maximum(radii[..., 0] + along * (radii[..., 1] - radii[..., 0]) - far, 0.0)
    stops[..., RADII] -= depths[:, None, :, None]
    return stops

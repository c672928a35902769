"""What stops fists that land: head and trunk of those they hit, as their skin is, around the strike."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.contacts import PoseAt
from crowdsim.poses.hits import Landed
from crowdsim.poses.kernels.fists import MOTION
from crowdsim.poses.outlines import GIVES, WRIST_IN, find_surface

ENDS, RADII, WRIST = slice(0, 6), slice(6, 8), 8
"""Columns of a stop: start and end of a capsule, how near to it a fist may come at either end, and how much further
off, or nearer, the wrist behind it has to stay [m]."""


def find_stops(take: TakeData, near: Landed, goals: Array, wrists: Array, stopped: Array, pose_at: PoseAt) -> Array:
    """Return the capsules that fists do not go into before and after strikes, no deeper than they are at them.

    Args:
        take: The take.
        near: Strikes.
        goals: Where fists touch [m]. Shape (E, 3).
        wrists: Where the wrists behind them are then [m]. Shape (E, 3).
        stopped: Whether a body stops each. Shape (E,), bool.
        pose_at: Poses avatars.

    Returns:
        ``MOTION`` seconds before strikes, at them and after them, NaN where there are fewer. Shape (E, 3, K, 9) [m].
    """
    hit = np.flatnonzero(stopped & (near.victims >= 0) & np.isfinite(goals).all(axis=1))
    times = (near.times[hit] + np.array([[-MOTION], [0.0], [MOTION]])).ravel()
    victims, found = np.tile(near.victims[hit], 3), np.zeros((len(times), 0, 9))
    for which, body, scales, positions, rotations in pose_at(victims, times):
        numbers = victims[which]
        build = scales, take.cast.girths[numbers], take.cast.stretches[numbers]
        bodies = PosedBodies(body, np.arange(len(which)), *build, positions[None], rotations[None])
        starts, axes, radii = find_surface(bodies, take.cast.sexes[numbers])
        more = max(starts.shape[1] - found.shape[1], 0)
        found = np.pad(found, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
        own = np.arange(starts.shape[1])
        found[which[:, None], own, :WRIST] = np.concatenate([starts, starts + axes, radii + GIVES], axis=-1)
    stops = np.full((len(near.times), 3, found.shape[1], 9), np.nan)
    stops[hit] = found.reshape(3, len(hit), found.shape[1], 9).swapaxes(0, 1)
    # What a fist and its wrist are in at the strike, they may be in before and after it.
    start, axis, radii = stops[:, 1, :, :3], stops[:, 1, :, 3:6] - stops[:, 1, :, :3], stops[:, 1, :, RADII]
    depths = []
    for points in (goals, wrists):
        way = points[:, None] - start
        along = np.clip(np.sum(way * axis, axis=-1) / np.maximum(np.sum(axis * axis, axis=-1), 1e-12), 0.0, 1.0)
        depths.append(radii[..., 0] + along * (radii[..., 1] - radii[..., 0])
                      - np.linalg.norm(way - along[..., None] * axis, axis=-1))  # fmt: skip
    fist = np.maximum(depths[0], 0.0)
    stops[..., RADII] -= fist[:, None, :, None]
    stops[..., WRIST] = (fist - np.maximum(depths[1], GIVES + WRIST_IN))[:, None]
    return stops

"""How far trunks, heads and thighs give way to others that lean or go into them, at each control frame of a take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.body import Body
from crowdsim.take.data import TakeData
from crowdsim.take.fallen import fallen_rows
from crowdsim.take.kernels.separation import AROUND, POINTS, push_trunks
from crowdsim.take.motion import PoseMotion

_RISING = np.array([1.0, 1.0, 1.0, 1.0, 0.5, 1.0, 0.5])
"""How far points rise with the pelvis where legs are longer: head, neck, pelvis, and hip and knee of either leg."""


class Separation:
    """How far trunks give way.

    It depends on where the avatars near an avatar are in their motion and on the ground, from five control frames
    before to five after.

    Args:
        take: The take.
        motions: The motion of each of its policies.
    """

    def __init__(self, take: TakeData, motions: Sequence[PoseMotion]) -> None:
        self._take, self._motions = take, motions
        self._radii = np.zeros((take.avatar_count, 3))
        for index, motion in enumerate(motions):
            mine, body = take.cast.policies == index, motion.body
            self._radii[mine] = [body.head_radius, body.torso_radius, thigh_radius(body)]
        self._radii *= np.stack([take.cast.scales, take.cast.widths, take.cast.widths], axis=1).astype(float)

    def find(self, first: int, stop: int) -> Array:
        """Return how far trunks of all avatars give way at control frames, x and z [m]. Shape (T, N, 2), float32."""
        low, high = max(first - 1 - AROUND, 0), min(stop + 1 + AROUND, self._take.frame_count)
        pushes = np.zeros((high - low, self._take.avatar_count, 2), np.float32)
        if self._take.collision_avoidance:
            points = self._points(low, high)
            order = np.argsort(points[:, :, 2, 0], axis=1, kind="stable")
            push_trunks(points, self._radii, order, pushes)
        return _widest(pushes)[first - low : stop - low]

    def _points(self, first: int, stop: int) -> Array:
        """Heads, necks, pelvises, hips and knees in the world at control frames, NaN of who is down. (T, N, 7, 3)."""
        take = self._take
        action, done = np.asarray(take.action[first:stop]), np.asarray(take.action_frame[first:stop], dtype=float)
        place = np.stack([np.asarray(values[first:stop], dtype=float) for values in (take.x, take.z, take.heading)], -1)
        points = np.full((*action.shape, POINTS, 3), np.nan)
        for index, motion in enumerate(self._motions):
            here = (action >= 0) & (take.cast.policies == index)
            some = action[here]
            frames = motion.frames_at(some, done[here])
            sizes = np.broadcast_to(take.cast.scales, action.shape)[here]
            longer = np.broadcast_to(take.cast.legs.astype(float) - 1.0, action.shape)[here]
            local = np.concatenate([motion.trunks[frames], motion.thighs[frames].reshape(-1, 4, 3)], axis=1)
            found = local.astype(float) * sizes[:, None, None]
            found[:, :, 1] += (sizes * longer * motion.frames.reaches[frames])[:, None] * _RISING
            points[here] = ground.to_world(place[here][:, None], found)
        points[fallen_rows(take, self._motions, first, stop)] = np.nan
        return points


def thigh_radius(body: Body) -> float:
    """Return how thick a body's thighs are, on an average [m]."""
    thighs = np.isin(body.capsule_joints, [body.roles["left_hip"], body.roles["right_hip"]])
    return float(body.capsule_radii[thighs].mean())


def _widest(pushes: Array) -> Array:
    """The longest push of each frame, the one before and the one after, since what poses read is smoothed."""
    longest, length = pushes.copy(), np.sum(pushes**2, axis=-1)
    for one, other in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        further = length[other] > np.sum(longest[one] ** 2, axis=-1)
        longest[one] = np.where(further[..., None], pushes[other], longest[one])
    return longest

"""How far bodies give way to others that lean or go into them, at each control frame of a take."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.body import Body
from crowdsim.take.capsules import trunk_capsules
from crowdsim.take.data import TakeData
from crowdsim.take.fallen import fallen_rows
from crowdsim.take.kernels.bending import FOOT_LANDS
from crowdsim.take.kernels.separation import AROUND, LEG_POINT, PIECES, POINTS, push_trunks
from crowdsim.take.landed import Landed
from crowdsim.take.motion import PoseMotion

_RISING = np.array([1.0, 1.0, 1.0, 1.0, 0.5, 0.0, 1.0, 0.5, 0.0, 1.0, 1.0])
"""How far the points of a body rise with the pelvis where legs are longer."""


class Separation:
    """How far bodies give way.

    It depends on where the avatars near an avatar are in their motion and on the ground, from five control frames
    before to five after.

    Args:
        take: The take.
        motions: The motion of each of its policies.
        landed: Its strikes that land.
    """

    def __init__(self, take: TakeData, motions: Sequence[PoseMotion], landed: Landed) -> None:
        self._take, self._motions = take, motions
        self._radii = np.zeros((take.avatar_count, len(PIECES), 2))
        for index, motion in enumerate(motions):
            self._radii[take.cast.policies == index] = piece_radii(motion.body)
        self._kicks = landed.of(~landed.missed & (landed.limbs >= 2))
        self._radii[:, 0] *= np.asarray(take.cast.scales, float)[:, None]
        self._radii[:, 1:] *= np.asarray(take.cast.widths, float)[:, None, None]

    def find(self, first: int, stop: int) -> Array:
        """Return how far all avatars give way at control frames, x and z [m]. Shape (T, N, 2), float32."""
        low, high = max(first - 1 - AROUND, 0), min(stop + 1 + AROUND, self._take.frame_count)
        pushes = np.zeros((high - low, self._take.avatar_count, 2), np.float32)
        if self._take.collision_avoidance:
            points = self._points(low, high)
            order = np.argsort(points[:, :, 2, 0], axis=1, kind="stable")
            push_trunks(points, self._radii, order, pushes)
        return _widest(pushes)[first - low : stop - low]

    def _points(self, first: int, stop: int) -> Array:
        """Points of bodies in the world at control frames, NaN of who is down. (T, N, 11, 3)."""
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
            parts = motion.trunks[frames], motion.leg_joints[frames].reshape(-1, 6, 3), motion.shoulders[frames]
            local = np.concatenate(parts, axis=1)
            found = local.astype(float) * sizes[:, None, None]
            found[:, :, 1] += (sizes * longer * motion.frames.reaches[frames])[:, None] * _RISING
            points[here] = ground.to_world(place[here][:, None], found)
        points[fallen_rows(take, self._motions, first, stop)] = np.nan
        self._fold_kicking_legs(first, stop, points)
        return points

    def _fold_kicking_legs(self, first: int, stop: int, points: Array) -> None:
        """Shrink legs to their hips around the kicks that they land, so that they do not push away whom they hit."""
        rate = self._take.control_rate
        kicks = self._kicks.between(first / rate - FOOT_LANDS, stop / rate + FOOT_LANDS)
        for time, attacker, limb in zip(kicks.times, kicks.attackers, kicks.limbs, strict=True):
            low = max(math.ceil((time - FOOT_LANDS) * rate), first) - first
            high = min(math.floor((time + FOOT_LANDS) * rate) + 1, stop) - first
            hip = LEG_POINT + 3 * (limb - 2)
            leg = points[low : max(high, low), attacker, hip : hip + 3]
            leg[:, 1:] = leg[:, :1]


def piece_radii(body: Body) -> Array:
    """Return the radii of a body's ``PIECES`` at both ends [m]. Shape (7, 2)."""
    joints, radii = body.capsule_joints, body.capsule_radii
    trunk = trunk_capsules(body)
    thigh, shin = (_taper(radii[joints == body.roles[joint]]) for joint in ("left_hip", "left_knee"))
    upright, across = [radii[trunk[0], 0]] * 2, radii[trunk[-1]]
    return np.array([[body.head_radius] * 2, upright, across, thigh, thigh, shin, shin])


def _taper(radii: Array) -> list[float]:
    """Radii of a bone with such capsules at its upper and its lower end, 0 where it has none."""
    widest = float(radii.max(initial=0.0))
    return [widest, float(radii.min(initial=widest))]


def _widest(pushes: Array) -> Array:
    """The longest push of each frame, the one before and the one after, since what poses read is smoothed."""
    longest, length = pushes.copy(), np.sum(pushes**2, axis=-1)
    for one, other in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        further = length[other] > np.sum(longest[one] ** 2, axis=-1)
        longest[one] = np.where(further[..., None], pushes[other], longest[one])
    return longest

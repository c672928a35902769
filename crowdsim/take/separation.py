"""How far bodies give way to others that lean or go into them, at each control frame of a take."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.take.capsules import trunk_capsules
from crowdsim.take.data import TakeData
from crowdsim.take.down_state import fallen_rows
from crowdsim.take.hits import Landed
from crowdsim.take.kernels.bending import FOOT_LANDS
from crowdsim.take.kernels.separation import (
    AROUND,
    HEAD_POINT,
    LEG_POINT,
    NECK_POINT,
    PELVIS_POINT,
    PIECES,
    POINTS,
    SHOULDER_POINT,
    push_trunks,
)
from crowdsim.take.motion import PoseMotion

JointsAt = Callable[[int, Array, Array], tuple[Array, Array]]
"""Poses avatars (n,) of a policy, ascending, at times (T,): positions (T, n, J, 3) and rotations (T, n, J, 4)."""

FINE = 2
"""How often bodies are looked for in a control frame: heads move fast, and further with blends than in the motion."""
_POSES_AT_ONCE = 16_000


class Separation:
    """How far bodies give way.

    It depends on how the avatars near an avatar are posed, with blends alone, from five control frames before to five
    after.

    Args:
        take: The take.
        motions: The motion of each of its policies.
        landed: Its strikes that land.
        joints_at: Poses avatars with blends alone.
    """

    def __init__(self, take: TakeData, motions: Sequence[PoseMotion], landed: Landed, joints_at: JointsAt) -> None:
        self._joints_at = joints_at
        self._take, self._motions = take, motions
        self._radii = np.zeros((take.avatar_count, len(PIECES), 2))
        for index, motion in enumerate(motions):
            self._radii[take.cast.policies == index] = piece_radii(motion.body)
        self._kicks = landed.of(~landed.missed & (landed.limbs >= 2))
        self._radii[:, 0] *= np.asarray(take.cast.scales, float)[:, None]
        self._radii[:, 1:] *= np.asarray(take.cast.widths, float)[:, None, None]

    def find(self, first: int, stop: int) -> Array:
        """Return how far all avatars give way at control frames, x and z [m]. Shape (T, N, 2), float32."""
        around = 1 + AROUND // FINE
        low, high = max(first - around, 0), min(stop + around, self._take.frame_count)
        rows = np.arange(FINE * low, FINE * (high - 1) + 1)
        pushes = np.zeros((len(rows), self._take.avatar_count, 2), np.float32)
        if self._take.collision_avoidance:
            points = self._points(rows)
            order = np.argsort(points[:, :, PELVIS_POINT, 0], axis=1, kind="stable")
            push_trunks(points, self._radii, order, pushes)
        return _widest(pushes)[::FINE][first - low : stop - low]

    def _points(self, rows: Array) -> Array:
        """Points of bodies in the world, NaN of who is down, ``FINE`` times a control frame. (R, N, 11, 3)."""
        take, first, stop = self._take, int(rows[0]) // FINE, int(rows[-1]) // FINE + 1
        absent = np.asarray(take.action[first:stop]) < 0
        absent |= fallen_rows(take, self._motions, first, stop)
        absent = absent[(rows - rows[0]) // FINE] | absent[-((rows[0] - rows) // FINE)]
        points = np.full((*absent.shape, POINTS, 3), np.nan, np.float32)
        for index, motion in enumerate(self._motions):
            own = np.flatnonzero((take.cast.policies == index) & ~absent.all(axis=0))
            frames = max(1, _POSES_AT_ONCE // max(len(own), 1))
            for low in range(0, len(rows), frames):
                for at in range(0, len(own), _POSES_AT_ONCE):
                    here, some = slice(low, low + frames), own[at : at + _POSES_AT_ONCE]
                    joints = self._joints_at(index, some, rows[here] / (FINE * take.control_rate))
                    points[here, some] = body_points(motion, *joints, take.cast.scales[some])
        points[absent] = np.nan
        self._fold_kicking_legs(rows, points)
        return points

    def _fold_kicking_legs(self, rows: Array, points: Array) -> None:
        """Shrink legs to their hips around the kicks that they land, so that they do not push away whom they hit."""
        times = rows / (FINE * self._take.control_rate)
        kicks = self._kicks.between(times[0] - FOOT_LANDS, times[-1] + FOOT_LANDS)
        for time, attacker, limb in zip(kicks.times, kicks.attackers, kicks.limbs, strict=True):
            low, high = np.searchsorted(times, [time - FOOT_LANDS, time + FOOT_LANDS])
            hip = LEG_POINT + 3 * (limb - 2)
            leg = points[low:high, attacker, hip : hip + 3]
            leg[:, 1:] = leg[:, :1]


def body_points(motion: PoseMotion, positions: Array, rotations: Array, scales: Array) -> Array:
    """Points of bodies with joints (T, n, J, 3) and (T, n, J, 4), of sizes (n,). Shape (T, n, 11, 3)."""
    body, roles, sizes = motion.body, motion.body.roles, np.asarray(scales, dtype=float)[:, None]
    head, chest, across = roles["head"], roles["chest"], trunk_capsules(body)[-1]
    trunk, ends = [roles["neck"], roles["pelvis"]], [body.capsule_starts[across], body.capsule_ends[across]]
    found = np.empty((*positions.shape[:2], POINTS, 3))
    found[:, :, HEAD_POINT] = positions[:, :, head] + sizes * quaternion.rotate(rotations[:, :, head], body.head_offset)
    found[:, :, NECK_POINT:LEG_POINT] = positions[:, :, trunk]
    found[:, :, LEG_POINT:SHOULDER_POINT] = positions[:, :, motion.legs.joints.reshape(-1)]
    turned = quaternion.rotate(np.repeat(rotations[:, :, None, chest], 2, axis=2), np.stack(ends))
    found[:, :, SHOULDER_POINT:] = positions[:, :, None, chest] + sizes[..., None] * turned
    return found


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
    """The longest push of each row and of those around it, to a control frame away: poses read them smoothed."""
    longest, length = pushes.copy(), np.sum(pushes**2, axis=-1)
    for away in range(1, FINE + 1):
        for one, other in ((slice(away, None), slice(None, -away)), (slice(None, -away), slice(away, None))):
            further = length[other] > np.sum(longest[one] ** 2, axis=-1)
            longest[one] = np.where(further[..., None], pushes[other], longest[one])
    return longest

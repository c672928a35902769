"""What a trunk gives to a fist that the arm alone does not bring where it has to be: planned once for each strike.

Arms move by joints that lie above them: the lower spine, the chest, and the collar of the arm's own side. Of all ways
to turn them that bring the shoulder to the distance that the arm can do, the one with the least turns is taken. A pose
lays it over its motion by a bump over time that is longer than the arm's, so that it does not show as a jerk.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.poses.kernels.fists import JOINTS
from crowdsim.poses.kernels.leans import Reaches, lean_trunks
from crowdsim.poses.limbs import Limbs

_COMPLIANCE = (1.0, 1.0, 1.5)
"""How readily spine, chest and collar turn."""
_EASE = 0.01
"""Share of an arm's length over which it eases into its longest reach."""
_MARGIN = 0.006
"""Share of an arm's length that it keeps in hand at its strike."""
_FOLDED = math.radians(140.0)
"""Flexion beyond which no elbow is bent for it [rad]."""
_BACK = 0.3
"""Share of what a straight arm has to get shorter that the trunk gives by going back."""


class Leans(NamedTuple):
    """How trunks lean for strikes; E strikes.

    Attributes:
        rotations: Rotation vectors in the frames of the joints' parents: lower spine, chest, left and right collar
            [rad]. Shape (E, 4, 3).
        shifts: How far the pelvis goes [m]. Shape (E, 3).
    """

    rotations: Array
    shifts: Array


def leaning_joints(arms: Limbs) -> Array:
    """Return lower spine, chest, left and right collar of a body, -1 for those that it does not have. Shape (4,)."""
    lower, upper = int(arms.bends[0]), int(arms.bends[1])
    collars = [int(arms.parents[joint]) for joint in arms.joints[:, 0]]
    return np.array([lower, upper if upper != lower else -1, *(c if c not in (lower, upper) else -1 for c in collars)])


def plan_leans(
    arms: Limbs, least: float, hands: Array, shifts: Array, stretches: Array, positions: Array, world_rotations: Array
) -> Leans:
    """Find what trunks have to give for fists that are to be carried.

    Args:
        arms: The arms of their body.
        least: Least flexion of an elbow [rad].
        hands: Which hand of each strikes. Shape (E,).
        shifts: How far its fist is to go [m]. Shape (E, 3).
        stretches: How long the bones of its arms are for the size of its body. Shape (E,).
        positions: Positions of joints at the strikes [m]. Shape (E, J, 3).
        world_rotations: Their rotations in the world. Shape (E, J, 4).
    """
    rows, count, joints = np.arange(len(hands)), len(hands), leaning_joints(arms)
    mine = np.stack([np.full(count, joints[0]), np.full(count, joints[1]), joints[2 + hands]], axis=1)
    upper, middle, end = (positions[rows, arms.joints[hands, k]].astype(float) for k in range(3))
    # What hangs on each joint up to the next one, from the root to the shoulder; a joint that is missing holds still.
    corners = np.where((mine >= 0)[..., None], positions[rows[:, None], mine], upper[:, None]).astype(float)
    corners[:, 1] = np.where((mine[:, 1] >= 0)[:, None], corners[:, 1], corners[:, 2])
    levers = np.diff(np.concatenate([corners, upper[:, None]], axis=1), axis=1)
    fists = quaternion.rotate(world_rotations[rows, arms.joints[hands, 2]].astype(float), arms.points[hands, 0])
    size = np.linalg.norm(end - middle, axis=1) / np.linalg.norm(arms.offsets[arms.joints[hands, 2]], axis=1)
    fists *= (size / stretches)[:, None]
    a, b = np.linalg.norm(middle - upper, axis=1), np.linalg.norm(end - middle, axis=1)
    longest = np.sqrt(a * a + b * b + 2.0 * a * b * math.cos(least)) - _MARGIN * (a + b)
    now = np.linalg.norm(end - upper, axis=1)
    shortest = np.minimum(now, np.sqrt(a * a + b * b + 2.0 * a * b * math.cos(_FOLDED)))
    goals = np.maximum(_goal(now, np.linalg.norm(end + shifts - upper, axis=1), longest, _EASE * (a + b)), shortest)
    compliance = np.where(mine >= 0, np.asarray(_COMPLIANCE), 0.0)
    reaches = Reaches(np.ascontiguousarray(corners[:, 0]), levers, fists, end + fists + shifts, goals, compliance)
    turns, moves = np.empty((count, 3, 3)), np.empty((count, 3))
    lean_trunks(0, count, reaches, turns, moves)
    parents = np.asarray(arms.parents)[np.maximum(mine, 0)]
    frames = world_rotations[rows[:, None], np.maximum(parents, 0)].astype(float)
    local = quaternion.rotate(quaternion.conjugate(frames), turns)
    result = np.zeros((count, JOINTS, 3))
    result[:, :2] = local[:, :2]
    result[rows, 2 + hands] = local[:, 2]
    return Leans(result, moves)


def _goal(now: Array, wanted: Array, longest: Array, soft: Array) -> Array:
    """How long arms get (E,), that are ``now`` long, where ``wanted`` would bring fists to their place [m]."""
    room = np.maximum(longest - now, soft)
    out = np.minimum(now + room * np.tanh(np.maximum(wanted - now, 0.0) / room), np.maximum(longest, now))
    # A straight arm that has to get shorter would throw its elbow out.
    straight = np.clip((now / longest - 0.85) / 0.15, 0.0, 1.0)
    straight = straight**3 * (10.0 - straight * (15.0 - 6.0 * straight))
    return np.where(wanted > now, out, wanted + _BACK * straight * (now - wanted))

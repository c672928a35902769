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


class Trunks(NamedTuple):
    """Arms that strike, and the joints that carry them, before any of this; E strikes.

    Attributes:
        corners: Positions of lower spine, chest and collar [m]; a joint that is missing is where the next one is. Shape
            (E, 3, 3).
        arms: Positions of shoulder, elbow and wrist [m]. Shape (E, 3, 3).
        fists: From the wrist to the fist [m]. Shape (E, 3).
        frames: Rotations of the parents of lower spine, chest and collar in the world. Shape (E, 3, 4).
        compliance: How readily these turn; 0 for those that are missing. Shape (E, 3).
    """

    corners: Array
    arms: Array
    fists: Array
    frames: Array
    compliance: Array

    def of(self, some: Array) -> Trunks:
        """Return some of them."""
        return Trunks(*(values[some] for values in self))


class Leans(NamedTuple):
    """How trunks lean for strikes; E strikes.

    Attributes:
        turns: Rotation vectors in the world: lower spine, chest, collar of the arm [rad]. Shape (E, 3, 3).
        shifts: How far the pelvis goes [m]. Shape (E, 3).
    """

    turns: Array
    shifts: Array

    def rotations(self, trunks: Trunks, hands: Array) -> Array:
        """Return rotation vectors in the frames of parents: lower spine, chest, both collars [rad]. Shape (E, 4, 3)."""
        local = quaternion.rotate(quaternion.conjugate(trunks.frames), self.turns)
        result = np.zeros((len(hands), JOINTS, 3))
        result[:, :2] = local[:, :2]
        result[np.arange(len(hands)), 2 + hands] = local[:, 2]
        return result

    def carry(self, trunks: Trunks) -> tuple[Array, Array]:
        """Return where shoulder, elbow and wrist get (E, 3, 3) [m], and how all that hangs there turns (E, 4)."""
        spins = quaternion.from_rotation_vector(self.turns)
        points, whole = trunks.arms, np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(spins), 4))
        for joint in (2, 1, 0):
            corner, spin = trunks.corners[:, joint, None], spins[:, joint]
            points = corner + quaternion.rotate(spin[:, None], points - corner)
            whole = quaternion.multiply(spin, whole)
        return points + self.shifts[:, None], whole


def leaning_joints(arms: Limbs) -> Array:
    """Return lower spine, chest, left and right collar of a body, -1 for those that it does not have. Shape (4,)."""
    lower, upper = int(arms.bends[0]), int(arms.bends[1])
    collars = [int(arms.parents[joint]) for joint in arms.joints[:, 0]]
    return np.array([lower, upper if upper != lower else -1, *(c if c not in (lower, upper) else -1 for c in collars)])


def find_trunks(arms: Limbs, hands: Array, stretches: Array, positions: Array, world_rotations: Array) -> Trunks:
    """Return arms that strike and what carries them.

    Args:
        arms: The arms of their body.
        hands: Which hand of each strikes. Shape (E,).
        stretches: How long the bones of its arms are for the size of its body. Shape (E,).
        positions: Positions of joints at the strikes [m]. Shape (E, J, 3).
        world_rotations: Their rotations in the world. Shape (E, J, 4).
    """
    rows, joints = np.arange(len(hands)), leaning_joints(arms)
    mine = np.stack([np.full(len(hands), joints[0]), np.full(len(hands), joints[1]), joints[2 + hands]], axis=1)
    limbs = positions[rows[:, None], arms.joints[hands]].astype(float)
    upper, middle, end = limbs.swapaxes(0, 1)
    # What hangs on each joint up to the next one, from the root to the shoulder; a joint that is missing holds still.
    corners = np.where((mine >= 0)[..., None], positions[rows[:, None], mine], upper[:, None]).astype(float)
    corners[:, 1] = np.where((mine[:, 1] >= 0)[:, None], corners[:, 1], corners[:, 2])
    fists = quaternion.rotate(world_rotations[rows, arms.joints[hands, 2]].astype(float), arms.points[hands, 0])
    size = np.linalg.norm(end - middle, axis=1) / np.linalg.norm(arms.offsets[arms.joints[hands, 2]], axis=1)
    fists *= (size / stretches)[:, None]
    parents = np.asarray(arms.parents)[np.maximum(mine, 0)]
    frames = world_rotations[rows[:, None], np.maximum(parents, 0)].astype(float)
    return Trunks(corners, limbs, fists, frames, np.where(mine >= 0, np.asarray(_COMPLIANCE), 0.0))


def plan_leans(trunks: Trunks, least: float, shifts: Array) -> Leans:
    """Find what trunks have to give for fists that are to be carried.

    Args:
        trunks: Arms that strike and what carries them.
        least: Least flexion of an elbow [rad].
        shifts: How far each fist is to go [m]. Shape (E, 3).
    """
    upper, middle, end = trunks.arms.swapaxes(0, 1)
    levers = np.diff(np.concatenate([trunks.corners, upper[:, None]], axis=1), axis=1)
    a, b = np.linalg.norm(middle - upper, axis=1), np.linalg.norm(end - middle, axis=1)
    longest = np.sqrt(a * a + b * b + 2.0 * a * b * math.cos(least)) - _MARGIN * (a + b)
    now = np.linalg.norm(end - upper, axis=1)
    shortest = np.minimum(now, np.sqrt(a * a + b * b + 2.0 * a * b * math.cos(_FOLDED)))
    goals = np.maximum(_goal(now, np.linalg.norm(end + shifts - upper, axis=1), longest, _EASE * (a + b)), shortest)
    targets = end + trunks.fists + shifts
    reaches = Reaches(np.ascontiguousarray(trunks.corners[:, 0]), levers, trunks.fists, targets, goals,
                      trunks.compliance)  # fmt: skip
    leans = Leans(np.empty((len(end), 3, 3)), np.empty((len(end), 3)))
    lean_trunks(0, len(end), reaches, *leans)
    return leans


def _goal(now: Array, wanted: Array, longest: Array, soft: Array) -> Array:
    """How long arms get (E,), that are ``now`` long, where ``wanted`` would bring fists to their place [m]."""
    room = np.maximum(longest - now, soft)
    out = np.minimum(now + room * np.tanh(np.maximum(wanted - now, 0.0) / room), np.maximum(longest, now))
    # A straight arm that has to get shorter would throw its elbow out.
    straight = np.clip((now / longest - 0.85) / 0.15, 0.0, 1.0)
    straight = straight**3 * (10.0 - straight * (15.0 - 6.0 * straight))
    return np.where(wanted > now, out, wanted + _BACK * straight * (now - wanted))

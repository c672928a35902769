"""What actions do, in a word: strike, step, turn or stay, by which maps of best actions are coloured."""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.policy.actions import Actions

STILL, SMALL_TURN = 0.08, math.radians(15.0)
"""An action that travels less [m] and rotates less [rad] stays."""
TURN_REACH = 0.5
"""Distance that a rotation by a radian counts as [m]: the greater of rotation and distance names the action."""


class MotionKind(IntEnum):
    """A kind of motion."""

    STAY = 0
    STEP_FORWARD = 1
    STEP_BACK = 2
    STEP_LEFT = 3
    STEP_RIGHT = 4
    TURN_LEFT = 5
    TURN_RIGHT = 6
    STRIKE_LEFT = 7
    STRIKE_RIGHT = 8

    @property
    def words(self) -> str:
        """The kind in words."""
        return self.name.lower().replace("_", " ")


def motion_kinds(actions: Actions, strike_limbs: ArrayLike) -> Array:
    """Return the kind of every action. Values of ``MotionKind``. Shape (A,), uint8.

    An action with a strike is one of its first strike's side, by the limbs of the database's strikes (S,). Others are
    named by where they lead: ahead, back or to a side, whichever of the four directions is nearest, unless they rotate
    more than they travel or do neither.
    """
    across, ahead, turn = np.asarray(actions.displacements, float).T
    distance = np.hypot(across, ahead)
    kinds = np.where(across >= 0.0, MotionKind.STEP_LEFT, MotionKind.STEP_RIGHT)
    straight = np.abs(ahead) >= np.abs(across)
    kinds = np.where(straight, np.where(ahead >= 0.0, MotionKind.STEP_FORWARD, MotionKind.STEP_BACK), kinds)
    turns = np.abs(turn) * TURN_REACH > distance
    kinds = np.where(turns, np.where(turn >= 0.0, MotionKind.TURN_LEFT, MotionKind.TURN_RIGHT), kinds)
    kinds = np.where((distance < STILL) & (np.abs(turn) < SMALL_TURN), MotionKind.STAY, kinds)
    first, end = actions.strike_offsets[:-1], actions.strike_offsets[1:]
    strikes = np.flatnonzero(end > first)
    limbs = np.asarray(strike_limbs)[actions.strike_ids[first[strikes]]]
    kinds[strikes] = np.where(limbs % 2 == 0, MotionKind.STRIKE_LEFT, MotionKind.STRIKE_RIGHT)
    return kinds.astype(np.uint8)

"""Recipes of the punches: which parts of the body join in, when and how much.

Phases: 0 is when the fist sets off, 1 when it hits, 2 when it is back. Hips go before the trunk, the trunk before the
shoulder, the shoulder before the arm.
"""

from __future__ import annotations

from dataclasses import dataclass

from crowdsim.motion.performer_score import LEAD, REAR, Channel

C = Channel


@dataclass(frozen=True)
class Part:
    """A part that one channel plays in a move, in phases of the move."""

    channel: Channel
    size: float
    start: float
    peak: float
    fall: float
    end: float
    skew: float = 1.0


@dataclass(frozen=True)
class Recipe:
    """A kind of punch by one hand.

    Attributes:
        hand: LEAD or REAR.
        parts: What the body does.
        bearing: Middle and spread of the target's bearing in the stance frame [rad].
        distance: Least and greatest distance of the target from the pelvis over the ground [m].
        height: Least and greatest height of a target at the head [m].
        body_height: Least and greatest height of a target at the body [m].
        travel: Rough length of the fist's way out [m], by which a speed becomes a duration.
        skew: How late the fist is fastest.
    """

    hand: int
    parts: tuple[Part, ...]
    bearing: tuple[float, float]
    distance: tuple[float, float]
    height: tuple[float, float]
    body_height: tuple[float, float]
    travel: float
    skew: float


JAB = Recipe(
    hand=LEAD,
    parts=(
        Part(C.PELVIS_TURN, -0.14, -0.15, 0.75, 1.1, 2.1),
        Part(C.SHIFT_Z, 0.05, -0.2, 0.9, 1.1, 2.3),
        Part(C.SHIFT_X, 0.02, -0.2, 0.9, 1.1, 2.3),
        Part(C.HEIGHT, -0.015, -0.2, 0.9, 1.1, 2.2),
        Part(C.TWIST, -0.24, 0.0, 0.88, 1.1, 2.1),
        Part(C.FLEX, 0.07, 0.0, 1.0, 1.1, 2.2),
        Part(C.BEND, -0.05, 0.0, 1.0, 1.1, 2.2),
        Part(C.LEAD_FORTH, 0.28, 0.15, 1.0, 1.05, 1.9),
        Part(C.LEAD_RAISE, 0.24, 0.15, 1.0, 1.05, 1.9),
        Part(C.LEAD_ELBOW, 0.45, 0.35, 1.0, 1.05, 1.9),
        Part(C.LEAD_ROLL, 1.0, 0.4, 1.0, 1.05, 1.8),
        Part(C.REAR_HEEL, 0.14, -0.1, 0.9, 1.1, 2.0),
        Part(C.HEAD_NOD, 0.06, 0.0, 1.0, 1.1, 2.1),
        Part(C.REAR_HAND_Y, 0.015, 0.0, 0.9, 1.1, 2.0),
        Part(C.REAR_HAND_X, 0.015, 0.0, 0.9, 1.1, 2.0),
    ),
    bearing=(0.0, 0.22),
    distance=(0.62, 0.95),
    height=(1.3, 1.6),
    body_height=(0.95, 1.2),
    travel=0.55,
    skew=1.2,
)

STRAIGHT = Recipe(
    hand=REAR,
    parts=(
        Part(C.REAR_HEEL, 0.55, -0.2, 0.85, 1.1, 2.1),
        Part(C.REAR_YAW, 0.6, -0.2, 0.85, 1.15, 2.2),
        Part(C.PELVIS_TURN, 0.6, -0.2, 0.8, 1.1, 2.15),
        Part(C.SHIFT_Z, 0.09, -0.25, 0.9, 1.15, 2.3),
        Part(C.SHIFT_X, 0.05, -0.25, 0.9, 1.15, 2.3),
        Part(C.HEIGHT, -0.02, -0.2, 0.8, 1.1, 2.2),
        Part(C.TWIST, 0.42, 0.0, 0.92, 1.1, 2.1),
        Part(C.FLEX, 0.12, 0.0, 1.0, 1.1, 2.2),
        Part(C.BEND, 0.06, 0.0, 1.0, 1.1, 2.2),
        Part(C.REAR_FORTH, 0.32, 0.2, 1.0, 1.05, 1.9),
        Part(C.REAR_RAISE, 0.26, 0.2, 1.0, 1.05, 1.9),
        Part(C.REAR_ELBOW, 0.45, 0.35, 1.0, 1.05, 1.9),
        Part(C.REAR_ROLL, 1.0, 0.4, 1.0, 1.05, 1.8),
        Part(C.HEAD_NOD, 0.06, 0.0, 1.0, 1.1, 2.1),
        Part(C.LEAD_HAND_X, -0.05, 0.0, 0.9, 1.1, 2.0),
        Part(C.LEAD_HAND_Y, 0.03, 0.0, 0.9, 1.1, 2.0),
        Part(C.LEAD_HAND_Z, -0.10, 0.0, 0.9, 1.1, 2.0),
    ),
    bearing=(0.05, 0.22),
    distance=(0.62, 1.0),
    height=(1.3, 1.6),
    body_height=(0.95, 1.2),
    travel=0.75,
    skew=1.25,
)

RECIPES = {"jab": JAB, "straight": STRAIGHT}

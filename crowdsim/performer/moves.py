"""What moves are made of, and the tables of all punches and defences.

Punches are driven from the ground: the foot and the hip go first, then the trunk, the shoulder, and last the arm. Of
defences some take the head off the line by knees and spine, and in the others arms take the blow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.performer.score import LEAD, REAR, Accent, Channel


def part(start: float, peak: float, fall: float, end: float, **sizes: float) -> tuple[Accent, ...]:
    """Return accents of channels, given by name with their sizes, that share their times."""
    return tuple(Accent(Channel[name], size, (start, peak, fall, end)) for name, size in sizes.items())


@dataclass(frozen=True)
class Punch:
    """A kind of punch.

    Attributes:
        hand: LEAD or REAR.
        bearing: Middle and spread of the target's bearing in the stance frame [rad].
        distance: Least and greatest distance of the target from the pelvis over the ground [m].
        head: Least and greatest height of a target at the head [m].
        body: Least and greatest height of a target at the body [m].
        speed: Middle and spread of the fist's highest speed relative to the pelvis [m/s].
        extra: Length of the path out beyond the straight line from guard to target [m].
        skew: How late the fist is fastest.
        early: How long before phase 0 the arm begins to unfold, as a share of the path out.
        parts: What the body does.
        inside: Least distance at close quarters, where the trunk leans back from the target [m].
    """

    hand: int
    bearing: tuple[float, float]
    distance: tuple[float, float]
    head: tuple[float, float]
    body: tuple[float, float]
    speed: tuple[float, float]
    extra: float
    skew: float
    early: float
    parts: tuple[Accent, ...]
    inside: float = np.inf


@dataclass(frozen=True)
class Defence:
    """A kind of defence: how long it takes to its height, there, and back [s], and what the body does."""

    seconds: tuple[float, float, float]
    parts: tuple[Accent, ...]


def _joined(*parts: tuple[Accent, ...]) -> tuple[Accent, ...]:
    return tuple(one for group in parts for one in group)


# Every accent draws random numbers in its turn: accents in another order are another boxer.
# fmt: off
PUNCHES = {
    "jab": Punch(
        LEAD, bearing=(0.02, 0.24), distance=(0.82, 1.08), head=(1.30, 1.62), body=(0.95, 1.20),
        speed=(6.60, 0.90), extra=0.08, skew=1.00, early=0.00, parts=_joined(
            part(-0.30,  0.80,  1.10,  2.10, REAR_HEEL=0.16),    part(-0.70,  0.72,  1.10,  2.20, PELVIS_TURN=-0.15),
            part(-1.20,  0.90,  1.15,  2.40, SHIFT_Z=0.026, SHIFT_X=0.01),
            part(-0.30,  0.90,  1.10,  2.30, HEIGHT=-0.015),     part(-0.25,  0.88,  1.08,  2.10, TWIST=-0.25),
            part(-0.10,  0.95,  1.10,  2.30, FLEX=0.06),         part( 0.00,  0.95,  1.10,  2.20, BEND=-0.05),
            part( 0.12,  0.98,  1.05,  1.90, LEAD_FORTH=0.30, LEAD_RAISE=0.26),
            part( 0.30,  1.00,  1.05,  1.90, LEAD_ELBOW=0.50),   part( 0.40,  1.00,  1.05,  1.80, LEAD_ROLL=1.05),
            part( 0.00,  0.95,  1.10,  2.20, HEAD_NOD=0.05),
            part( 0.00,  0.90,  1.10,  2.00, REAR_HAND_Y=0.012, REAR_HAND_X=0.015),
        )),
    "straight": Punch(
        REAR, bearing=(0.04, 0.24), distance=(0.80, 1.12), head=(1.30, 1.62), body=(0.95, 1.20),
        speed=(7.80, 1.10), extra=0.20, skew=1.00, early=0.00, parts=_joined(
            part(-0.90,  0.80,  1.12,  2.20, REAR_HEEL=0.36),    part(-0.85,  0.85,  1.15,  2.30, REAR_YAW=0.62),
            part(-0.80,  0.76,  1.10,  2.20, PELVIS_TURN=0.55),
            part(-1.20,  0.90,  1.15,  2.40, SHIFT_Z=0.048, SHIFT_X=0.026),
            part(-0.30,  0.85,  1.10,  2.30, HEIGHT=-0.03),      part(-0.30,  0.90,  1.08,  2.15, TWIST=0.42),
            part(-0.10,  0.95,  1.10,  2.30, FLEX=0.12),         part(-0.10,  0.95,  1.10,  2.20, BEND=0.07),
            part( 0.18,  0.98,  1.05,  1.90, REAR_FORTH=0.34, REAR_RAISE=0.28),
            part( 0.30,  1.00,  1.05,  1.90, REAR_ELBOW=0.50),   part( 0.40,  1.00,  1.05,  1.80, REAR_ROLL=1.05),
            part( 0.00,  0.95,  1.10,  2.20, HEAD_NOD=0.05),
            part( 0.00,  0.90,  1.10,  2.00, LEAD_HAND_X=-0.09, LEAD_HAND_Y=0.03, LEAD_HAND_Z=-0.10),
        )),
    "lead_hook": Punch(
        LEAD, bearing=(0.08, 0.28), distance=(0.64, 0.86), head=(1.28, 1.60), body=(0.95, 1.20),
        speed=(8.20, 1.20), extra=0.52, skew=1.15, early=0.05, inside=0.40, parts=_joined(
            part(-0.70,  0.85,  1.15,  2.30, LEAD_HEEL=0.42),    part(-0.70,  0.95,  1.25,  2.50, LEAD_YAW=-0.62),
            part(-1.40, -0.50, -0.45,  0.40, PELVIS_TURN=0.09),  part(-0.60,  1.00,  1.15,  2.30, PELVIS_TURN=-0.44),
            part(-0.80,  0.10,  0.30,  1.20, SHIFT_Z=0.026),     part(-0.80,  0.10,  0.30,  1.30, SHIFT_X=0.021),
            part( 0.20,  1.00,  1.20,  2.30, SHIFT_Z=-0.016),    part(-0.80,  0.10,  0.40,  1.60, HEIGHT=-0.035),
            part(-1.30, -0.20, -0.15,  0.60, TWIST=0.16),        part(-0.10,  1.12,  1.15,  2.20, TWIST=-0.42),
            part(-0.60,  0.40,  1.10,  2.20, FLEX=0.06),         part(-0.80,  0.20,  0.40,  1.40, BEND=0.08),
            part( 0.40,  1.05,  1.20,  2.20, BEND=-0.05),        part( 0.25,  1.00,  1.10,  2.00, LEAD_FORTH=0.22),
            part(-0.10,  0.80,  1.10,  2.00, LEAD_RAISE=0.30),   part(-0.90,  0.50,  1.12,  2.00, LEAD_ELBOW=1.32),
            part( 0.00,  0.80,  1.10,  2.00, LEAD_ROLL=-0.25),   part(-0.60,  0.20,  0.30,  1.00, LEAD_HAND_Y=-0.03),
            part(-0.80,  0.10,  0.20,  0.90, LEAD_HAND_Z=0.04),  part(-0.95,  0.38,  0.38,  1.06, LEAD_ARC=0.84),
            part( 0.50,  1.18,  1.20,  1.90, LEAD_ARC=-0.30),    part( 0.00,  0.95,  1.10,  2.20, HEAD_NOD=0.05),
            part( 0.00,  0.90,  1.10,  2.00, REAR_HAND_Y=0.02, REAR_HAND_X=0.02),
        )),
    "rear_hook": Punch(
        REAR, bearing=(-0.02, 0.28), distance=(0.60, 0.86), head=(1.28, 1.60), body=(0.95, 1.20),
        speed=(8.60, 1.20), extra=0.58, skew=1.20, early=0.05, inside=0.40, parts=_joined(
            part(-0.90,  0.82,  1.15,  2.30, REAR_HEEL=0.38),    part(-0.85,  0.90,  1.20,  2.40, REAR_YAW=0.70),
            part(-1.40, -0.60, -0.55,  0.30, PELVIS_TURN=-0.06), part(-0.75,  0.98,  1.15,  2.30, PELVIS_TURN=0.64),
            part(-1.20,  0.90,  1.15,  2.40, SHIFT_Z=0.037, SHIFT_X=0.031),
            part(-0.50,  0.50,  1.00,  2.20, HEIGHT=-0.04),      part(-1.30, -0.25, -0.20,  0.50, TWIST=-0.10),
            part(-0.15,  1.12,  1.15,  2.20, TWIST=0.52),        part(-0.30,  0.80,  1.10,  2.30, FLEX=0.10),
            part(-0.10,  0.95,  1.10,  2.20, BEND=0.09),         part( 0.25,  1.00,  1.10,  2.00, REAR_FORTH=0.26),
            part(-0.10,  0.85,  1.10,  2.00, REAR_RAISE=0.28),   part(-0.90,  0.52,  1.12,  2.00, REAR_ELBOW=1.24),
            part( 0.00,  0.80,  1.10,  2.00, REAR_ROLL=0.10),    part(-0.95,  0.36,  0.36,  1.04, REAR_ARC=-0.78),
            part( 0.50,  1.18,  1.20,  1.90, REAR_ARC=0.30),     part( 0.00,  0.95,  1.10,  2.20, HEAD_NOD=0.05),
            part( 0.00,  0.90,  1.10,  2.00, LEAD_HAND_X=-0.09, LEAD_HAND_Y=0.03, LEAD_HAND_Z=-0.10),
        )),
    "lead_uppercut": Punch(
        LEAD, bearing=(0.04, 0.20), distance=(0.60, 0.79), head=(1.32, 1.57), body=(1.00, 1.22),
        speed=(6.80, 0.90), extra=0.22, skew=1.10, early=0.15, inside=0.33, parts=_joined(
            part( 0.05,  0.95,  1.15,  2.20, LEAD_HEEL=0.28),    part( 0.00,  0.95,  1.20,  2.30, LEAD_YAW=-0.30),
            part(-1.80, -0.50, -0.45,  0.95, HEIGHT=-0.065),     part(-0.20,  0.98,  1.15,  2.20, HEIGHT=0.02),
            part(-1.30, -0.05,  0.00,  0.80, PELVIS_TURN=0.11),  part(-0.40,  0.85,  1.15,  2.20, PELVIS_TURN=-0.28),
            part(-1.30,  0.00,  0.40,  1.60, SHIFT_X=0.026),     part(-0.90,  0.30,  0.90,  2.20, SHIFT_Z=0.026),
            part(-1.30,  0.00,  0.10,  1.10, BEND=0.17),         part(-1.30,  0.00,  0.05,  0.80, TWIST=0.14),
            part(-0.15,  0.96,  1.12,  2.20, TWIST=-0.28),       part(-1.30,  0.00,  0.10,  0.95, FLEX=0.13),
            part( 0.25,  1.00,  1.15,  2.20, FLEX=-0.07),        part(-1.20,  0.05,  0.15,  0.95, LEAD_HAND_Y=-0.20),
            part(-1.20,  0.00,  0.05,  0.70, LEAD_HAND_Z=-0.08), part(-0.30,  0.48,  0.50,  1.15, LEAD_SWING_Y=-0.15),
            part( 0.10,  0.60,  0.60,  1.20, LEAD_SWING_Z=0.03), part( 0.60,  1.20,  1.24,  2.00, LEAD_SWING_Y=0.10),
            part( 0.20,  1.00,  1.10,  1.90, LEAD_FORTH=0.20),   part(-1.20,  0.00,  0.10,  0.80, LEAD_RAISE=-0.06),
            part( 0.20,  1.00,  1.10,  1.90, LEAD_RAISE=0.22),   part(-0.80,  0.20,  1.05,  1.90, LEAD_ELBOW=-0.18),
            part(-0.80,  0.55,  1.10,  1.90, LEAD_ROLL=-1.35),   part(-0.50,  0.40,  1.00,  2.00, HEAD_NOD=0.06),
            part( 0.00,  0.90,  1.10,  2.00, REAR_HAND_Y=0.02),
        )),
    "rear_uppercut": Punch(
        REAR, bearing=(0.02, 0.20), distance=(0.60, 0.82), head=(1.32, 1.57), body=(1.00, 1.22),
        speed=(7.20, 0.90), extra=0.30, skew=1.10, early=0.15, inside=0.33, parts=_joined(
            part(-0.70,  0.85,  1.15,  2.20, REAR_HEEL=0.36),    part(-0.65,  0.90,  1.20,  2.30, REAR_YAW=0.55),
            part(-1.80, -0.50, -0.45,  0.95, HEIGHT=-0.07),      part(-0.20,  0.98,  1.15,  2.20, HEIGHT=0.015),
            part(-1.30, -0.10, -0.05,  0.60, PELVIS_TURN=-0.06), part(-0.60,  0.84,  1.15,  2.20, PELVIS_TURN=0.53),
            part(-1.30, -0.05,  0.00,  0.90, SHIFT_X=-0.016),    part( 0.00,  0.95,  1.15,  2.30, SHIFT_X=0.021),
            part(-0.20,  0.90,  1.15,  2.30, SHIFT_Z=0.043),     part(-1.30,  0.00,  0.10,  1.10, BEND=-0.15),
            part(-1.30,  0.00,  0.05,  0.80, TWIST=-0.08),       part(-0.20,  0.94,  1.12,  2.20, TWIST=0.38),
            part(-1.30,  0.00,  0.10,  1.10, FLEX=0.14),         part(-1.20,  0.05,  0.15,  0.95, REAR_HAND_Y=-0.20),
            part(-1.20,  0.00,  0.05,  0.70, REAR_HAND_Z=-0.08), part(-0.30,  0.48,  0.50,  1.15, REAR_SWING_Y=-0.15),
            part( 0.10,  0.60,  0.60,  1.20, REAR_SWING_Z=0.03), part( 0.60,  1.20,  1.24,  2.00, REAR_SWING_Y=0.10),
            part( 0.20,  1.00,  1.10,  1.90, REAR_FORTH=0.24),   part(-1.20,  0.00,  0.10,  0.80, REAR_RAISE=-0.06),
            part( 0.20,  1.00,  1.10,  1.90, REAR_RAISE=0.22),   part(-0.80,  0.20,  1.05,  1.90, REAR_ELBOW=-0.20),
            part(-0.80,  0.55,  1.10,  1.90, REAR_ROLL=-1.35),   part(-0.50,  0.40,  1.00,  2.00, HEAD_NOD=0.06),
            part( 0.00,  0.90,  1.10,  2.00, LEAD_HAND_X=-0.09, LEAD_HAND_Z=-0.09),
        )),
}

DEFENCES = {
    "duck": Defence((0.38, 0.10, 0.46), _joined(
        part( 0.00,  0.95,  1.00,  2.00, HEIGHT=-0.235, PELVIS_TILT=0.18),
        part( 0.05,  1.00,  1.00,  1.90, FLEX=0.34),         part( 0.00,  0.90,  1.00,  2.00, SHIFT_Z=-0.03),
        part( 0.00,  0.95,  1.00,  2.00, REAR_HEEL=0.42),    part( 0.10,  0.95,  1.00,  2.00, LEAD_HEEL=0.10),
        part( 0.10,  0.90,  1.00,  2.00, HEAD_NOD=-0.06),
        part( 0.00,  0.80,  1.00,  2.00, LEAD_HAND_Y=0.05, LEAD_HAND_Z=-0.10, REAR_HAND_Y=0.03, LEAD_RAISE=0.12,
                                         REAR_RAISE=0.12),
    )),
    "slip_left": Defence((0.24, 0.06, 0.30), _joined(
        part(-0.10,  0.90,  1.00,  2.00, HEIGHT=-0.075),
        part(-0.10,  0.95,  1.00,  2.00, SHIFT_X=0.06, SHIFT_Z=0.04),
        part(-0.10,  0.90,  1.00,  2.00, PELVIS_TURN=0.20),
        part( 0.00,  0.90,  1.00,  2.00, PELVIS_BEND=0.06, REAR_HEEL=0.20),
        part( 0.00,  0.95,  1.05,  2.10, REAR_YAW=0.20),     part( 0.00,  1.00,  1.00,  2.00, TWIST=0.26),
        part( 0.00,  1.00,  1.00,  1.95, BEND=0.42),         part( 0.00,  1.00,  1.00,  2.00, FLEX=0.15),
        part( 0.10,  1.00,  1.00,  2.00, HEAD_BEND=0.06),
        part( 0.00,  0.90,  1.00,  2.00, LEAD_HAND_Z=-0.07, LEAD_HAND_Y=0.03),
    )),
    "slip_right": Defence((0.24, 0.06, 0.30), _joined(
        part(-0.10,  0.90,  1.00,  2.00, HEIGHT=-0.075),
        part(-0.10,  0.95,  1.00,  2.00, SHIFT_X=-0.06, SHIFT_Z=-0.02),
        part(-0.10,  0.90,  1.00,  2.00, PELVIS_TURN=-0.14),
        part( 0.00,  0.90,  1.00,  2.00, PELVIS_BEND=-0.06, LEAD_HEEL=0.12),
        part( 0.00,  0.95,  1.05,  2.10, LEAD_YAW=-0.12),    part( 0.00,  1.00,  1.00,  2.00, TWIST=-0.22),
        part( 0.00,  1.00,  1.00,  1.95, BEND=-0.44),        part( 0.00,  1.00,  1.00,  2.00, FLEX=0.16),
        part( 0.10,  1.00,  1.00,  2.00, HEAD_BEND=-0.06),
        part( 0.00,  0.90,  1.00,  2.00, REAR_HAND_Y=0.03, LEAD_HAND_Z=-0.05),
    )),
    "lean_back": Defence((0.28, 0.08, 0.34), _joined(
        part(-0.10,  0.90,  1.00,  2.10, SHIFT_Z=-0.12, SHIFT_X=-0.03),
        part(-0.05,  0.90,  1.00,  2.00, HEIGHT=-0.045),     part(-0.05,  0.80,  1.05,  2.10, REAR_HEEL=-0.22),
        part( 0.00,  0.90,  1.00,  2.00, PELVIS_TILT=-0.16, PELVIS_TURN=-0.12),
        part( 0.05,  1.00,  1.00,  1.95, FLEX=-0.50, TWIST=-0.08), part( 0.10,  1.00,  1.00,  2.00, HEAD_NOD=0.12),
        part( 0.00,  0.90,  1.00,  2.00, LEAD_HAND_Z=-0.06, REAR_HAND_Z=-0.02),
    )),
    "block_high_lead": Defence((0.20, 0.14, 0.28), _joined(
        part( 0.00,  0.95,  1.00,  2.00, LEAD_HAND_X=0.07, LEAD_HAND_Y=0.11, LEAD_HAND_Z=-0.20, LEAD_RAISE=0.30,
                                         LEAD_ELBOW=0.25, TWIST=0.10, BEND=-0.07, HEIGHT=-0.03, SHIFT_X=-0.03,
                                         HEAD_NOD=0.12, HEAD_BEND=-0.06),
    )),
    "block_high_rear": Defence((0.20, 0.14, 0.28), _joined(
        part( 0.00,  0.95,  1.00,  2.00, REAR_HAND_X=-0.06, REAR_HAND_Y=0.11, REAR_HAND_Z=-0.09, REAR_RAISE=0.30,
                                         REAR_ELBOW=0.25, TWIST=-0.10, BEND=0.07, HEIGHT=-0.03, SHIFT_X=0.03,
                                         HEAD_NOD=0.12, HEAD_BEND=0.06),
    )),
    "block_low_lead": Defence((0.22, 0.12, 0.30), _joined(
        part( 0.00,  0.95,  1.00,  2.00, LEAD_HAND_X=0.02, LEAD_HAND_Y=-0.17, LEAD_HAND_Z=-0.17, LEAD_RAISE=-0.06,
                                         BEND=0.20, FLEX=0.16, TWIST=-0.08),
        part(-0.05,  0.90,  1.00,  2.00, HEIGHT=-0.07),      part( 0.00,  0.90,  1.00,  2.00, REAR_HEEL=0.10),
    )),
    "block_low_rear": Defence((0.22, 0.12, 0.30), _joined(
        part( 0.00,  0.95,  1.00,  2.00, REAR_HAND_X=-0.03, REAR_HAND_Y=-0.18, REAR_HAND_Z=-0.04, REAR_RAISE=-0.06,
                                         BEND=-0.20, FLEX=0.16, TWIST=0.10),
        part(-0.05,  0.90,  1.00,  2.00, HEIGHT=-0.07),      part( 0.00,  0.90,  1.00,  2.00, REAR_HEEL=0.08),
    )),
    "cover": Defence((0.24, 0.35, 0.34), _joined(
        part(-0.05,  0.90,  1.00,  2.00, HEIGHT=-0.09),      part( 0.00,  1.00,  1.00,  2.00, FLEX=0.24),
        part( 0.00,  0.90,  1.00,  2.00, PELVIS_TURN=0.15, REAR_HEEL=0.10),
        part( 0.00,  0.95,  1.00,  2.00, LEAD_HAND_X=-0.02, LEAD_HAND_Y=0.08, LEAD_HAND_Z=-0.13, REAR_HAND_Y=0.09,
                                         LEAD_RAISE=0.28, REAR_RAISE=0.28, LEAD_FORTH=0.20, REAR_FORTH=0.20,
                                         LEAD_ELBOW=-0.25, REAR_ELBOW=-0.25, HEAD_NOD=0.22),
    )),
    "weave": Defence((0.42, 0.00, 0.50), _joined(
        part(-0.10,  0.50,  0.55,  1.20, BEND=0.22, SHIFT_X=0.05, TWIST=0.12),
        part( 0.00,  1.00,  1.00,  2.00, HEIGHT=-0.22, PELVIS_TILT=0.14),
        part( 0.05,  1.00,  1.00,  1.95, FLEX=0.30),         part( 0.00,  1.00,  1.00,  2.00, REAR_HEEL=0.36),
        part( 0.10,  1.00,  1.00,  2.00, LEAD_HEEL=0.08),
        part( 0.80,  1.45,  1.50,  2.10, BEND=-0.26, SHIFT_X=-0.06, TWIST=-0.14),
        part( 0.00,  0.80,  1.20,  2.00, LEAD_HAND_Y=0.04, LEAD_HAND_Z=-0.09, REAR_HAND_Y=0.03, LEAD_RAISE=0.12,
                                         REAR_RAISE=0.12),
    )),
}

COMBINATIONS = (
    "1 2 3 4 5 6 11 12 12 23 32 16 14 54 63 36 112 123 125 232 343 563 43 654 145 1232 1254 3632 12123"
).split()
"""Punches by the numbers that boxers give them: 1 is the first of ``PUNCHES``, the jab."""
PRESSING = "1 1 2 12 3 11".split()
"""Combinations that are thrown on the way."""

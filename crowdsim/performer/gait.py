"""The gaits of the embedded boxer: how feet swing, how the body rides over them, and what arms do meanwhile.

Figures are those of men of about 1.75 m: a walk of 1.5 m/s takes steps of 0.75 m, a jog of 2.7 m/s flies for a tenth
of a second between steps of 0.95 m.
"""

from __future__ import annotations

from dataclasses import dataclass

from crowdsim.performer.score import Channel as C
from crowdsim.performer.score import Swing

Parts = tuple[tuple[C, float], ...]
Hand = tuple[float, float, float]

GUARD_SWING = Swing()
SHUFFLE_SWING = Swing(push=0.19, settle=0.24, ramps=(0.36, 0.36), toe_off=0.22, load=0.6)
WALK_SWING = Swing(push=0.29, settle=0.27, ramps=(0.23, 0.24), toe_off=1.0, roll=0.26, toe_up=0.20, load=0.0)
JOG_SWING = Swing(push=0.23, settle=0.21, ramps=(0.24, 0.24), toe_off=1.0, roll=0.17, toe_up=0.06, load=0.0, fall=3.2)


@dataclass(frozen=True)
class Gait:
    """A gait in which feet pass one another, in steps of which each ends where the next one begins.

    Attributes:
        name: What it is called.
        swing: How a foot is carried.
        step: Length of a step [m].
        seconds: Time from touchdown to touchdown of the other foot [s].
        aloft: Time for which a foot swings, as a share of two steps.
        width: Distance of each foot from the line of travel [m].
        lift: Height that the ball of a swinging foot clears [m].
        bob: Height that the pelvis rises and falls by [m].
        lowest: When the pelvis is lowest, in steps after a touchdown.
        posture: Parts of the gait's posture that both feet's steps share, on top of the guard.
        swung: Parts that change sides: sizes at the touchdown of the lead foot; of the rear foot, their opposites.
    """

    name: str
    swing: Swing
    step: float
    seconds: float
    aloft: float
    width: float
    lift: float
    bob: float
    lowest: float
    posture: Parts
    swung: Parts


_SQUARE: Parts = (
    (C.PELVIS_TURN, 0.50),
    (C.LEAD_HEEL, -0.08),
    (C.REAR_HEEL, -0.27),
)
"""What takes a bladed guard square to the way."""

_LEAD_HAND = (C.LEAD_HAND_X, C.LEAD_HAND_Y, C.LEAD_HAND_Z)
_REAR_HAND = (C.REAR_HAND_X, C.REAR_HAND_Y, C.REAR_HAND_Z)


def _posture(
    height: float, shift: float, tilt: float, flex: float, nod: float, lead: Hand, rear: Hand, raised: float | None
) -> Parts:
    """Return a gait's posture: pelvis and trunk, where the hands are (x, y, z), and how shoulders are raised."""
    trunk = ((C.HEIGHT, height), (C.SHIFT_Z, shift), (C.PELVIS_TILT, tilt), (C.FLEX, flex), (C.HEAD_NOD, nod))
    hands = zip((*_LEAD_HAND, *_REAR_HAND), (*lead, *rear), strict=True)
    raises = () if raised is None else ((C.LEAD_RAISE, raised), (C.REAR_RAISE, raised))
    return (*_SQUARE, *trunk, *hands, *raises)


def _swung(turn: float, twist: float, forth: float, up: float) -> Parts:
    """Return what changes sides with the feet: pelvis against trunk, and each hand against the other."""
    hands = ((C.LEAD_HAND_Z, -forth), (C.REAR_HAND_Z, forth), (C.LEAD_HAND_Y, -up), (C.REAR_HAND_Y, up))
    return ((C.PELVIS_TURN, -turn), (C.TWIST, twist), *hands)


WALK = Gait(
    name="walk",
    swing=WALK_SWING,
    step=0.71,
    seconds=0.465,
    aloft=0.42,
    width=0.075,
    lift=0.045,
    bob=0.032,
    lowest=0.05,
    posture=_posture(0.038, -0.055, -0.06, -0.09, -0.06, (0.03, -0.20, -0.06), (-0.10, -0.20, 0.05), -0.05),
    swung=_swung(0.08, 0.15, 0.055, 0.015),
)

JOG = Gait(
    name="jog",
    swing=JOG_SWING,
    step=0.93,
    seconds=0.345,
    aloft=0.66,
    width=0.055,
    lift=0.11,
    bob=0.065,
    lowest=0.36,
    posture=_posture(0.045, -0.03, 0.03, -0.02, -0.10, (0.02, -0.16, -0.08), (-0.09, -0.16, 0.04), None),
    swung=_swung(0.11, 0.24, 0.07, 0.03),
)

STROLL = Gait(
    name="stroll",
    swing=WALK_SWING,
    step=0.66,
    seconds=0.52,
    aloft=0.40,
    width=0.07,
    lift=0.04,
    bob=0.026,
    lowest=0.05,
    posture=(),
    swung=_swung(0.07, 0.13, 0.13, 0.012),
)
"""A walk at ease: what is held and how the body stands is no part of it, but the arms swing."""

GAITS = {gait.name: gait for gait in (WALK, JOG)}

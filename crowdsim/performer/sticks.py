"""The embedded performer with a stick: how it is held in one hand or in both, and the blows that it strikes with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion as quat
from crowdsim.performer import skeleton as bones
from crowdsim.performer.moves import PUNCHES, Punch, part
from crowdsim.performer.score import Accent, Channel, Style

LENGTH = 0.55
"""From the middle of the fist to the point of the stick that strikes [m]."""
_TILT = np.deg2rad(35.0)
"""How far a stick in a fist points ahead of the thumb, towards the knuckles [rad]."""
_BELOW = 0.17
"""How far below the upper hand the lower one holds a stick [m]."""
_ALWAYS = (-3.0, -2.0, 1e6, 1e6 + 1.0)


@dataclass(frozen=True)
class Grip:
    """How a stick is held.

    Attributes:
        two_hands: Whether both hands hold it; the rear one is the upper one.
        blows: The blows, by name.
        combinations: What is struck one after another: digits are places in ``blows``, from 1 on.
        pressing: Likewise, on the way.
        fists: The fists in the guard, see ``Style.fists``.
        guard: What is added to the guard: channels of arms and wrists, and how much.
    """

    two_hands: bool
    blows: Mapping[str, Punch]
    combinations: tuple[str, ...]
    pressing: tuple[str, ...]
    fists: tuple[tuple[float, float, float], tuple[float, float, float]]
    guard: Mapping[Channel, float]

    def hold(self, style: Style) -> tuple[Style, list[Accent]]:
        """Return how one stands who holds it, and accents that last for a whole clip."""
        fists = tuple(
            (own[0] + 0.4 * (drawn[0] - middle[0]), own[1] + 0.4 * (drawn[1] - middle[1]), own[2])
            for own, drawn, middle in zip(self.fists, style.fists, _GUARD, strict=True)
        )
        held = replace(style, fists=(fists[0], fists[1]), blade=style.blade + 0.2)
        return held, [Accent(channel, size, _ALWAYS) for channel, size in self.guard.items()]


_GUARD = ((0.10, 0.22, 0.37), (-0.06, 0.215, 0.27))
"""Middles of the fists of boxers, about which they are drawn."""


def stick_point(side: int) -> tuple[float, float, float]:
    """Return the point of a stick that strikes, in the frame of the hand 0 or 1 that holds it [m]."""
    out = 1.0 if side == 0 else -1.0
    return (out * (bones.FIST_AHEAD + LENGTH * float(np.sin(_TILT))), 0.0, LENGTH * float(np.cos(_TILT)))


def lower_fist(upper: Array, hand_rotation: Array) -> Array:
    """Return where the lower hand holds a stick [m], for the fist of the right hand and its rotation. Shape (F, 3)."""
    along = np.array([-float(np.sin(_TILT)), 0.0, float(np.cos(_TILT))])
    return np.asarray(upper - _BELOW * quat.rotate(hand_rotation, along))


def tilted(hands: Array, wrist: Array, side: int) -> Array:
    """Return rotations of hands (F, 4) whose wrists tilt by angles (F,) [rad] towards the knuckles."""
    half = 0.5 * wrist * (1.0 if side == 0 else -1.0)
    turn = np.zeros((len(wrist), 4))
    turn[:, 0], turn[:, 2] = np.cos(half), np.sin(half)
    return np.asarray(quat.multiply(hands, turn))


def _blow(
    base: str,
    distance: tuple[float, float],
    speed: tuple[float, float],
    extra: float,
    without: tuple[Channel, ...],
    *parts: tuple[Accent, ...],
) -> Punch:
    """Return a blow for which the body moves as for a punch of the rear hand, with parts of its own."""
    own = PUNCHES[base]
    kept = tuple(one for one in own.parts if one.channel not in without)
    return replace(
        own,
        distance=distance,
        head=(1.20, 1.46),
        body=(0.92, 1.12),
        speed=speed,
        extra=extra,
        parts=kept + tuple(one for group in parts for one in group),
        inside=np.inf,
    )


_ARM = (Channel.REAR_ROLL, Channel.REAR_ELBOW, Channel.LEAD_HAND_X, Channel.LEAD_HAND_Y, Channel.LEAD_HAND_Z)
# fmt: off
_ONE: dict[str, Punch] = {
    "chop": _blow(
        "straight", (0.68, 0.92), (6.6, 0.7), 0.40, _ARM,
        part(-0.80, 0.25, 0.30, 0.85, REAR_SWING_Y=0.24, REAR_SWING_X=-0.10),
        part(-0.80, 0.20, 0.30, 0.90, REAR_WRIST=-0.35),
        part( 0.40, 1.00, 1.06, 1.90, REAR_WRIST=0.85),    part(-0.20, 0.85, 1.10, 1.90, REAR_ROLL=0.70),
        part( 0.00, 0.85, 1.10, 2.00, REAR_ELBOW=0.10),    part(-0.20, 0.90, 1.10, 2.00, LEAD_HAND_Y=-0.05),
    ),
    "forehand": _blow(
        "rear_hook", (0.64, 0.84), (7.0, 0.8), 0.50, _ARM,
        part(-0.80, 0.20, 0.30, 0.90, REAR_WRIST=-0.45),   part( 0.40, 1.00, 1.06, 1.90, REAR_WRIST=0.85),
        part(-0.20, 0.90, 1.10, 1.90, REAR_ROLL=1.50),     part(-0.40, 0.80, 1.10, 2.00, REAR_ELBOW=0.70),
        part(-0.20, 0.90, 1.10, 2.00, LEAD_HAND_Y=-0.05),
    ),
    "thrust": _blow(
        "straight", (0.72, 0.98), (6.4, 0.6), 0.18, _ARM,
        part(-0.90, 0.40, 1.08, 2.00, REAR_WRIST=0.85),    part(-0.60, 0.60, 1.10, 1.90, REAR_ROLL=0.70),
        part( 0.00, 0.85, 1.10, 2.00, REAR_ELBOW=0.05),
    ),
    "backhand": _blow(
        "straight", (0.64, 0.86), (6.6, 0.7), 0.50, (*_ARM, Channel.TWIST),
        part(-1.90, -0.30, -0.10, 0.85, REAR_HAND_X=0.30), part(-1.90, -0.20, 0.00, 0.90, REAR_HAND_Z=0.06),
        part(-1.60, -0.20, 0.00, 0.95, TWIST=0.36),        part( 0.00, 1.00, 1.10, 2.10, TWIST=-0.10),
        part(-1.60, 0.10, 0.25, 0.95, REAR_WRIST=-0.35),   part( 0.40, 1.00, 1.06, 1.90, REAR_WRIST=0.85),
        part(-1.60, -0.10, 1.06, 1.90, REAR_ROLL=1.90),    part(-1.20, 0.30, 1.10, 2.00, REAR_ELBOW=0.55),
    ),
}
_TWO: dict[str, Punch] = {
    "smash": _blow(
        "straight", (0.60, 0.78), (6.2, 0.5), 0.40, _ARM,
        part(-0.90, 0.20, 0.28, 0.85, REAR_SWING_Y=0.24, REAR_SWING_X=-0.10),
        part(-0.90, 0.15, 0.28, 0.90, REAR_WRIST=-0.35),
        part( 0.40, 1.00, 1.06, 1.90, REAR_WRIST=0.85),    part(-0.20, 0.85, 1.10, 1.90, REAR_ROLL=0.60),
        part( 0.00, 0.85, 1.10, 2.00, REAR_ELBOW=0.10),
    ),
    "swing": _blow(
        "rear_hook", (0.58, 0.74), (6.6, 0.6), 0.45, _ARM,
        part(-0.80, 0.20, 0.30, 0.90, REAR_WRIST=-0.40),   part( 0.40, 1.00, 1.06, 1.90, REAR_WRIST=0.85),
        part(-0.20, 0.90, 1.10, 1.90, REAR_ROLL=1.20),     part(-0.40, 0.80, 1.10, 2.00, REAR_ELBOW=0.60),
    ),
    "jab_with_the_end": _blow(
        "straight", (0.62, 0.82), (6.2, 0.4), 0.16, _ARM,
        part(-0.90, 0.40, 1.08, 2.00, REAR_WRIST=0.80),    part(-0.60, 0.60, 1.10, 1.90, REAR_ROLL=0.60),
        part( 0.00, 0.85, 1.10, 2.00, REAR_ELBOW=0.05),
    ),
}
# fmt: on

_TWO = {name: replace(blow, head=(1.08, 1.32), body=(0.88, 1.04)) for name, blow in _TWO.items()}

GRIPS: Mapping[str, Grip] = {
    "one_hand": Grip(
        two_hands=False,
        blows=_ONE,
        combinations=tuple("1 1 2 2 3 4 12 13 24 42 31 121 124 2 1 4".split()),
        pressing=tuple("1 3 2 13".split()),
        fists=((0.13, 0.14, 0.30), (-0.29, 0.18, 0.26)),
        guard={Channel.REAR_ROLL: -1.0, Channel.REAR_ELBOW: 0.1, Channel.REAR_WRIST: 0.1},
    ),
    "two_hands": Grip(
        two_hands=True,
        blows=_TWO,
        combinations=tuple("1 1 2 2 3 12 21 31 13 2 1".split()),
        pressing=tuple("1 3 2".split()),
        fists=((0.0, 0.06, 0.32), (-0.20, 0.17, 0.30)),
        guard={Channel.REAR_ROLL: -0.85, Channel.REAR_ELBOW: 0.1, Channel.REAR_WRIST: 0.1},
    ),
}
"""Ways to hold a stick."""

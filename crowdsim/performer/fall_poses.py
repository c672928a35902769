"""The poses that a body goes through as it falls and gets up, as keys by hand; ``falls`` turns them into motion.

A key is written in one of three ground frames: the *stance* in which the body was hit, the frame in which it *lies*,
with the head behind and the feet ahead or, face down, the other way round, and the stance to which it *rises*.
Lengths [m], angles [degrees].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from crowdsim.performer.score import Vector

STANCE, LYING, RISEN = "stance", "lying", "risen"


@dataclass(frozen=True)
class Hand:
    """Where a fist is: in the chest's frame, or on the floor or a knee where it is ``propped``.

    Attributes:
        at: Its position: in the chest's frame, or in the key's ground frame. None: as in the guard.
        propped: Whether it holds on to a point of the world.
        elbow: Swivel of the elbow from hanging to the outside [degrees].
    """

    at: Vector | None = None
    propped: bool = False
    elbow: float = 15.0


@dataclass(frozen=True)
class Foot:
    """Where a foot is, in the key's ground frame.

    Attributes:
        ball: Position of its ball. None: its print in the key's stance.
        pitch: Lift of the heel, below 0 that of the toes [degrees].
        yaw: Its heading [degrees]; that of its print where ``ball`` is None.
        splay: How far the knee points outwards [degrees].
    """

    ball: Vector | None = None
    pitch: float = 0.0
    yaw: float = 0.0
    splay: float = 0.0


@dataclass(frozen=True)
class Key:
    """A pose at a time after the hit, or after the body begins to rise [s].

    Attributes:
        time: That time.
        frame: The ground frame in which it is written.
        hips: Position of the pelvis.
        turned: Heading, forward tilt, tilt to the left of the pelvis, and its rotation about the body's own axis after
            these, to the left [degrees].
        spine: Twist, flexion and bend of the spine [degrees].
        head: Nod and turn of the head [degrees].
        lead, rear: The hands.
        lead_foot, rear_foot: The feet.
    """

    time: float
    frame: str
    hips: Vector
    turned: tuple[float, float, float, float]
    spine: Vector = (0.0, 10.0, 0.0)
    head: tuple[float, float] = (5.0, 0.0)
    lead: Hand = field(default_factory=Hand)
    rear: Hand = field(default_factory=Hand)
    lead_foot: Foot = field(default_factory=Foot)
    rear_foot: Foot = field(default_factory=Foot)


@dataclass(frozen=True)
class Plunge:
    """A kind of fall.

    Attributes:
        lying: Ground frame in which the body lies, in the stance: to the left, ahead [m], heading [degrees].
        risen: Ground frame of the stance after it, likewise.
        down: Keys of the fall.
        lies: How the body lies then; the key's time is not read.
        up: Keys of getting up.
    """

    lying: Vector
    risen: Vector
    down: tuple[Key, ...]
    lies: Key
    up: tuple[Key, ...]


def _floor(x: float, z: float, elbow: float = 40.0) -> Hand:
    return Hand((x, 0.05, z), True, elbow)


_ON_BACK = Key(
    0.0,
    LYING,
    (0.0, 0.05, -0.30),
    (0.0, -90.0, 0.0, 0.0),
    (0.0, 4.0, 0.0),
    (10.0, 8.0),
    _floor(0.38, -0.58, 80.0),
    _floor(-0.40, -0.48, 80.0),
    Foot((0.13, 0.0, 0.22), 0.0, 8.0, 6.0),
    Foot((-0.19, 0.0, 0.52), -72.0, -20.0, 20.0),
)

_UP_FROM_BACK = (
    Key(0.42, RISEN, (-0.03, 0.10, -0.26), (-14.0, -30.0, 0.0, 0.0), (0.0, 34.0, -8.0), (0.0, 6.0),
        Hand((0.20, -0.02, 0.34), elbow=20.0), _floor(-0.36, -0.50, 60.0),
        Foot(), Foot((-0.17, 0.0, 0.17), 0.0, -30.0, 15.0)),
    Key(0.62, RISEN, (-0.05, 0.27, -0.22), (-18.0, -4.0, -10.0, 0.0), (0.0, 32.0, -12.0), (0.0, 6.0),
        Hand((0.22, -0.04, 0.30), elbow=20.0), _floor(-0.36, -0.48, 45.0),
        Foot(), Foot((-0.24, 0.05, 0.06), 8.0, -38.0, 30.0)),
    Key(0.86, RISEN, (-0.05, 0.40, -0.17), (-22.0, 22.0, -14.0, 0.0), (0.0, 30.0, -16.0), (0.0, 8.0),
        Hand((0.22, -0.04, 0.30), elbow=20.0), _floor(-0.36, -0.46, 30.0),
        Foot(), Foot((-0.22, 0.05, -0.30), 56.0, -35.0, 22.0)),
    Key(1.12, RISEN, (-0.04, 0.48, -0.13), (-22.0, 22.0, -3.0, 0.0), (0.0, 20.0, -4.0), (-5.0, 6.0),
        Hand((0.13, 0.50, 0.10), True, 35.0), Hand((-0.20, -0.16, 0.24)),
        Foot(), Foot((-0.15, 0.0, -0.47), 74.0, -25.0, 5.0)),
    Key(1.45, RISEN, (-0.03, 0.66, -0.02), (-26.0, 26.0, 0.0, 0.0), (0.0, 18.0, 0.0), (-5.0, 4.0),
        Hand((0.17, -0.06, 0.30)), Hand((-0.14, -0.02, 0.26)),
        Foot(pitch=4.0), Foot((-0.15, 0.0, -0.47), 62.0, -35.0, 0.0)),
)  # fmt: skip

_BACKWARD = Plunge(
    (0.0, -0.27, 0.0),
    (0.0, -0.24, 0.0),
    (
        Key(0.19, STANCE, (-0.01, 0.83, -0.11), (-26.0, -8.0, 0.0, 0.0), (4.0, -14.0, 0.0), (-14.0, 0.0),
            Hand((0.34, 0.16, 0.26), elbow=30.0), Hand((-0.08, 0.14, 0.30), elbow=30.0),
            Foot(pitch=4.0), Foot(pitch=10.0)),
        Key(0.40, STANCE, (-0.01, 0.60, -0.30), (-14.0, -18.0, 0.0, 0.0), (0.0, 10.0, 0.0), (12.0, 0.0),
            Hand((0.42, -0.10, 0.22), elbow=50.0), Hand((-0.40, -0.14, 0.16), elbow=50.0),
            Foot((0.12, 0.06, 0.26), -14.0, -8.0), Foot((-0.15, 0.0, -0.10), -6.0, -36.0, 10.0)),
        Key(0.62, STANCE, (-0.01, 0.17, -0.50), (-5.0, -38.0, 0.0, 0.0), (0.0, 28.0, 0.0), (26.0, 0.0),
            _floor(0.42, -0.76, 60.0), _floor(-0.42, -0.72, 60.0),
            Foot((0.14, 0.13, 0.20), -30.0, 4.0, 5.0), Foot((-0.18, 0.05, 0.20), -40.0, -24.0, 15.0)),
        Key(0.86, LYING, (0.0, 0.06, -0.29), (-2.0, -80.0, 0.0, 0.0), (0.0, 18.0, 0.0), (30.0, 0.0),
            _floor(0.45, -0.60, 80.0), _floor(-0.48, -0.50, 5.0),
            Foot((0.14, 0.14, 0.33), -18.0, 6.0, 6.0), Foot((-0.19, 0.12, 0.50), -60.0, -22.0, 20.0)),
    ),
    _ON_BACK,
    _UP_FROM_BACK,
)  # fmt: skip


def _sideways(side: float) -> Plunge:
    """Return the fall to the left (1) or right (-1): onto the hip, over onto the back, up again turned half away."""

    def hands(near: Hand, other: Hand) -> dict[str, Any]:
        return {"lead": near, "rear": other} if side > 0.0 else {"lead": other, "rear": near}

    def feet(near: Foot, other: Foot) -> dict[str, Any]:
        return {"lead_foot": near, "rear_foot": other} if side > 0.0 else {"lead_foot": other, "rear_foot": near}

    out, held = _floor(0.92 * side, -0.06, 60.0), Hand((-0.16 * side, 0.08, 0.30), elbow=25.0)
    near = 0.20 if side > 0.0 else -0.20
    down = (
        Key(0.16, STANCE, (0.09 * side, 0.83, -0.01), (-28.0, 8.0, 10.0 * side, 0.0), (0.0, 8.0, 16.0 * side),
            (0.0, 0.0), **hands(Hand(elbow=30.0), Hand(elbow=30.0)), **feet(Foot(pitch=6.0), Foot(pitch=16.0))),
        Key(0.40, STANCE, (0.27 * side, 0.60, -0.03), (-24.0, 10.0, 24.0 * side, 0.0), (0.0, 14.0, 10.0 * side),
            (6.0, 0.0), **hands(Hand((0.44 * side, -0.06, 0.22), elbow=50.0), held),
            **feet(Foot((0.15 * side, 0.0, near), 24.0, -10.0, 10.0),
                   Foot((-0.06 * side, 0.06, -0.16 if side > 0.0 else 0.20), 14.0, -20.0))),
        Key(0.62, STANCE, (0.44 * side, 0.18, -0.06), (-18.0, 4.0, 48.0 * side, 0.0), (0.0, 20.0, -6.0 * side),
            (10.0, 0.0), **hands(out, held),
            **feet(Foot((0.02 * side, 0.0, 0.16), 20.0, -30.0 * side, 10.0),
                   Foot((-0.18 * side, 0.16, 0.04), -10.0, -40.0 * side))),
        Key(0.88, LYING, (0.0, 0.06, -0.30), (0.0, -82.0, 0.0, 58.0 * side), (0.0, 22.0, 0.0), (16.0, 0.0),
            **hands(_floor(0.42 * side, -0.70, 80.0), Hand((0.02 * side, 0.02, 0.32), elbow=25.0)),
            **feet(Foot((0.24 * side, 0.0, 0.22), -20.0, 30.0 * side, 10.0),
                   Foot((-0.02 * side, 0.16, 0.34), -20.0, 10.0 * side))),
    )  # fmt: skip
    lies = Key(
        0.0,
        LYING,
        (0.0, 0.05, -0.30),
        (0.0, -90.0, 0.0, 34.0 * side),
        (4.0 * side, 12.0, 0.0),
        (10.0, 6.0 * side),
        **hands(_floor(0.42 * side, -0.70, 80.0), Hand((0.02 * side, -0.08, 0.30), elbow=30.0)),
        **feet(
            Foot((0.20 * side, 0.0, 0.24 if side > 0.0 else 0.30), -4.0, 18.0 * side, 6.0),
            Foot((-0.04 * side, 0.0, 0.30 if side > 0.0 else 0.24), -4.0, 18.0 * side, 6.0),
        ),
    )
    return Plunge((0.58 * side, -0.10, -78.0 * side), (0.30 * side, -0.02, -42.0 * side), down, lies, _UP_FROM_BACK)


_FACE_DOWN = Key(
    0.0,
    LYING,
    (0.0, 0.05, -0.19),
    (0.0, 93.0, 0.0, 0.0),
    (0.0, 2.0, 0.0),
    (-14.0, 48.0),
    _floor(0.42, 0.52, -6.0),
    _floor(-0.42, 0.50, -6.0),
    Foot((0.14, 0.0, -1.27), 146.0, 10.0, 5.0),
    Foot((-0.14, 0.0, -1.28), 146.0, -10.0, 5.0),
)

_FORWARD = Plunge(
    (0.0, 0.95, 0.0),
    (0.0, 0.95, 0.0),
    (
        Key(0.16, STANCE, (-0.01, 0.83, 0.08), (-26.0, 12.0, 0.0, 0.0), (0.0, 24.0, 0.0), (-6.0, 0.0),
            Hand((0.28, 0.10, 0.34), elbow=25.0), Hand((0.02, 0.10, 0.34), elbow=25.0),
            Foot(pitch=20.0), Foot(pitch=32.0)),
        Key(0.36, STANCE, (-0.01, 0.62, 0.20), (-12.0, 20.0, 0.0, 0.0), (0.0, 18.0, 0.0), (-10.0, 0.0),
            Hand((0.24, 0.06, 0.40), elbow=30.0), Hand((-0.20, 0.06, 0.40), elbow=30.0),
            Foot((0.12, 0.06, 0.12), 60.0, -10.0), Foot((-0.13, 0.0, -0.20), 62.0, -20.0)),
        Key(0.54, STANCE, (-0.01, 0.47, 0.36), (-4.0, 38.0, 0.0, 0.0), (0.0, 12.0, 0.0), (-20.0, 0.0),
            Hand((0.24, 0.12, 0.46), elbow=30.0), Hand((-0.24, 0.12, 0.46), elbow=30.0),
            Foot((0.14, 0.02, -0.10), 84.0, 0.0, 5.0), Foot((-0.14, 0.0, -0.20), 80.0, -8.0, 5.0)),
        Key(0.72, STANCE, (0.0, 0.35, 0.62), (0.0, 66.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-34.0, 10.0),
            _floor(0.38, 1.44, 20.0), _floor(-0.38, 1.42, 20.0),
            Foot((0.14, 0.02, -0.17), 104.0, 0.0, 5.0), Foot((-0.14, 0.02, -0.20), 102.0, -4.0, 5.0)),
    ),
    _FACE_DOWN,
    (
        Key(0.28, RISEN, (0.0, 0.20, -0.16), (0.0, 72.0, 0.0, 0.0), (0.0, -6.0, 0.0), (-20.0, 10.0),
            _floor(0.38, 0.51, 12.0), _floor(-0.38, 0.49, 12.0),
            Foot((0.13, 0.02, -1.02), 126.0, 0.0, 5.0), Foot((-0.14, 0.02, -1.04), 126.0, 0.0, 5.0)),
        Key(0.60, RISEN, (-0.02, 0.44, -0.10), (0.0, 66.0, 0.0, 0.0), (0.0, 8.0, 0.0), (-16.0, 0.0),
            _floor(0.38, 0.51, 25.0), _floor(-0.38, 0.49, 25.0),
            Foot((0.13, 0.03, -0.60), 104.0, 0.0, 5.0), Foot((-0.14, 0.02, -0.58), 96.0, -4.0, 5.0)),
        Key(0.86, RISEN, (-0.04, 0.50, -0.12), (-6.0, 52.0, 0.0, 0.0), (0.0, 24.0, 0.0), (-10.0, 0.0),
            _floor(0.38, 0.51, 30.0), _floor(-0.38, 0.49, 40.0),
            Foot((0.17, 0.08, -0.10), 20.0, 4.0, 16.0), Foot((-0.14, 0.0, -0.54), 84.0, -10.0, 5.0)),
        Key(1.14, RISEN, (-0.04, 0.52, -0.10), (-14.0, 40.0, 0.0, 0.0), (0.0, 26.0, 0.0), (-10.0, 0.0),
            Hand((0.14, 0.50, 0.12), True, 35.0), _floor(-0.38, 0.49, 40.0),
            Foot(), Foot((-0.14, 0.0, -0.52), 78.0, -16.0, 5.0)),
        Key(1.45, RISEN, (-0.03, 0.66, -0.02), (-24.0, 28.0, 0.0, 0.0), (0.0, 20.0, 0.0), (-5.0, 4.0),
            Hand((0.17, -0.06, 0.30)), Hand((-0.14, -0.04, 0.28)),
            Foot(pitch=4.0), Foot((-0.14, 0.0, -0.50), 64.0, -30.0, 0.0)),
    ),
)  # fmt: skip

PLUNGES = {"forward": _FORWARD, "backward": _BACKWARD, "left": _sideways(1.0), "right": _sideways(-1.0)}
"""Kinds of falls by where the trunk goes."""

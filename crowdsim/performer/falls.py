"""Falls of the embedded boxer: to the floor after a hit, lying there, and up again; and staggers.

The poses that a body goes through as it falls and gets up are keys by hand. A key is written in one of three ground
frames: the *stance* in which the body was hit, the frame in which it *lies*, with the head behind and the feet ahead
or, face down, the other way round, and the stance to which it *rises*. Lengths [m], angles [degrees].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion import quaternion as quat
from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.moves import part
from crowdsim.performer.phrases import exchange_blows
from crowdsim.performer.score import Accent, Fall, Pose, Score, Span, Style, Vector

STANCE, LYING, RISEN = "stance", "lying", "risen"


@dataclass(frozen=True)
class Hand:
    """Where a fist is.

    Attributes:
        at: Its position in the chest's frame. None: as in the guard.
        prop: Point of the floor or of a knee that it holds on to instead, in the key's ground frame.
        elbow: Swivel of the elbow from hanging to the outside [degrees].
    """

    at: Vector | None = None
    prop: Vector | None = None
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
    lead: Hand = Hand()
    rear: Hand = Hand()
    lead_foot: Foot = Foot()
    rear_foot: Foot = Foot()


@dataclass(frozen=True)
class Plunge:
    """A kind of fall.

    Attributes:
        lying: Ground frame in which the body lies, in the stance: to the left, ahead [m], heading [degrees].
        risen: Ground frame of the stance after it, likewise.
        down: Keys of the fall.
        lies: How the body lies then; the key's time is not read.
        up: Keys of getting up.
        settles: When the body lies, after the hit [s].
    """

    lying: Vector
    risen: Vector
    down: Sequence[Key]
    lies: Key
    up: tuple[Key, ...]
    settles: float = 1.02


def _floor(x: float, z: float, elbow: float = 40.0) -> Hand:
    return Hand(prop=(x, 0.05, z), elbow=elbow)


# fmt: off
_ON_BACK = Key(
    0.0, LYING, (0.0, 0.05, -0.30), (0.0, -90.0, 0.0, 0.0), (0.0, 4.0, 0.0), (10.0, 8.0),
    _floor(0.38, -0.58, 80.0), _floor(-0.40, -0.48, 80.0),
    Foot((0.13, 0.0, 0.22), 0.0, 8.0, 6.0), Foot((-0.19, 0.0, 0.52), -72.0, -20.0, 20.0))
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
        Hand(prop=(0.13, 0.50, 0.10), elbow=35.0), Hand((-0.20, -0.16, 0.24)),
        Foot(), Foot((-0.15, 0.0, -0.47), 74.0, -25.0, 5.0)),
    Key(1.45, RISEN, (-0.03, 0.66, -0.02), (-26.0, 26.0, 0.0, 0.0), (0.0, 18.0, 0.0), (-5.0, 4.0),
        Hand((0.17, -0.06, 0.30)), Hand((-0.14, -0.02, 0.26)),
        Foot(pitch=4.0), Foot((-0.15, 0.0, -0.47), 62.0, -35.0, 0.0)),
)

_BACKWARD = Plunge(
    (0.0, -0.27, 0.0), (0.0, -0.24, 0.0), (
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
    ), _ON_BACK, _UP_FROM_BACK)

_FACE_DOWN = Key(
    0.0, LYING, (0.0, 0.05, -0.19), (0.0, 93.0, 0.0, 0.0), (0.0, 2.0, 0.0), (-14.0, 48.0),
    _floor(0.42, 0.52, -6.0), _floor(-0.42, 0.50, -6.0),
    Foot((0.14, 0.0, -1.27), 146.0, 10.0, 5.0), Foot((-0.14, 0.0, -1.28), 146.0, -10.0, 5.0))

_FORWARD = Plunge(
    (0.0, 0.95, 0.0), (0.0, 0.95, 0.0), (
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
    ), _FACE_DOWN, (
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
            Hand(prop=(0.14, 0.50, 0.12), elbow=35.0), _floor(-0.38, 0.49, 40.0),
            Foot(), Foot((-0.14, 0.0, -0.52), 78.0, -16.0, 5.0)),
        Key(1.45, RISEN, (-0.03, 0.66, -0.02), (-24.0, 28.0, 0.0, 0.0), (0.0, 20.0, 0.0), (-5.0, 4.0),
            Hand((0.17, -0.06, 0.30)), Hand((-0.14, -0.04, 0.28)),
            Foot(pitch=4.0), Foot((-0.14, 0.0, -0.50), 64.0, -30.0, 0.0)),
    ))


def _sideways(side: float) -> Plunge:
    """Return the fall to the left (1) or right (-1): onto the hip, over onto the back, up again turned half away."""
    out, held = _floor(0.92 * side, -0.06, 60.0), Hand((-0.16 * side, 0.08, 0.30), elbow=25.0)
    near, far = (0.20, -0.16) if side > 0.0 else (-0.20, 0.20)
    ahead, behind = (0.24, 0.30) if side > 0.0 else (0.30, 0.24)
    # Hands and feet: first those of the side that the body falls to.
    keys: tuple[Key, ...] = (
        Key(0.16, STANCE, (0.09 * side, 0.83, -0.01), (-28.0, 8.0, 10.0 * side, 0.0), (0.0, 8.0, 16.0 * side),
            (0.0, 0.0), Hand(elbow=30.0), Hand(elbow=30.0), Foot(pitch=6.0), Foot(pitch=16.0)),
        Key(0.40, STANCE, (0.27 * side, 0.60, -0.03), (-24.0, 10.0, 24.0 * side, 0.0), (0.0, 14.0, 10.0 * side),
            (6.0, 0.0), Hand((0.44 * side, -0.06, 0.22), elbow=50.0), held,
            Foot((0.15 * side, 0.0, near), 24.0, -10.0, 10.0), Foot((-0.06 * side, 0.06, far), 14.0, -20.0)),
        Key(0.62, STANCE, (0.44 * side, 0.18, -0.06), (-18.0, 4.0, 48.0 * side, 0.0), (0.0, 20.0, -6.0 * side),
            (10.0, 0.0), out, held, Foot((0.02 * side, 0.0, 0.16), 20.0, -30.0 * side, 10.0),
            Foot((-0.18 * side, 0.16, 0.04), -10.0, -40.0 * side)),
        Key(0.88, LYING, (0.0, 0.06, -0.30), (0.0, -82.0, 0.0, 58.0 * side), (0.0, 22.0, 0.0), (16.0, 0.0),
            _floor(0.42 * side, -0.70, 80.0), Hand((0.02 * side, 0.02, 0.32), elbow=25.0),
            Foot((0.24 * side, 0.0, 0.22), -20.0, 30.0 * side, 10.0),
            Foot((-0.02 * side, 0.16, 0.34), -20.0, 10.0 * side)),
        Key(0.0, LYING, (0.0, 0.05, -0.30), (0.0, -90.0, 0.0, 34.0 * side), (4.0 * side, 12.0, 0.0), (10.0, 6.0 * side),
            _floor(0.42 * side, -0.70, 80.0), Hand((0.02 * side, -0.08, 0.30), elbow=30.0),
            Foot((0.20 * side, 0.0, ahead), -4.0, 18.0 * side, 6.0),
            Foot((-0.04 * side, 0.0, behind), -4.0, 18.0 * side, 6.0)),
    )
    if side < 0.0:
        keys = tuple(replace(one, lead=one.rear, rear=one.lead, lead_foot=one.rear_foot, rear_foot=one.lead_foot)
                     for one in keys)
    *down, lies = keys
    return Plunge((0.58 * side, -0.10, -78.0 * side), (0.30 * side, -0.02, -42.0 * side), down, lies, _UP_FROM_BACK)


_FLUNG = (Hand((0.46, 0.02, 0.12), elbow=60.0), Hand((-0.46, 0.0, 0.10), elbow=60.0))
"""Arms that have let go."""
_LIMP = (Hand((0.24, -0.34, 0.14), elbow=20.0), Hand((-0.24, -0.34, 0.12), elbow=20.0))
"""Arms that hang."""
_STAR = Key(
    0.0, LYING, (0.0, 0.05, -0.30), (0.0, -90.0, 0.0, 0.0), (0.0, 2.0, 0.0), (6.0, -25.0),
    _floor(0.60, -0.92, 80.0), _floor(-0.62, -0.72, 80.0),
    Foot((0.19, 0.0, 0.60), -72.0, 24.0, 16.0), Foot((-0.17, 0.0, 0.61), -72.0, -26.0, 16.0))
_KNEES_UP = Key(
    0.0, LYING, (0.0, 0.05, -0.30), (0.0, -90.0, 0.0, 0.0), (0.0, 6.0, 0.0), (14.0, 20.0),
    _floor(0.34, -0.34, 70.0), _floor(-0.58, -0.95, 80.0),
    Foot((0.14, 0.0, 0.12), 0.0, 6.0, 4.0), Foot((-0.15, 0.0, 0.16), 0.0, -8.0, 8.0))
_FROG = Key(
    0.0, LYING, (0.0, 0.05, -0.30), (0.0, -90.0, 0.0, 12.0), (-4.0, 6.0, 4.0), (8.0, 35.0),
    _floor(0.50, -0.60, 80.0), _floor(-0.30, -0.30, 60.0),
    Foot((0.30, 0.0, 0.22), -20.0, 50.0, 42.0), Foot((-0.16, 0.0, 0.20), -10.0, -20.0, 10.0))
_PRONE_LIMP = Key(
    0.0, LYING, (0.0, 0.05, -0.19), (0.0, 93.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-8.0, -60.0),
    _floor(0.40, 0.02, -20.0), _floor(-0.46, 0.40, -6.0),
    Foot((0.16, 0.0, -1.26), 146.0, 14.0, 5.0), Foot((-0.12, 0.0, -1.28), 146.0, -6.0, 5.0))
_PRONE_KNEE = Key(
    0.0, LYING, (0.0, 0.05, -0.19), (0.0, 93.0, 0.0, 0.0), (0.0, 0.0, 5.0), (-12.0, 50.0),
    _floor(0.40, 0.56, -6.0), _floor(-0.40, 0.12, -10.0),
    Foot((0.42, 0.0, -0.86), 128.0, 50.0, 84.0), Foot((-0.14, 0.0, -1.28), 146.0, -10.0, 5.0))


def _curled(side: float) -> Key:
    """Return how a body lies on its left (1) or right (-1) side, hips and knees bent."""
    return _sided(side, Key(
        0.0, LYING, (0.0, 0.05, -0.30), (0.0, -90.0, 0.0, 62.0 * side), (6.0 * side, 34.0, 0.0), (18.0, 4.0 * side),
        Hand((0.10 * side, 0.06, 0.34), elbow=25.0), Hand((-0.02 * side, -0.12, 0.32), elbow=20.0),
        Foot((0.24 * side, 0.0, 0.10), -20.0, 40.0 * side, 4.0), Foot((0.10 * side, 0.06, 0.16), -20.0, 30.0 * side)))


def _sided(side: float, key: Key) -> Key:
    """Return a key whose first hand and foot are those of the side that the body falls to, lead and rear."""
    if side > 0.0:
        return key
    return replace(key, lead=key.rear, rear=key.lead, lead_foot=key.rear_foot, rear_foot=key.lead_foot)


_UP_BY_SQUAT = (
    Key(0.40, RISEN, (-0.02, 0.10, -0.26), (-10.0, -28.0, 0.0, 0.0), (0.0, 30.0, 0.0), (0.0, 0.0),
        _floor(0.36, -0.52, 55.0), _floor(-0.36, -0.52, 55.0),
        Foot((0.15, 0.0, 0.18), 0.0, 6.0, 8.0), Foot((-0.16, 0.0, 0.14), 0.0, -14.0, 8.0)),
    Key(0.72, RISEN, (-0.02, 0.24, -0.16), (-14.0, 14.0, 0.0, 0.0), (0.0, 40.0, 0.0), (-8.0, 0.0),
        Hand((0.22, -0.10, 0.34), elbow=20.0), _floor(-0.34, -0.36, 40.0),
        Foot(pitch=12.0, splay=14.0), Foot((-0.16, 0.0, 0.06), 22.0, -20.0, 14.0)),
    Key(1.02, RISEN, (-0.02, 0.40, -0.03), (-18.0, 44.0, 0.0, 0.0), (0.0, 34.0, 0.0), (-20.0, 0.0),
        Hand(prop=(0.16, 0.50, 0.20), elbow=40.0), Hand(prop=(-0.18, 0.50, 0.12), elbow=40.0),
        Foot(pitch=14.0, splay=8.0), Foot((-0.15, 0.0, 0.0), 26.0, -28.0, 8.0)),
    Key(1.45, RISEN, (-0.02, 0.68, -0.02), (-24.0, 40.0, 0.0, 0.0), (0.0, 26.0, 0.0), (-16.0, 2.0),
        Hand((0.16, -0.12, 0.30)), Hand((-0.15, -0.10, 0.28)),
        Foot(pitch=8.0), Foot((-0.15, 0.0, -0.12), 30.0, -36.0, 0.0)),
)
_FROM_FOURS = (
    Key(0.66, RISEN, (-0.02, 0.44, -0.16), (0.0, 66.0, 0.0, 0.0), (0.0, 10.0, 0.0), (-14.0, 0.0),
        _floor(0.34, 0.44, 25.0), _floor(-0.34, 0.46, 25.0),
        Foot((0.13, 0.03, -0.62), 100.0, 0.0, 5.0), Foot((-0.14, 0.02, -0.62), 98.0, -4.0, 5.0)),
    Key(0.92, RISEN, (-0.04, 0.52, -0.14), (-8.0, 34.0, 0.0, 0.0), (0.0, 24.0, 0.0), (-8.0, 0.0),
        Hand((0.22, -0.20, 0.26)), _floor(-0.34, 0.36, 40.0),
        Foot((0.16, 0.07, -0.06), 20.0, 4.0, 14.0), Foot((-0.14, 0.0, -0.54), 84.0, -12.0, 5.0)),
    Key(1.20, RISEN, (-0.03, 0.54, -0.10), (-16.0, 26.0, 0.0, 0.0), (0.0, 18.0, 0.0), (-4.0, 0.0),
        Hand(prop=(0.14, 0.52, 0.12), elbow=35.0), Hand((-0.20, -0.12, 0.24)),
        Foot(), Foot((-0.14, 0.0, -0.50), 74.0, -20.0, 5.0)),
    Key(1.48, RISEN, (-0.03, 0.68, -0.02), (-24.0, 26.0, 0.0, 0.0), (0.0, 18.0, 0.0), (-5.0, 4.0),
        Hand((0.17, -0.06, 0.30)), Hand((-0.14, -0.04, 0.28)),
        Foot(pitch=4.0), Foot((-0.14, 0.0, -0.48), 62.0, -32.0, 0.0)),
)


def _up_by_fours(side: float) -> tuple[Key, ...]:
    """Return how a body gets up that lies on its left (1) or right (-1) side: by hands and knees."""
    return (_sided(side, Key(
        0.40, RISEN, (-0.02, 0.18, -0.24), (24.0 * side, 20.0, 20.0 * side, 30.0 * side), (0.0, 18.0, 0.0), (-4.0, 0.0),
        _floor(0.36 * side, 0.10, 30.0), _floor(-0.30 * side, 0.24, 30.0),
        Foot((0.22 * side, 0.02, -0.42), 60.0, 10.0 * side, 10.0),
        Foot((-0.12 * side, 0.02, -0.52), 70.0, 0.0, 10.0))), *_FROM_FOURS)


_UP_ON_HANDS = (
    *_FORWARD.up[:3],
    Key(1.10, RISEN, (-0.03, 0.62, -0.16), (-12.0, 62.0, 0.0, 0.0), (0.0, 34.0, 0.0), (-14.0, 0.0),
        Hand(prop=(0.16, 0.52, 0.16), elbow=40.0), Hand(prop=(-0.16, 0.46, -0.02), elbow=40.0),
        Foot(pitch=4.0), Foot((-0.14, 0.02, -0.34), 50.0, -26.0, 4.0)),
    Key(1.46, RISEN, (-0.03, 0.74, -0.06), (-20.0, 44.0, 0.0, 0.0), (0.0, 28.0, 0.0), (-14.0, 2.0),
        Hand((0.16, -0.18, 0.28)), Hand((-0.16, -0.20, 0.24)),
        Foot(pitch=4.0), Foot((-0.14, 0.0, -0.30), 40.0, -36.0, 0.0)),
)
_UP_FROM_KNEES = (
    *_FORWARD.up[:2],
    Key(0.86, RISEN, (-0.03, 0.46, -0.30), (-4.0, 6.0, 0.0, 0.0), (0.0, 18.0, 0.0), (4.0, 0.0),
        Hand(prop=(0.15, 0.30, 0.02), elbow=30.0), Hand(prop=(-0.15, 0.30, 0.0), elbow=30.0),
        Foot((0.12, 0.0, -0.52), 86.0, 0.0, 4.0), Foot((-0.13, 0.0, -0.52), 86.0, -6.0, 4.0)),
    Key(1.14, RISEN, (-0.03, 0.56, -0.12), (-14.0, 28.0, 0.0, 0.0), (0.0, 20.0, 0.0), (-4.0, 0.0),
        Hand(prop=(0.14, 0.52, 0.12), elbow=35.0), Hand((-0.20, -0.12, 0.24)),
        Foot(pitch=2.0), Foot((-0.14, 0.0, -0.50), 78.0, -18.0, 5.0)),
    _FROM_FOURS[-1],
)

_TIMBER_BACK = Plunge(
    (0.0, -0.50, 0.0), (0.0, -0.40, 0.0), (
        Key(0.14, STANCE, (-0.01, 0.875, -0.12), (-22.0, -9.0, 0.0, 0.0), (3.0, -8.0, 0.0), (-16.0, 0.0),
            Hand((0.28, -0.10, 0.26)), Hand((-0.16, -0.06, 0.26)), Foot(pitch=2.0), Foot(pitch=8.0)),
        Key(0.32, STANCE, (-0.01, 0.83, -0.34), (-14.0, -24.0, 0.0, 0.0), (2.0, -4.0, 0.0), (-8.0, 0.0),
            *_LIMP, Foot((0.13, 0.0, 0.20), -12.0, -6.0), Foot((-0.13, 0.0, -0.05), -6.0, -20.0)),
        Key(0.50, STANCE, (0.0, 0.62, -0.60), (-6.0, -46.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0),
            *_FLUNG, Foot((0.14, 0.01, 0.10), -34.0, 0.0), Foot((-0.14, 0.0, 0.0), -34.0, -10.0)),
        Key(0.64, STANCE, (0.0, 0.30, -0.76), (0.0, -72.0, 0.0, 0.0), (0.0, 2.0, 0.0), (12.0, -5.0),
            *_FLUNG, Foot((0.16, 0.04, 0.06), -56.0, 6.0), Foot((-0.15, 0.02, 0.05), -56.0, -14.0)),
        Key(0.78, LYING, (0.0, 0.06, -0.30), (0.0, -88.0, 0.0, 0.0), (0.0, 4.0, 0.0), (14.0, -15.0),
            _floor(0.60, -0.92, 80.0), _floor(-0.62, -0.72, 80.0),
            Foot((0.18, 0.06, 0.60), -70.0, 16.0, 10.0), Foot((-0.17, 0.04, 0.61), -70.0, -20.0, 10.0)),
    ), _STAR, _UP_FROM_BACK, 0.94)
_TIMBER_FORWARD = Plunge(
    (0.0, 0.98, 0.0), (0.0, 0.98, 0.0), (
        Key(0.15, STANCE, (-0.01, 0.86, 0.10), (-24.0, 14.0, 0.0, 0.0), (0.0, 10.0, 0.0), (12.0, 0.0),
            *_LIMP, Foot(pitch=14.0), Foot(pitch=30.0)),
        Key(0.34, STANCE, (-0.01, 0.78, 0.32), (-14.0, 32.0, 0.0, 0.0), (0.0, 6.0, 0.0), (14.0, 0.0),
            *_LIMP, Foot((0.12, 0.0, 0.02), 30.0, -8.0), Foot((-0.13, 0.0, -0.20), 52.0, -20.0)),
        Key(0.52, STANCE, (0.0, 0.54, 0.58), (-6.0, 56.0, 0.0, 0.0), (0.0, 2.0, 0.0), (2.0, -14.0),
            *_LIMP, Foot((0.14, 0.0, -0.14), 70.0, 0.0), Foot((-0.13, 0.0, -0.22), 76.0, -8.0)),
        Key(0.66, STANCE, (0.0, 0.26, 0.76), (0.0, 80.0, 0.0, 0.0), (0.0, -4.0, 0.0), (-20.0, -40.0),
            Hand((0.30, -0.34, 0.14), elbow=20.0), _floor(-0.46, 1.30, -6.0),
            Foot((0.15, 0.01, -0.24), 112.0, 6.0), Foot((-0.12, 0.01, -0.26), 112.0, -4.0)),
        Key(0.80, LYING, (0.0, 0.06, -0.19), (0.0, 92.0, 0.0, 0.0), (0.0, -4.0, 0.0), (-16.0, -56.0),
            _floor(0.40, 0.02, -20.0), _floor(-0.46, 0.40, -6.0),
            Foot((0.16, 0.05, -1.25), 130.0, 14.0, 5.0), Foot((-0.12, 0.06, -1.26), 130.0, -6.0, 5.0)),
    ), _PRONE_LIMP, _UP_ON_HANDS, 0.96)
_CRUMPLE_BACK = Plunge(
    (0.02, 0.02, 0.0), (0.0, 0.0, 0.0), (
        Key(0.14, STANCE, (0.0, 0.81, -0.02), (-24.0, 4.0, 4.0, 0.0), (0.0, 18.0, 0.0), (24.0, 0.0),
            *_LIMP, Foot(pitch=20.0), Foot(pitch=40.0)),
        Key(0.32, STANCE, (0.01, 0.47, -0.08), (-16.0, 8.0, 2.0, 0.0), (0.0, 26.0, 0.0), (30.0, 0.0),
            *_LIMP, Foot(pitch=36.0, splay=8.0), Foot((-0.16, 0.0, -0.08), 58.0, -32.0, 10.0)),
        Key(0.48, STANCE, (0.02, 0.24, -0.18), (-8.0, -14.0, 4.0, 0.0), (0.0, 26.0, 4.0), (24.0, 6.0),
            *_LIMP, Foot((0.18, 0.0, 0.25), 18.0, 6.0, 24.0), Foot((-0.18, 0.0, 0.08), 30.0, -26.0, 14.0)),
        Key(0.68, STANCE, (0.02, 0.15, -0.26), (-4.0, -52.0, 4.0, 0.0), (0.0, 20.0, 4.0), (24.0, 20.0),
            *_FLUNG, Foot((0.26, 0.02, 0.24), -2.0, 26.0, 34.0), Foot((-0.18, 0.0, 0.17), 8.0, -22.0, 14.0)),
        Key(0.86, LYING, (0.0, 0.06, -0.30), (0.0, -84.0, 0.0, 8.0), (0.0, 12.0, 4.0), (20.0, 30.0),
            _floor(0.50, -0.60, 80.0), _floor(-0.30, -0.30, 60.0),
            Foot((0.30, 0.02, 0.22), -16.0, 46.0, 40.0), Foot((-0.16, 0.02, 0.20), -8.0, -20.0, 10.0)),
    ), _FROG, _UP_BY_SQUAT, 1.0)
_CRUMPLE_FORWARD = Plunge(
    (0.0, 0.86, 6.0), (0.0, 0.86, 6.0), (
        Key(0.14, STANCE, (0.0, 0.81, 0.02), (-22.0, 16.0, 0.0, 0.0), (0.0, 26.0, 0.0), (20.0, 0.0),
            *_LIMP, Foot(pitch=26.0), Foot(pitch=46.0)),
        Key(0.32, STANCE, (0.0, 0.47, 0.10), (-10.0, 26.0, 0.0, 0.0), (0.0, 34.0, 0.0), (20.0, 8.0),
            *_LIMP, Foot((0.14, 0.0, -0.04), 70.0, -6.0), Foot((-0.13, 0.0, -0.22), 78.0, -16.0)),
        Key(0.50, STANCE, (0.0, 0.40, 0.30), (-2.0, 66.0, 0.0, 0.0), (0.0, 22.0, 0.0), (-4.0, 24.0),
            Hand((0.22, -0.10, 0.36)), Hand((-0.22, -0.30, 0.24)),
            Foot((0.16, 0.02, -0.14), 88.0, 0.0, 8.0), Foot((-0.14, 0.0, -0.24), 86.0, -6.0, 5.0)),
        Key(0.70, STANCE, (0.0, 0.26, 0.56), (4.0, 84.0, 0.0, 6.0), (0.0, 8.0, 4.0), (-16.0, 40.0),
            _floor(0.40, 1.36, 0.0), _floor(-0.40, 0.98, -6.0),
            Foot((0.22, 0.02, -0.12), 110.0, 16.0, 20.0), Foot((-0.14, 0.02, -0.34), 108.0, -6.0, 5.0)),
    ), _PRONE_KNEE, _UP_FROM_KNEES, 1.0)
_SIT = Plunge(
    (0.0, -0.10, 0.0), (0.0, -0.10, 0.0), (
        Key(0.16, STANCE, (0.0, 0.76, -0.12), (-24.0, 6.0, 0.0, 0.0), (0.0, 16.0, 0.0), (-10.0, 0.0),
            Hand((0.32, -0.06, 0.28), elbow=30.0), Hand((-0.28, -0.06, 0.26), elbow=30.0),
            Foot(pitch=2.0), Foot(pitch=10.0)),
        Key(0.34, STANCE, (0.0, 0.44, -0.28), (-12.0, -2.0, 0.0, 0.0), (0.0, 26.0, 0.0), (8.0, 0.0),
            Hand((0.42, -0.20, 0.10), elbow=50.0), Hand((-0.42, -0.20, 0.08), elbow=50.0),
            Foot((0.14, 0.0, 0.26), -6.0, 0.0, 6.0), Foot((-0.16, 0.0, 0.10), 0.0, -20.0, 10.0)),
        Key(0.54, STANCE, (0.0, 0.12, -0.40), (-6.0, -22.0, 0.0, 0.0), (0.0, 34.0, 0.0), (20.0, 0.0),
            _floor(0.36, -0.66, 55.0), _floor(-0.36, -0.66, 55.0),
            Foot((0.14, 0.03, 0.22), -16.0, 4.0, 6.0), Foot((-0.16, 0.02, 0.16), -10.0, -16.0, 10.0)),
        Key(0.90, STANCE, (0.0, 0.10, -0.40), (-4.0, -30.0, 0.0, 0.0), (0.0, 30.0, 4.0), (26.0, 12.0),
            _floor(0.36, -0.68, 55.0), _floor(-0.36, -0.68, 55.0),
            Foot((0.14, 0.0, 0.10), 0.0, 4.0, 6.0), Foot((-0.15, 0.0, 0.10), 0.0, -12.0, 8.0)),
        Key(1.24, LYING, (0.0, 0.06, -0.30), (0.0, -74.0, 0.0, 0.0), (0.0, 20.0, 0.0), (26.0, 18.0),
            _floor(0.36, -0.40, 70.0), _floor(-0.52, -0.80, 75.0),
            Foot((0.14, 0.0, 0.13), 0.0, 6.0, 4.0), Foot((-0.15, 0.0, 0.16), 0.0, -8.0, 8.0)),
    ), _KNEES_UP, _UP_BY_SQUAT, 1.44)
_WALL = Plunge(
    (-0.22, 0.22, -62.0), (-0.10, 0.20, -30.0), (
        Key(0.16, STANCE, (0.0, 0.76, -0.10), (-18.0, -4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (10.0, 0.0),
            *_LIMP, Foot(pitch=8.0), Foot(pitch=18.0)),
        Key(0.34, STANCE, (0.0, 0.50, -0.10), (-10.0, -12.0, 0.0, 0.0), (0.0, 12.0, 0.0), (24.0, 0.0),
            *_LIMP, Foot((0.14, 0.0, 0.34), 0.0, 0.0, 10.0), Foot((-0.16, 0.0, 0.20), 6.0, -14.0, 10.0)),
        Key(0.56, STANCE, (0.0, 0.16, -0.04), (-4.0, -20.0, 4.0, 0.0), (0.0, 22.0, 4.0), (34.0, 0.0),
            *_LIMP, Foot((0.16, 0.02, 0.60), -36.0, 8.0, 12.0), Foot((-0.17, 0.02, 0.50), -26.0, -14.0, 12.0)),
        Key(0.86, STANCE, (0.02, 0.10, 0.0), (-12.0, -24.0, 20.0, 10.0), (0.0, 26.0, 12.0), (36.0, 0.0),
            _floor(0.38, -0.10, 60.0), Hand((-0.22, -0.30, 0.18)),
            Foot((0.10, 0.0, 0.66), -56.0, 0.0, 16.0), Foot((-0.22, 0.0, 0.60), -46.0, -30.0, 16.0)),
        Key(1.14, LYING, (0.0, 0.06, -0.30), (0.0, -72.0, 0.0, 50.0), (0.0, 30.0, 0.0), (24.0, 4.0),
            Hand((0.10, 0.02, 0.34), elbow=25.0), Hand((-0.06, -0.16, 0.30), elbow=20.0),
            Foot((0.22, 0.0, 0.20), -30.0, 36.0, 6.0), Foot((0.08, 0.06, 0.28), -30.0, 26.0)),
    ), _curled(1.0), _up_by_fours(1.0), 1.32)
_FOLD = Plunge(
    (0.40, 0.26, -64.0), (0.22, 0.16, -30.0), (
        Key(0.16, STANCE, (0.0, 0.76, -0.10), (-20.0, 22.0, 0.0, 0.0), (0.0, 40.0, 0.0), (14.0, 0.0),
            Hand((0.10, -0.26, 0.22), elbow=25.0), Hand((-0.08, -0.28, 0.20), elbow=25.0),
            Foot(pitch=10.0), Foot(pitch=26.0)),
        Key(0.34, STANCE, (0.0, 0.50, 0.0), (-14.0, 26.0, 0.0, 0.0), (0.0, 46.0, 0.0), (16.0, 0.0),
            Hand((0.10, -0.28, 0.20), elbow=25.0), Hand((-0.08, -0.30, 0.18), elbow=25.0),
            Foot((0.14, 0.0, 0.04), 62.0, -6.0), Foot((-0.14, 0.0, -0.24), 78.0, -20.0)),
        Key(0.62, STANCE, (0.06, 0.44, 0.10), (-16.0, 40.0, 16.0, 0.0), (0.0, 46.0, 6.0), (14.0, 0.0),
            _floor(0.44, 0.36, 30.0), Hand((-0.08, -0.30, 0.18), elbow=25.0),
            Foot((0.16, 0.0, -0.12), 84.0, -6.0, 6.0), Foot((-0.14, 0.0, -0.28), 84.0, -14.0, 4.0)),
        Key(0.88, STANCE, (0.20, 0.20, 0.10), (-40.0, 20.0, 56.0, 10.0), (0.0, 40.0, 0.0), (14.0, 0.0),
            _floor(0.66, 0.30, 40.0), Hand((-0.06, -0.24, 0.22), elbow=25.0),
            Foot((0.02, 0.02, -0.16), 50.0, -40.0, 6.0), Foot((-0.16, 0.04, -0.22), 50.0, -46.0, 4.0)),
    ), _curled(1.0), _up_by_fours(1.0), 1.16)


def _spinning(side: float) -> Plunge:
    """Return the fall of a body that a blow turns round to the left (1) or right (-1), onto its face."""
    keys = (
        Key(0.15, STANCE, (0.02 * side, 0.84, -0.05), (-20.0 + 36.0 * side, 2.0, -6.0 * side, 0.0),
            (14.0 * side, 2.0, 0.0), (-6.0, 30.0 * side), *_FLUNG, Foot(pitch=16.0), Foot(pitch=30.0)),
        Key(0.32, STANCE, (0.04 * side, 0.70, -0.18), (84.0 * side, 8.0, -4.0 * side, 0.0), (18.0 * side, 10.0, 0.0),
            (6.0, 30.0 * side), *_FLUNG,
            Foot((0.12, 0.0, 0.10), 40.0, 40.0 * side), Foot((-0.14, 0.0, -0.12), 44.0, 40.0 * side)),
        Key(0.50, STANCE, (0.04 * side, 0.46, -0.36), (138.0 * side, 32.0, 0.0, 0.0), (8.0 * side, 16.0, 0.0),
            (0.0, 20.0 * side),
            Hand((0.28, 0.02, 0.36), elbow=30.0), Hand((-0.28, 0.0, 0.34), elbow=30.0),
            Foot((-0.12, 0.0, -0.02), 70.0, 110.0 * side), Foot((0.13, 0.0, -0.06), 74.0, 110.0 * side)),
        Key(0.68, LYING, (0.0, 0.26, -0.34), (-10.0 * side, 70.0, 0.0, 0.0), (0.0, 2.0, 0.0), (-26.0, 20.0),
            _floor(0.38, 0.46, 10.0), _floor(-0.38, 0.44, 10.0),
            Foot((0.14, 0.02, -1.14), 106.0, 0.0, 5.0), Foot((-0.14, 0.02, -1.16), 106.0, -4.0, 5.0)),
    )
    return Plunge((0.06 * side, -0.98, 166.0 * side), (0.06 * side, -0.98, 166.0 * side), keys,
                  _PRONE_KNEE if side > 0.0 else _FACE_DOWN, _UP_ON_HANDS if side > 0.0 else _FORWARD.up, 0.96)


def _over_knee(side: float) -> Plunge:
    """Return the fall onto the rear knee, where the body sways, and over to the left (1) or right (-1)."""
    kneels = Foot((-0.15, 0.0, -0.46), 76.0, -22.0, 4.0)
    down = tuple(_sided(side, key) for key in (
        Key(0.90, STANCE, (0.16 * side, 0.36, -0.04), (-22.0, 14.0, 30.0 * side, 0.0), (0.0, 20.0, 10.0 * side),
            (16.0, 0.0), _floor(0.60 * side, 0.06, 40.0), Hand((-0.20 * side, -0.24, 0.20)),
            Foot((0.12 * side, 0.0, 0.10 if side > 0.0 else -0.40), 30.0 if side > 0.0 else 70.0, -10.0, 10.0),
            Foot((-0.12 * side, 0.02, -0.40 if side > 0.0 else 0.16), 60.0 if side > 0.0 else 10.0, -20.0, 6.0)),
        Key(1.10, STANCE, (0.34 * side, 0.16, -0.06), (-30.0, -10.0, 62.0 * side, 0.0), (0.0, 24.0, 0.0), (16.0, 0.0),
            _floor(0.88 * side, -0.02, 60.0), Hand((-0.16 * side, -0.10, 0.30), elbow=25.0),
            Foot((0.02 * side, 0.0, -0.10), 30.0, -30.0 * side, 10.0),
            Foot((-0.14 * side, 0.08, -0.16), 20.0, -40.0 * side)),
    ))
    return Plunge(
        (0.46 * side, -0.08, -76.0 * side), (0.24 * side, -0.02, -40.0 * side), (
            Key(0.16, STANCE, (0.0, 0.79, -0.04), (-26.0, 8.0, 0.0, 0.0), (0.0, 22.0, 0.0), (16.0, 0.0),
                Hand((0.24, -0.16, 0.28)), Hand((-0.20, -0.16, 0.26)), Foot(pitch=2.0), Foot(pitch=36.0)),
            Key(0.37, STANCE, (-0.02, 0.49, -0.10), (-22.0, 14.0, 0.0, 0.0), (0.0, 26.0, 0.0), (20.0, 0.0),
                *_LIMP, Foot(pitch=2.0), kneels),
            Key(0.62, STANCE, (0.03 * side, 0.49, -0.08), (-22.0, 22.0, 8.0 * side, 0.0), (0.0, 30.0, 6.0 * side),
                (26.0, 0.0), *_LIMP, Foot(pitch=2.0), kneels),
            *down,
        ), _curled(side), _up_by_fours(side), 1.34)


# fmt: on
PLUNGES = {
    "forward": _FORWARD,
    "backward": _BACKWARD,
    "left": _sideways(1.0),
    "right": _sideways(-1.0),
    "timber_back": _TIMBER_BACK,
    "timber_forward": _TIMBER_FORWARD,
    "crumple_back": _CRUMPLE_BACK,
    "crumple_forward": _CRUMPLE_FORWARD,
    "sit": _SIT,
    "wall": _WALL,
    "fold": _FOLD,
    "spin_left": _spinning(1.0),
    "spin_right": _spinning(-1.0),
    "knee_left": _over_knee(1.0),
    "knee_right": _over_knee(-1.0),
}
FALLS = tuple(PLUNGES)
"""Kinds of falls, by where the trunk goes and how."""
_GUARD, _AFTER = 1.15, 1.15
"""Time in the guard before a fall, and after it [s]."""
_LIES = 2.0
"""How long a body lies [s]."""
_STEPS = (1.66, 1.90, 2.38)
"""When the rear foot is halfway to its print, and there, and when the guard stands again, after the body began to rise
[s]."""


def write_fall(plan: Choreographer, kind: str, fights: bool) -> Score:
    """Plan a clip of one fall: a second in the guard, the fall, lying, getting up, and a second in the guard.

    Where the boxer ``fights``, it does so before the fall and after it, instead of standing in the guard.
    """
    rng, plunge = plan.rng, PLUNGES[kind]
    start = _hit(plan, fights)
    quick, slow = float(rng.uniform(0.94, 1.06)), float(rng.uniform(0.94, 1.08))
    before, prints = plan.ground_frame.copy(), plan.prints.copy()
    down = start + quick * plunge.settles
    rise = down + _LIES
    left, ahead, turn = _drawn(plunge.risen, rng)
    plan.move(down + 0.5, ahead, left, turn)
    lying = ground.compose(before, _drawn(plunge.lying, rng))
    frames = {STANCE: before, LYING: lying, RISEN: plan.ground_frame}
    writer = _Writer(plan.style, frames, {STANCE: prints, LYING: prints, RISEN: plan.prints}, _vary(rng))
    end = rise + slow * _STEPS[2]
    poses = [writer.guard(start - 0.2, STANCE), writer.guard(start, STANCE)]
    poses += [writer.pose(key, start + quick * key.time) for key in plunge.down]
    poses += [writer.pose(plunge.lies, time) for time in (down, rise)]
    poses += [writer.pose(key, rise + slow * key.time) for key in plunge.up]
    landed = writer.guard(rise + slow * _STEPS[1], RISEN)
    poses += [_step(poses[-1], landed, rise + slow * _STEPS[0]), landed, replace(landed, time=np.array(end))]
    plan.score.falls.append(Fall(kind, start, down, rise, end))
    plan.score.poses += _with_props(poses)
    return plan.finish(_go_on(plan, end, fights))


def _hit(plan: Choreographer, fights: bool) -> float:
    """Return when the body is hit: after some time in the guard, or in the middle of an exchange of blows [s]."""
    rng = plan.rng
    if not fights:
        return _GUARD + float(rng.uniform(0.0, 0.15))
    over = exchange_blows(plan, float(rng.uniform(0.3, 0.5)), _GUARD)
    last_hit = plan.score.reaches[-1].hit if plan.score.reaches else 0.0
    return max(over - float(rng.uniform(0.05, 0.45)), plan.feet_free, last_hit + 0.05)


def _go_on(plan: Choreographer, end: float, fights: bool) -> float:
    """Return when a clip ends that goes on after ``end``: with the guard, or with an exchange of blows [s]."""
    if not fights:
        return end + _AFTER
    return exchange_blows(plan, end + float(plan.rng.uniform(0.0, 0.1)), _AFTER) + 0.3


def _drawn(frame: Vector, rng: np.random.Generator) -> tuple[float, float, float]:
    """Return a ground frame near a given one (x, z [m], heading [degrees]), its heading in radians."""
    x, z, heading = frame
    dx, dz, turn = rng.uniform(-1.0, 1.0, 3)
    return x + 0.03 * dx, z + 0.03 * dz, float(np.radians(heading + 5.0 * turn))


@dataclass(frozen=True)
class Variation:
    """How one fall differs from its keys: no two are alike.

    Attributes:
        spine, head: What is added to them [degrees].
        hands: What is added to the positions of the fists (x, z), lead and rear [m].
    """

    spine: Vector
    head: tuple[float, float]
    hands: tuple[tuple[float, float], tuple[float, float]]


def _vary(rng: np.random.Generator) -> Variation:
    twist, flexion, bend, nod, turn, *hands = rng.uniform(-1.0, 1.0, 9).tolist()
    x, z, rear_x, rear_z = (0.05 * one for one in hands)
    return Variation((5.0 * twist, 2.5 * flexion, 4.0 * bend), (5.0 * nod, 14.0 * turn), ((x, z), (rear_x, rear_z)))


class _Writer:
    """Turns keys into poses in the world.

    Args:
        style: How the boxer stands.
        frames: Ground transform of each frame that keys are written in.
        prints: Footprints (x, z, yaw) in each of them, lead and rear. Shape (2, 3).
        variation: What poses have beside their keys, but for the guard.
    """

    def __init__(self, style: Style, frames: dict[str, Array], prints: dict[str, Array], variation: Variation) -> None:
        self.style, self.frames, self.prints, self.variation = style, frames, prints, variation
        towards = quat.from_euler(np.array([style.blade + style.twist, style.lean, 0.0]), "YXZ")
        self._guard = quat.rotate(quat.conjugate(towards), np.array(style.fists))

    def guard(self, time: float, frame: str) -> Pose:
        """Return the guard in a frame."""
        style = self.style
        middle = ground.to_local(self.frames[frame], np.insert(self.prints[frame][:, :2].mean(axis=0), 1, 0.0))
        elbows, heels = np.degrees(style.elbows), np.degrees(style.heels)
        key = Key(
            0.0,
            frame,
            (float(middle[0]), style.height, float(middle[2])),
            (np.degrees(style.blade), np.degrees(0.45 * style.lean), 0.0, 0.0),
            (np.degrees(style.twist), np.degrees(0.55 * style.lean), 0.0),
            (-4.0, -np.degrees(style.blade + style.twist) * 0.75),
            Hand(elbow=elbows[0]),
            Hand(elbow=elbows[1]),
            Foot(pitch=heels[0]),
            Foot(pitch=heels[1]),
        )
        return self._posed(key, time)

    def pose(self, key: Key, time: float) -> Pose:
        """Return a key's pose at a time [s], varied."""
        more = self.variation
        spine = tuple(one + other for one, other in zip(key.spine, more.spine, strict=True))
        head = tuple(one + other for one, other in zip(key.head, more.head, strict=True))
        hands = [_moved(*pair) for pair in zip((key.lead, key.rear), more.hands, strict=True)]
        varied = replace(key, spine=spine, head=head, lead=hands[0], rear=hands[1])  # type: ignore[arg-type]
        return self._posed(varied, time)

    def _posed(self, key: Key, time: float) -> Pose:
        frame = self.frames[key.frame]
        yaw, pitch, bend, spin = np.radians(key.turned)
        turned = quat.multiply(quat.from_euler(np.array([yaw, pitch, -bend]), "YXZ"), quat.about_y(spin))
        hands, feet = (key.lead, key.rear), (key.lead_foot, key.rear_foot)
        prints = [self._print(foot, side, key.frame) for side, foot in enumerate(feet)]
        held = [self._guard[side] if hand.at is None else hand.at for side, hand in enumerate(hands)]
        nowhere = np.full(3, np.nan)
        return Pose(
            time=np.array(time),
            hips=ground.to_world(frame, np.array(key.hips)),
            rotation=quat.multiply(quat.about_y(frame[2]), turned),
            spine=np.radians(key.spine),
            head=np.radians(key.head),
            hands=np.array(held),
            props=np.array([ground.to_world(frame, hand.prop) if hand.prop else nowhere for hand in hands]),
            propped=np.array([float(hand.prop is not None) for hand in hands]),
            elbows=np.radians([hand.elbow for hand in hands]),
            balls=np.array([ball for ball, _ in prints]),
            yaws=np.array([yaw for _, yaw in prints]),
            pitches=np.radians([foot.pitch for foot in feet]),
            splays=np.radians([foot.splay for foot in feet]),
        )

    def _print(self, foot: Foot, side: int, frame: str) -> tuple[Array, float]:
        """Return the ball of a foot in the world, and its heading."""
        x, z, yaw = self.prints[frame][side]
        if foot.ball is None:
            return np.array([x, 0.0, z]), float(yaw)
        at = self.frames[frame]
        # A heading continues from that of the print.
        return ground.to_world(at, foot.ball), float(yaw + ground.wrap(at[2] + np.radians(foot.yaw) - yaw))


def _moved(hand: Hand, by: tuple[float, float]) -> Hand:
    """Return a hand further along x and z by ``by`` [m], unless it is in the guard or on a knee."""
    x, z = by
    if hand.prop is not None and hand.prop[1] < 0.1:
        return replace(hand, prop=(hand.prop[0] + x, hand.prop[1], hand.prop[2] + z))
    if hand.at is not None:
        return replace(hand, at=(hand.at[0] + x, hand.at[1], hand.at[2] + z))
    return hand


def _step(before: Pose, after: Pose, time: float) -> Pose:
    """Return the pose halfway between two, the rear foot in the air."""
    ball = 0.5 * (before.balls[1] + after.balls[1]) + np.array([0.0, 0.07, 0.0])
    return replace(
        after,
        time=np.array(time),
        hips=0.5 * (before.hips + after.hips),
        spine=0.5 * (before.spine + after.spine),
        balls=np.array([after.balls[0], ball]),
        pitches=np.array([after.pitches[0], 0.7 * before.pitches[1] + 0.3 * after.pitches[1]]),
    )


def _with_props(poses: list[Pose]) -> list[Pose]:
    """Return poses with a prop for each hand at any time: the next one, or the last."""
    props = np.array([pose.props for pose in poses])
    for side in range(2):
        known = np.flatnonzero(np.isfinite(props[:, side, 0]))
        if len(known):
            following = known[np.minimum(np.searchsorted(known, np.arange(len(props))), len(known) - 1)]
            props[:, side] = props[following, side]
        else:
            props[:, side] = 0.0
    return [replace(pose, props=row) for pose, row in zip(poses, props, strict=True)]


@dataclass(frozen=True)
class Stagger:
    """A kind of stagger.

    Attributes:
        ahead, left: Where the trunk is thrown.
        thrown: How far, over what a stagger of middle strength has.
        steps: Length of each catching step, over that of a stagger of middle strength.
        dazed: For how long the body sways before its guard stands again [s].
    """

    ahead: float
    left: float
    thrown: float
    steps: tuple[float, ...]
    dazed: float = 0.0


_WAYS = {"back": (-1.0, 0.0), "left": (0.0, 1.0), "right": (0.0, -1.0)}
_STRENGTHS = {"light_stagger": (1.03, (0.80,), 0.0), "stagger": (1.05, (1.0, 0.4), 0.0),
              "heavy_stagger": (1.16, (1.0, 0.95, 0.5), 0.5)}  # fmt: skip
STAGGERS = {
    f"{strength}_{name}": Stagger(*way, thrown, steps, dazed)
    for strength, (thrown, steps, dazed) in _STRENGTHS.items()
    for name, way in _WAYS.items()
}
"""Kinds of staggers: of three strengths, to three sides."""


_CAUGHT = 0.3
"""How long a body that has caught itself stays where it is [s]."""


def write_stagger(plan: Choreographer, kind: str, fights: bool) -> Score:
    """Plan a clip of one stagger: a second in the guard, catching steps after a hit, and a second in the guard.

    Where the boxer ``fights``, it does so before and after that, instead of standing in the guard.
    """
    rng, recipe = plan.rng, STAGGERS[kind]
    ahead, left = recipe.ahead, recipe.left
    start = _hit(plan, fights)
    hit = float(rng.uniform(0.97, 1.06)) * recipe.thrown
    end = start + 0.10
    for share in recipe.steps:
        far = share * float(rng.uniform(0.33, 0.39))
        end = plan.move(end, far * ahead, far * left, float(rng.normal(0.0, 0.05)), 1.25, quick=True)
    plan.play(_thrown(ahead, left), (start, start + 0.24, start + 0.36, end + 0.25), hit)
    done = end + 0.30
    if recipe.dazed:
        plan.play(_DAZED, (start + 0.1, end, end + recipe.dazed - 0.15, done + recipe.dazed), hit, 0.1)
        done += recipe.dazed
    plan.score.staggers.append(Span(kind, start, done))
    return plan.finish(_go_on(plan, done + _CAUGHT, fights))


_DAZED = (
    *part(0.0, 0.0, 0.0, 0.0, HEIGHT=-0.06, FLEX=0.16, HEAD_NOD=0.22, LEAD_ELBOW=0.2, REAR_ELBOW=0.2),
    *part(0.0, 0.0, 0.0, 0.0, LEAD_HAND_Y=-0.20, REAR_HAND_Y=-0.16, LEAD_HAND_Z=-0.06),
    *part(0.2, 0.1, -0.1, 0.0, SHIFT_X=0.04, HEAD_BEND=0.12, BEND=0.08),
)
"""Knees that give, hands that sink, and a head that hangs, before the guard stands again."""


def _thrown(ahead: float, left: float) -> tuple[Accent, ...]:
    """Return what a hit does to a body whose trunk it throws ahead or to the left."""
    return (
        *part(0.0, 0.0, 0.0, 0.0, SHIFT_X=0.03 * left, SHIFT_Z=0.06 * ahead, PELVIS_TILT=0.44 * ahead),
        *part(0.0, 0.0, 0.0, 0.0, FLEX=0.44 * ahead, PELVIS_BEND=0.46 * left, BEND=0.66 * left),
        *part(0.0, 0.1, 0.1, 0.0, HEIGHT=-0.05),
        *part(0.0, -0.06, -0.06, 0.0, HEAD_NOD=0.32 * ahead, HEAD_BEND=0.25 * left),
        *part(0.0, 0.05, 0.05, 0.0, LEAD_HAND_X=0.12, REAR_HAND_X=-0.12, LEAD_ELBOW=0.5, REAR_ELBOW=0.5),
        *part(0.0, 0.08, 0.08, 0.0, LEAD_HAND_Y=-0.14, REAR_HAND_Y=-0.14),
    )

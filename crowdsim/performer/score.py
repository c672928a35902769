"""The score that the embedded boxer performs: footsteps, accents of single channels, reaches of a fist, and falls.

Everything is written for an orthodox boxer, whose left side leads; a southpaw is its mirror image. The *stance frame*
looks at the opponent: +z ahead, +x to the left, turned by the stance's heading.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Generic, TypeVar

import numpy as np

from crowdsim.core.types import Array

Vector = tuple[float, float, float]

LEAD, REAR = 0, 1
"""Feet and hands: the lead is the left one of an orthodox boxer."""

Channel = IntEnum(
    "Channel",
    "SHIFT_X SHIFT_Z HEIGHT PELVIS_TURN PELVIS_TILT PELVIS_BEND TWIST FLEX BEND HEAD_TURN HEAD_NOD HEAD_BEND "
    "LEAD_YAW REAR_YAW LEAD_HEEL REAR_HEEL LEAD_FORTH REAR_FORTH LEAD_RAISE REAR_RAISE LEAD_ELBOW REAR_ELBOW "
    "LEAD_ROLL REAR_ROLL LEAD_HAND_X LEAD_HAND_Y LEAD_HAND_Z REAR_HAND_X REAR_HAND_Y REAR_HAND_Z "
    "LEAD_SWING_X LEAD_SWING_Y LEAD_SWING_Z REAR_SWING_X REAR_SWING_Y REAR_SWING_Z LEAD_ARC REAR_ARC "
    "LEAD_WRIST REAR_WRIST",
    start=0,
)
"""What an accent changes; lengths [m] and angles [rad] on top of the guard stance.

Turns and twists grow to the left, bends lean to the left, tilts, flexion and nods lean forward, and heels rise. Forth
and raise move a shoulder, elbow lifts it outwards, roll turns a fist palm down, hand moves the guard, swing moves a
fist in the guard's frame, arc turns it about the middle between the shoulders, and wrist tilts what it holds towards
the knuckles.
"""

BENDS = tuple(
    tuple(Channel[f"{side}_{name}"] for name in ("SWING_X", "SWING_Y", "SWING_Z", "ARC")) for side in ("LEAD", "REAR")
)
"""Channels that bend the path of each fist."""


@dataclass(frozen=True)
class Accent:
    """A smooth pulse of one channel: up from ``at[0]`` to ``at[1]``, held until ``at[2]``, gone at ``at[3]`` [s].

    In tables of punches and defences ``at`` are phases of the move: 0 is its beginning, 1 its height (a punch's hit), 2
    its end. In those of other moves they are offsets from four times of the move [s].
    """

    channel: Channel
    size: float
    at: tuple[float, float, float, float]


@dataclass(frozen=True)
class Swing:
    """How a foot is carried through the air, and how the body goes along.

    Attributes:
        push: Time before the foot leaves the floor in which the body begins to move [s].
        settle: Time after the foot is down in which the body comes to rest [s].
        ramps: Shares of the swing in which the foot gathers speed, and in which it loses it; None for minimum jerk.
        toe_off: Lift of the heel as the foot leaves the floor [rad]; None where it depends on the length.
        roll: Time before that in which the heel begins to rise [s].
        toe_up: Lift of the toes before the foot lands on its heel [rad].
        load: How far the weight goes over to the other foot.
        fall: How much of the swing the foot comes down for: 3 as much as it rises, more where it rises quicker.
    """

    push: float = 0.18
    settle: float = 0.32
    ramps: tuple[float, float] | None = None
    toe_off: float | None = None
    roll: float = 0.12
    toe_up: float = 0.0
    load: float = 1.0
    fall: float = 3.0


GUARD_SWING = Swing()
SHUFFLE_SWING = Swing(push=0.19, settle=0.24, ramps=(0.36, 0.36), toe_off=0.22, load=0.6)


@dataclass(frozen=True)
class Footstep:
    """A foot leaves the floor at ``start`` and its ball stands at (x, z), turned by ``yaw``, at ``end`` [s]."""

    foot: int
    start: float
    end: float
    x: float
    z: float
    yaw: float
    lift: float
    swing: Swing


@dataclass(frozen=True)
class Turn:
    """The stance's heading grows by ``angle`` [rad] between ``start`` and ``end`` [s]."""

    start: float
    end: float
    angle: float


@dataclass(frozen=True)
class Reach:
    """A fist goes to a target in the stance frame, is there at ``hit`` and back in the guard at ``end`` [s].

    ``bearing`` and ``distance`` are seen from the pelvis at the hit, with the stance's heading; ``height`` is over
    the floor [m]. ``path`` bends the path of the fist: accents of its swing and arc.
    """

    kind: str
    hand: int
    start: float
    hit: float
    fall: float
    end: float
    bearing: float
    distance: float
    height: float
    skew: float
    path: tuple[Accent, ...]


@dataclass(frozen=True)
class Pivot:
    """A planted foot turns about its ball by ``angle`` [rad] between ``start`` and ``end`` [s], for good."""

    foot: int
    start: float
    end: float
    angle: float


Time = TypeVar("Time", float, int)
"""Events are timed in seconds in a score, and in frames in the truth about a clip, where ``end`` is the first after."""


@dataclass(frozen=True)
class Travel(Generic[Time]):
    """Travel in one gait: "shuffle", "walk", "jog" or "stroll"."""

    gait: str
    start: Time
    end: Time


@dataclass(frozen=True)
class Span(Generic[Time]):
    """A defence of a kind of ``moves.DEFENCES``, catching steps after a hit, or raised fists.

    Of a kind of ``falls.STAGGERS``, or of ``cheers.CHEERS``.
    """

    kind: str
    start: Time
    end: Time


@dataclass(frozen=True)
class Fall(Generic[Time]):
    """A fall of a kind of ``falls.FALLS``: on the floor from ``down`` to ``rise``, in the guard before and after it."""

    kind: str
    start: Time
    down: Time
    rise: Time
    end: Time


@dataclass(frozen=True)
class Rest(Generic[Time]):
    """A rest of a kind of ``rests.RESTS``: at ease from ``down`` to ``up``, in the guard before and after it."""

    kind: str
    start: Time
    down: Time
    up: Time
    end: Time


@dataclass(frozen=True)
class Pose:
    """A pose of a fall at a time, or poses over F frames, with one more axis in front of all shapes.

    Lengths [m] and angles [rad] in the world; feet and hands lead, rear.

    Attributes:
        time: When the body is in it [s]. Shape ().
        hips: Position of the pelvis; lower than the body can lie, it rests on the floor. Shape (3,).
        rotation: Rotation of the pelvis, a quaternion. Shape (4,).
        spine: Twist, flexion and bend of the spine. Shape (3,).
        head: Nod and turn of the head against the chest. Shape (2,).
        hands: Positions of the fists in the chest's frame. Shape (2, 3).
        props: Positions of the fists where hands are on the floor, or on a knee; NaN where they are not. Shape (2, 3).
        propped: How far each hand is there, 0 or 1. Shape (2,).
        elbows: Swivel of the elbows. Shape (2,).
        balls: Positions of the balls of the feet. Shape (2, 3).
        yaws: Headings of the feet. Shape (2,).
        pitches: Lift of the heels over the balls, below 0 that of the toes over the heels. Shape (2,).
        splays: How far each knee points outwards. Shape (2,).
    """

    time: Array
    hips: Array
    rotation: Array
    spine: Array
    head: Array
    hands: Array
    props: Array
    propped: Array
    elbows: Array
    balls: Array
    yaws: Array
    pitches: Array
    splays: Array


@dataclass(frozen=True)
class Style:
    """How one clip's boxer stands: what the accents are added to. Lengths [m], angles [rad], rates [Hz].

    Attributes:
        balls: Balls of the feet in the stance frame (x, z), lead and rear.
        foot_yaws: Turns of the feet against the heading, lead and rear.
        heels: Lift of the heels, lead and rear.
        height, lean: Height of the pelvis, and forward tilt of pelvis and trunk together.
        blade: Turn of the pelvis away from the opponent (negative, to the right).
        twist: Turn of the chest against the pelvis.
        fists: The fists in the guard, from the chest joint, in the stance frame (x, y, z), lead and rear.
        elbows: Swivel of the elbows away from hanging, lead and rear.
        bounce: Height and rate of the bounce.
        sway, breath: Size of the sway, and rate of breathing.
    """

    balls: tuple[tuple[float, float], tuple[float, float]]
    foot_yaws: tuple[float, float]
    heels: tuple[float, float]
    height: float
    lean: float
    blade: float
    twist: float
    fists: tuple[Vector, Vector]
    elbows: tuple[float, float]
    bounce: tuple[float, float]
    sway: float
    breath: float


def draw_style(rng: np.random.Generator) -> Style:
    """Draw how the boxer of one clip stands: clips differ as rounds of one man do."""

    def near(middle: float, spread: float) -> float:
        return middle + float(rng.uniform(-spread, spread))

    wide = near(1.03, 0.025)
    return Style(
        balls=((near(0.10 * wide, 0.007), 0.25 * wide), (near(-0.12 * wide, 0.007), -0.21 * wide)),
        foot_yaws=(near(-0.28, 0.05), near(-0.80, 0.06)),
        heels=(near(0.08, 0.02), near(0.27, 0.05)),
        height=near(0.885, 0.010),
        lean=near(0.26, 0.03),
        blade=near(-0.55, 0.04),
        twist=near(-0.06, 0.03),
        fists=(
            (near(0.10, 0.016), near(0.22, 0.022), near(0.37, 0.02)),
            (near(-0.06, 0.010), near(0.215, 0.016), near(0.27, 0.013)),
        ),
        elbows=(near(0.10, 0.08), near(0.12, 0.08)),
        bounce=(near(0.010, 0.004), near(2.0, 0.3)),
        sway=near(0.042, 0.008),
        breath=near(0.46, 0.08),
    )


@dataclass
class Score:
    """One clip as a score: its length [s], how the boxer stands, the first stance (x, z, heading), and what happens.

    A clip has one fall at the most; ``poses`` are those that the body goes through in it. With ``two_hands`` both hands
    hold a stick.
    """

    style: Style
    start: Vector
    seconds: float = 0.0
    footsteps: list[Footstep] = field(default_factory=list)
    pivots: list[Pivot] = field(default_factory=list)
    turns: list[Turn] = field(default_factory=list)
    accents: list[Accent] = field(default_factory=list)
    reaches: list[Reach] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    defences: list[Span[float]] = field(default_factory=list)
    travels: list[Travel[float]] = field(default_factory=list)
    falls: list[Fall[float]] = field(default_factory=list)
    staggers: list[Span[float]] = field(default_factory=list)
    cheers: list[Span[float]] = field(default_factory=list)
    rests: list[Rest[float]] = field(default_factory=list)
    two_hands: bool = False

"""The score that the embedded boxer performs: footsteps, accents of single channels, and reaches of a fist.

Everything is written for an orthodox boxer, whose left side leads; a southpaw is its mirror image. The *stance frame*
looks at the opponent: +z ahead, +x to the left, turned by the stance's heading.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, auto

Vector = tuple[float, float, float]

LEAD, REAR = 0, 1
"""Feet and hands: the lead is the left one of an orthodox boxer."""


class Channel(IntEnum):
    """What an accent changes; lengths [m] and angles [rad] on top of the guard stance.

    Turns and twists grow to the left, bends lean to the left, tilts, flexion and nods lean forward, and heels rise.
    Forth and raise move a shoulder, elbow lifts it outwards, roll turns a fist palm down, hand moves the guard, swing
    moves a fist in the guard's frame, and arc turns it about the middle between the shoulders.
    """

    SHIFT_X = 0
    SHIFT_Z = auto()
    HEIGHT = auto()
    PELVIS_TURN = auto()
    PELVIS_TILT = auto()
    PELVIS_BEND = auto()
    TWIST = auto()
    FLEX = auto()
    BEND = auto()
    HEAD_TURN = auto()
    HEAD_NOD = auto()
    HEAD_BEND = auto()
    LEAD_YAW = auto()
    REAR_YAW = auto()
    LEAD_HEEL = auto()
    REAR_HEEL = auto()
    LEAD_FORTH = auto()
    REAR_FORTH = auto()
    LEAD_RAISE = auto()
    REAR_RAISE = auto()
    LEAD_ELBOW = auto()
    REAR_ELBOW = auto()
    LEAD_ROLL = auto()
    REAR_ROLL = auto()
    LEAD_HAND_X = auto()
    LEAD_HAND_Y = auto()
    LEAD_HAND_Z = auto()
    REAR_HAND_X = auto()
    REAR_HAND_Y = auto()
    REAR_HAND_Z = auto()
    LEAD_SWING_X = auto()
    LEAD_SWING_Y = auto()
    LEAD_SWING_Z = auto()
    REAR_SWING_X = auto()
    REAR_SWING_Y = auto()
    REAR_SWING_Z = auto()
    LEAD_ARC = auto()
    REAR_ARC = auto()


BENDS = tuple(
    tuple(Channel[f"{side}_{name}"] for name in ("SWING_X", "SWING_Y", "SWING_Z", "ARC")) for side in ("LEAD", "REAR")
)
"""Channels that bend the path of each fist."""


@dataclass(frozen=True)
class Accent:
    """A smooth pulse of one channel: up from ``start`` to ``peak``, held until ``fall``, gone at ``end`` [s]."""

    channel: Channel
    size: float
    start: float
    peak: float
    fall: float
    end: float


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
    swing: Swing = Swing()


@dataclass(frozen=True)
class Travel:
    """The boxer travels in one gait between ``start`` and ``end`` [s]."""

    gait: str
    start: float
    end: float


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
    path: tuple[Accent, ...] = ()


@dataclass(frozen=True)
class Pivot:
    """A planted foot turns about its ball by ``angle`` [rad] between ``start`` and ``end`` [s], for good."""

    foot: int
    start: float
    end: float
    angle: float


@dataclass(frozen=True)
class Pose:
    """A pose of a fall at ``time`` [s]; lengths [m] and angles [rad] in the world, feet and hands lead, rear.

    Attributes:
        time: When the body is in it.
        hips: Position of the pelvis; lower than the body can lie, it rests on the floor.
        rotation: Rotation of the pelvis, a quaternion.
        spine: Twist, flexion and bend of the spine.
        head: Nod and turn of the head against the chest.
        hands: Positions of the fists in the chest's frame.
        props: Positions of the fists where hands are on the floor, or on a knee.
        propped: How far each hand is there, 0 or 1.
        elbows: Swivel of the elbows.
        balls: Positions of the balls of the feet.
        yaws: Headings of the feet.
        pitches: Lift of the heels over the balls, below 0 that of the toes over the heels.
        splays: How far each knee points outwards.
    """

    time: float
    hips: Vector
    rotation: tuple[float, float, float, float]
    spine: Vector
    head: tuple[float, float]
    hands: tuple[Vector, Vector]
    props: tuple[Vector, Vector]
    propped: tuple[float, float]
    elbows: tuple[float, float]
    balls: tuple[Vector, Vector]
    yaws: tuple[float, float]
    pitches: tuple[float, float]
    splays: tuple[float, float]


@dataclass(frozen=True)
class Fall:
    """A fall: standing until ``start``, on the floor from ``down`` to ``rise``, in the guard again at ``end`` [s].

    ``kind`` is a key of ``falls.FALLS``; between ``start`` and ``end`` the body goes through ``poses``.
    """

    kind: str
    start: float
    down: float
    rise: float
    end: float
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class Stagger:
    """Catching steps between ``start`` and ``end`` [s] after a hit that threw the trunk one way."""

    kind: str
    start: float
    end: float


@dataclass(frozen=True)
class Defence:
    """A defence of one kind between ``start`` and ``end`` [s]."""

    kind: str
    start: float
    end: float


@dataclass(frozen=True)
class Rest:
    """A rest of a kind of ``rests.RESTS``: at ease from ``down`` to ``up``, in the guard before and after it [s]."""

    kind: str
    start: float
    down: float
    up: float
    end: float


@dataclass(frozen=True)
class Style:
    """How one clip's boxer stands: what the accents are added to. Lengths [m], angles [rad], rates [Hz].

    Attributes:
        lead_ball, rear_ball: Balls of the feet in the stance frame (x, z).
        foot_yaws: Turns of the feet against the heading, lead and rear.
        heels: Lift of the heels, lead and rear.
        height, lean: Height of the pelvis, and forward tilt of pelvis and trunk together.
        blade: Turn of the pelvis away from the opponent (negative, to the right).
        twist: Turn of the chest against the pelvis.
        lead_fist, rear_fist: The fists in the guard, from the chest joint, in the stance frame (x, y, z).
        elbows: Swivel of the elbows away from hanging, lead and rear.
        bounce: Height and rate of the bounce.
        sway, breath: Size of the sway, and rate of breathing.
    """

    lead_ball: tuple[float, float]
    rear_ball: tuple[float, float]
    foot_yaws: tuple[float, float]
    heels: tuple[float, float]
    height: float
    lean: float
    blade: float
    twist: float
    lead_fist: tuple[float, float, float]
    rear_fist: tuple[float, float, float]
    elbows: tuple[float, float]
    bounce: tuple[float, float]
    sway: float
    breath: float


@dataclass(frozen=True)
class Score:
    """One clip as a score: stances, and what happens when."""

    seconds: float
    style: Style
    start: tuple[float, float, float]
    footsteps: tuple[Footstep, ...]
    pivots: tuple[Pivot, ...]
    turns: tuple[Turn, ...]
    accents: tuple[Accent, ...]
    reaches: tuple[Reach, ...]
    defences: tuple[Defence, ...]
    travels: tuple[Travel, ...] = ()
    falls: tuple[Fall, ...] = ()
    staggers: tuple[Stagger, ...] = ()
    rests: tuple[Rest, ...] = ()

"""Kinds, states and counts that kernels share by name, and the named tuples that they pass to one another."""

from typing import Any, NamedTuple

DISTANCE, BEARING, HEIGHT = range(3)  # of a behaviour's axes; there may be others behind them

# Points of ``Model.bodies`` and ``Model.arms``, and what a fall axis of ``Model.fall_axes`` is seen from.
HEAD, NECK, PELVIS = range(3)
LEFT_ELBOW, RIGHT_ELBOW, LEFT_FIST, RIGHT_FIST = range(4)
LEFT, RIGHT = range(2)
HEEL, BALL = range(2)
KNEE, SOLE = range(2)
FROM_START, FROM_END = range(2)

# What an avatar does about its opponent, how it stands, and what an action of ``Model.falls`` is.
FIGHTS, WATCHES, FLEES, RESTS, TRAVELS, NOTICES = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0
UP, STAGGERS, DROPS, FALLING, LYING, RISING, OUT = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
FALLS, LIES, STANDS_UP, STUMBLES, CHEERS = range(5)

CIRCLE, RECTANGLE = 1.0, 2.0  # kinds of an arena

# Rows of ``Scratch.work``, then shares along two axes for each behaviour.
WORK_X, WORK_Z, WORK_DISTANCE, WORK_BEARING, WORK_STATE, WORK_SHARES = range(6)

TRUNK_ROOM, LIMB_ROOM = 0.15, 0.05  # how far head, neck and pelvis keep from obstacles, and fists and soles [m]
MISSED, LANDED, BLOCKED, EVADED = range(4)  # what becomes of a strike
NEVER = -(1 << 30)  # instead of a control frame
ENTERED = -2  # instead of the action before, of avatars that have just entered
FORESEEN = 45  # how far ahead avatars know the paths of scripted targets [control frames]
NO_STRIKE = 1 << 14  # instead of a frame, where an action has no strike left
LANES = 8  # entries that are worked on at once
BLOCK = 16  # situations that are evaluated at a time
AHEAD = 4  # memory is prefetched this many avatars ahead


class Now(NamedTuple):
    """The frame that is decided.

    Attributes:
        frame: The control frame.
        moment: Its row of ``World.targets``.
        present: How many slots hold avatars that are present; they are the first ones.
    """

    frame: int
    moment: int
    present: int


class Observed(NamedTuple):
    """What avatars that choose together have observed.

    Attributes:
        opponents: Slot of the nearest opponent of each, -1 for none. Shape (Q,), int32.
        counts: How many neighbours each has. Shape (Q,), int32.
        neighbours: Their slots. Shape (Q, most neighbours), int32.
    """

    opponents: Any
    counts: Any
    neighbours: Any


class Target(NamedTuple):
    """A target: its position [m], how far it moves in a frame along x and z [m], and for how many frames."""

    x: float
    y: float
    z: float
    vx: float
    vz: float
    lasts: float


class Axis(NamedTuple):
    """A line on the floor from (x, z) to (to_x, to_z), such as that from head to feet of a lying body [m]."""

    x: float
    z: float
    to_x: float
    to_z: float

"""Rows and columns of the arrays that kernels share, and the named tuples that they pass to one another."""

from typing import Any, NamedTuple

import numpy as np

# Rows of ``Avatars.whole`` and ``Avatars.real``, a column for each slot, and how many there are.
(
    NUMBER, POLICY, COHORT, TEAM, SKIP, FIXED, OPPONENT, OPPONENT_BEFORE, DECISIONS, ACTION, ACTION_BEFORE, PENDING,
    BURST, NEXT_OPPONENT, HIT_BY, THROWN, THROWN_UNTIL, THREAT,
) = range(18)  # fmt: skip
(
    SCALE, SPEED, PHASE, PHASE_BEFORE, BASE_X, BASE_Z, BASE_COS, BASE_SIN, BASE_TURN, X, Z, HEADING, END_X, END_Z,
    RESTED, HIT_X, HIT_Z, HIT_FRAME, WIDTH, HALT_X, HALT_Z, SLIDE_X, SLIDE_Z,
) = range(23)  # fmt: skip
WHOLE_ROWS, REAL_ROWS = 18, 23
SEEN_X, SEEN_Z, SEEN_TURN, SEEN_FRAME = range(4)  # columns of each half of ``Avatars.seen``

# Columns of the tables of ``Model``: actions, moves, paths (rows), strikes, bodies, arms, sizes and policies.
NEXT, LENGTH, ORIGIN, PATHS, STRIKES, FIRST_STRIKE = range(6)
MOVE_X, MOVE_Z, MOVE_COS, MOVE_SIN, COST, TRANSITION = range(6)
PATH_X, PATH_Z, PATH_COS, PATH_SIN, PATH_TIME = range(5)
TIME, FIST_X, FIST_Y, FIST_Z, FIST_SPEED, LIMB, OWNER, FROM_X, FROM_Z, WORTH = range(10)
HEAD, NECK, PELVIS = 0, 3, 6
LEFT_ELBOW, LEFT_FIST = 0, 6
(
    HEAD_RADIUS, TORSO_RADIUS, NECK_DROP, PELVIS_DROP, TOLERANCE, REACH, PACE, FARTHEST, SOON, LATER, STRONG, SPACE,
    FOREARM_RADIUS, GLOVE_RADIUS,
) = range(14)  # fmt: skip
STRIDE, BEHAVIOURS, ACTIONS, STATES = range(4)

GRID_AXIS = np.dtype(
    [
        (name, np.float64)
        for name in ("first", "per_unit", "points", "wraps", "apart", "fade", "least", "greatest", "rate")
    ]
)
"""An axis of a behaviour's grid: the first grid point, grid points in a unit of it (squeezed, see
``environment.Axis.stretch``), their number, whether the axis wraps, how far apart neighbours lie in the table, the
fade, its range, and how much values are squeezed."""
DISTANCE, BEARING, HEIGHT = range(3)  # of a behaviour's axes; there may be others behind them

# Columns of ``Avatars.conditions``: mode as set, in the present and in the next action; standing, health and stamina;
# temperament; stance; the piece of a rest.
(
    MODE, DOES, DOES_NEXT, KEEPS, STANDING, STANDING_NEXT, FALL, DOWNS, RISES, HEALTH, HURT, HURT_FRAME, STAMINA,
    TEMPO, AGGRESSION, RANGE, STANCE, PIECE,
) = range(18)  # fmt: skip
CONDITIONS = 18
FIGHTS, WATCHES, FLEES, RESTS = 0.0, 1.0, 2.0, 3.0
UP, STAGGERS, DROPS, FALLING, LYING, RISING, OUT = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
FALL_POLICY, FALL_KIND, FALL_ACTION, FALL_ROW = range(4)
FALLS, LIES, STANDS_UP, STUMBLES, STUMBLES_ON = range(5)
ENTER, ROW, UNTIL = range(3)  # columns of ``Model.ways_to_rest``
HOLD, LEAVE, FOLLOWS, FIRST_WALK, LAST_WALK = range(5)  # columns of ``Model.rests``
TAKES, ONTO, WAY, POINTS_OF_WALK = range(4)  # columns of ``Model.walks``, the last one where its points begin

# Columns of ``World.rules``.
(
    FULL_HEALTH, HIT_COST, BODY_SHARE, BLOCKED_SHARE, STAGGER_FROM, DOWN_FROM, DOWN_FRAMES, MOST_DOWNS, STRIKE_TIRES,
    RUN_TIRES, REST_GAIN, ATTACKERS,
) = range(12)  # fmt: skip
RULES = 12

# Columns of ``World.cohorts``, the numbers of ``World.crowding`` and of ``World.arena``, and rows of ``World.stream``.
MARGIN, MOST, TEMPERATURE, HYSTERESIS, INTERVAL, VARIETY, DEFENCE, REACTION = range(8)
END_COST, PATH_COST, DISC, GAP, OUTSIDE_COST, TURN_BACK, SIGHT, BACK, UNSEEN, AT_AIR = range(10)
ARENA, CENTRE_X, CENTRE_Z, HALF_X, HALF_Z = range(5)
CHOICE_STREAM, BURST_STREAM = range(2)
CIRCLE, RECTANGLE = 1.0, 2.0

# Columns of ``Scratch.situations``; rows of ``Scratch.work``, then shares along two axes for each behaviour.
TARGET_X, TARGET_Y, TARGET_Z, MOVING_X, MOVING_Z, LASTS, FACING = range(7)
WORK_X, WORK_Z, WORK_DISTANCE, WORK_BEARING, WORK_STATE, WORK_SHARES = range(6)

MISSED, LANDED, BLOCKED, EVADED = range(4)  # what becomes of a strike
ENTERED = -2  # instead of the action before, of avatars that have just entered
NO_STRIKE = 1 << 30  # instead of a frame, where an action has no strike left
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

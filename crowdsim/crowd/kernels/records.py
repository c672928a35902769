"""Records that kernels share: what is known of an avatar, an action, a strike, a policy. Each is defined here alone.

Fields lie one after another, the widest first, so that none needs padding.
"""

import numpy as np


def _fields(kind, *names):
    return [(name, kind) for name in names]


def empty_records(count, dtype):
    """Return records of zeros that begin with a line of memory (64 bytes). Shape (count,)."""
    room = np.zeros(count * dtype.itemsize + 64, np.uint8)
    first = -room.ctypes.data % 64
    return room[first : first + count * dtype.itemsize].view(dtype)


def records(rows, dtype):
    """Return the columns of ``rows`` (n, fields) as the fields of records, one after another. Shape (n,)."""
    found = np.empty(len(rows), dtype)
    for name, column in zip(dtype.names, np.transpose(rows), strict=True):
        found[name] = column
    return found


_F8, _F4, _I4, _I2, _I1 = np.float64, np.float32, np.int32, np.int16, np.int8

MOTION = np.dtype([
    *_fields(_F4, "end_x", "end_z", "halt_x", "halt_z", "width", "phase", "speed"),
    *_fields(_I4, "action"),
])  # fmt: skip
"""What others see of an avatar's motion.

    end_x, end_z: Where the action ends [m].
    halt_x, halt_z: Where the body can halt after the action [m].
    width: How thick the body is: its scale times its girth.
    phase: Frames of the action done. An action shows its frame ``min(phase, length)``; what goes beyond is motion that
        the next action starts with.
    speed: Frames of motion in a control frame.
    action: The action.
"""

PLAYBACK = np.dtype([
    *_fields(_F4, "base_turn", "phase_before", "scale"),
    *_fields(_I4, "action_before"),
    *_fields(_I2, "cohort", "pending"),
])  # fmt: skip
"""How the action of an avatar is played back.

    base_turn: By what the ground transforms of playback frames are turned; the position on which they are set follows
        from where the action ends (``bases.base_at``).
    phase_before: The phase one control frame ago, in the action before.
    scale: Size of the body.
    action_before: The action one control frame ago, negative where there was no decision in this frame.
    cohort: Row of ``World.cohorts``.
    pending: The last whole frame of the action before its next strike, -1 where the action before may still have one.
"""

FIGHT = np.dtype([
    *_fields(_F4, "rested", "hit_x", "hit_z"),
    *_fields(_I4, "hit_frame", "next_opponent", "decisions", "hit_by", "thrown_until"),
    *_fields(_I2, "thrown"),
    *_fields(_I1, "burst", "threat"),
])  # fmt: skip
"""What the decisions of an avatar read; others see its opponent-to-be and its strikes.

    rested: The frame in which it has recovered from all strikes that it threw.
    hit_x, hit_z: The last hit, away from the attacker and as long as it was strong (``resolve.note_hits``).
    hit_frame: The frame of the last hit, or ``NEVER``.
    next_opponent: The opponent from the next action on, of avatars that decide; then the one before the last decision.
    decisions: Decisions taken.
    hit_by: Number of the avatar that hit it last, or -1.
    thrown, thrown_until: Motion of its latest action with strikes (``Model.twins``), or -1, and the frame in which that
        ends.
    burst: Strikes left of the present burst, 0 for an avatar that rests.
    threat: How far away its attackers were when it decided (``core.threats``), -1 where it saw a strike coming.
"""

SLIDE = np.dtype(_fields(_F4, "x", "z"))
"""How far a body slides while it falls [m]."""

CONDITION = np.dtype(
    _fields(
        _F8, "mode", "does", "does_next", "keeps", "standing", "standing_next", "fall", "downs", "rises", "health",
        "hurt", "hurt_frame", "stamina", "tempo", "aggression", "range", "stance", "piece",
        "way_x", "way_z", "pace", "travel", "leg", "fell", "fell_frame", "felled",
        "felled_frame", "since", "cheered",
    )
)  # fmt: skip
"""How an avatar is in a fight.

    mode: What groups and events have set it to do about its opponent: ``FIGHTS``, ``WATCHES``, ``FLEES``, ``RESTS``
        or ``TRAVELS``.
    does, does_next: What it does in its present action, and in its next one; that may be ``NOTICES``, too.
    keeps: The distance that it keeps while it watches [m].
    standing, standing_next: ``UP`` to ``OUT``, now and from its next action on.
    fall: Its row of ``Model.falls``.
    downs: How often it was knocked down.
    rises: The frame in which it gets up.
    health: Its health [points].
    hurt, hurt_frame: The damage of recent hits, and the frame of the last one.
    stamina: 0 to 1.
    tempo: Time to recover from a strike, as a factor of the cohort's.
    aggression: In doublings.
    range: How much further away than others it stays while it rests [m].
    stance: 1 orthodox, 2 southpaw, 0 any.
    piece: 1 more than its row of ``Model.rests`` while it stands at ease, else 0.
    way_x, way_z: The point that it travels to [m].
    pace: How fast it travels, for a body of scale 1 [m in a control frame].
    fell, fell_frame: 1 more than the row of ``Model.falls`` of its last fall, 0 for none, and the frame in which that
        began.
    felled, felled_frame: 1 more than the number of the avatar that it has knocked down last, 0 for none, and the frame.
    cheered: 1 once it has celebrated that it has no opponent left, else 0.
    since: The frame from which on it does what ``mode`` says.
    travel, leg: 1 more than the number of its path (``Crowd.travels``), else 0, and which point of that is next.
"""

COHORT = np.dtype(
    _fields(_F8, "margin", "most", "temperature", "hysteresis", "interval", "variety", "defence", "reaction")
)
"""How avatars of a cohort choose: how far below the best value a candidate may lie, and how many candidates there are
at most; randomness of the draw; how much nearer another opponent must be [m]; how long it takes to recover from a
strike [control frames], 0 no time; how much they care for variety, and defend themselves; and how long it takes them to
see what an opponent has decided [control frames]."""

RULE = np.dtype(
    _fields(
        _F8, "full_health", "hit_cost", "body_share", "blocked_share", "stagger_from", "down_from", "down_frames",
        "most_downs", "strike_tires", "run_tires", "rest_gain", "attackers",
    )
)  # fmt: skip
"""What hurts and tires avatars of a cohort: health at the start (0: nothing hurts), what a strong hit to the head
takes, the shares of hits to the body and of blocked ones; what hits must take to make an avatar stagger, and to knock
it down; for how long it is down [control frames], and how often until it stays down; what a strike and a metre take
from its stamina, and what a frame restores; how many may attack it (0: all)."""

STRIKE = np.dtype([
    *_fields(_F8, "frame", "x", "y", "z", "speed", "damage"),
    *_fields(_I4, "attacker", "victim", "limb", "outcome", "down"),
])  # fmt: skip
"""A strike thrown: its frame, where it ends [m], its speed [m/s] and what it takes from its victim's health; attacker
and victim, limb, outcome, and whether it has knocked its victim down."""

ACTION = np.dtype(_fields(_I4, "next", "length", "origin", "paths", "strikes", "first_strike"))
"""An action: the state in which it ends, its length [control frames], the playback frame that lies on the avatar when
it starts, its first row in ``Model.paths`` and in ``Model.strikes``, which the last record closes; and the last whole
frame before its first strike."""

MOVE = np.dtype(_fields(_F4, "x", "z", "cos", "sin", "cost"))
"""Where an action ends, seen from its start: position [m], cosine and sine of the turn; and the cost of the transition
into it (``policy.Actions.costs``)."""

PLACE = np.dtype(_fields(_F8, "x", "z", "heading"))
"""A ground transform: position [m] and heading [rad]."""

POINT = np.dtype(_fields(_F4, "x", "z"))
"""A point on the ground [m]."""

REACH = np.dtype(_fields(_F4, "time", "x", "y", "z", "speed", "limb", "owner", "from_x", "from_z"))
"""A strike of an action: its time [control frames from the state], the position of fist or foot seen from the action's
start [m], its speed [m/s], the limb, which of its state's actions it is in, and where it comes from
(``Actions.strike_origins``)."""

POLICY = np.dtype(_fields(_I4, "stride", "behaviours", "actions", "states"))
"""A policy: playback frames in a control frame, its first behaviour, action and state; a last record closes these."""

SIZE = np.dtype(
    _fields(
        _F8, "head_radius", "torso_radius", "neck_drop", "pelvis_drop", "tolerance", "reach", "pace", "farthest",
        "later", "watches", "strong", "space", "forearm_radius", "glove_radius",
    )
)  # fmt: skip
"""Sizes of the bodies of a policy: radius of head and torso, drop from the head to neck and pelvis, a strike's
tolerance; how far the surface of head and torso is from the body's position at most, and how far it moves in a control
frame at most; the distance beyond which all grids end [m]; how much later than the end of an action moving targets are
seen (``policy.environment.LEAD``) [control frames]; whether a grid sees when strikes reach furthest; the speed from
which on a strike is strong [m/s]; the share of ``Crowding``'s gap that bodies keep; radius of forearm and glove [m]."""

GRID_AXIS = np.dtype(_fields(_F8, "first", "per_unit", "points", "wraps", "apart", "fade", "least", "greatest", "rate"))
"""An axis of a behaviour's grid: the first grid point, grid points in a unit of it (squeezed, see
``environment.Axis.stretch``), their number, whether the axis wraps, how far apart neighbours lie in the table, the
fade, its range, and how much values are squeezed."""

FALL = np.dtype([*_fields(_F8, "direction"), *_fields(_I4, "policy", "kind", "action", "fall", "twin")])
"""A fall, or another action that no avatar chooses: bearing of the trunk's way in the avatar's ground frame at its
start, 0 forward, pi / 2 to the left [rad]; policy, kind (``FALLS`` to ``CHEERS``), action, the row of the fall that it
belongs to, of others their own, and the first row of the same captured motion, mirrored or not."""

THROWN = np.dtype([*_fields(_F8, "hit", "push"), *_fields(_I4, "slot", "row")])
"""An avatar that a hit throws off its feet: when, how far [m], its slot, and the row of ``Model.falls`` by which it
staggers, -1 for none."""

LINE = np.dtype(_fields(_F8, "x", "z", "to_x", "to_z"))
"""Where a body lies: from its head to its feet, over the ground [m]."""

CAPSULE = np.dtype(_fields(_F8, "x", "y", "z", "to_x", "to_y", "to_z", "radius", "bound"))
"""A capsule: both ends, its radius, and that of a sphere around it [m]."""

REST = np.dtype(_fields(_I4, "hold", "leave", "follows", "first_walk", "end_walk"))
"""A piece of standing at ease, or a part of a walk: the action that shows it, the action that leads from its end to the
guard or -1 for none, the row that follows it, and the first row in ``Model.walks`` of those that begin at its end, and
one past the last."""

WALK = np.dtype([*_fields(_F8, "reach"), *_fields(_I4, "action", "row")])
"""A walk: how far it leads at most [m], the action that shows its first part, and the row of ``Model.rests`` in the
pose of whose end that ends."""

REST_ENTRY = np.dtype(_fields(_I4, "enter", "row", "until", "walk"))
"""How a state leads to a rest: the action that leads there, or -1; the row of ``Model.rests`` in the pose of whose end
that ends; how many actions lead to a state that has one on the spot (``resting.NO_WAY``: none do); and the row of
``Model.walks`` that shows where the action leads, or -1 where the avatar stays on the spot."""

SITUATION = np.dtype(_fields(_F8, "x", "y", "z", "vx", "vz", "heading", "impact", "lasts"))
"""A target as an avatar sees it, for a body of scale 1: the fields of ``policy.axes.axis.Target``."""

NEIGHBOUR = np.dtype(
    _fields(
        _F8, "x", "z", "way_x", "way_z", "room", "frames", "end_cost", "path_cost", "halt_x", "halt_z", "step_cost",
        "slot",
    )
)  # fmt: skip
"""A neighbour that an avatar may collide with (``terms.collision_avoidance``)."""

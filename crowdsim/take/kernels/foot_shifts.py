"""Compiled shifts of planted feet: how far a foot belongs from where motion has it, through transitions.

A foot is planted over a span of time, through transitions. At a transition the motion's own position of the foot jumps
by delta. With E a step from 0 to 1, a foot belongs at ``motion(t) + sum over transitions of delta (E(t) - [t >= c])``,
which is continuous through transitions, and moves only where E does: E rises while the foot is in the air before or
after the plant, or in a step that the foot makes for the transition, see ``plan_steps``. All other movement of planted
feet is the capture's own. The rotation of the foot, and of its toes, goes along; a heel that is far up comes down with
the blend. Between plants a foot is let go of, or led from one position to the next where they follow closely.
"""

import math
from typing import NamedTuple

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import relative, rotate_by_vector
from crowdsim.jit import kernel
from crowdsim.take.kernels.columns import (
    AFTER,
    BEFORE,
    BEGIN,
    COS,
    END,
    FOOT_X,
    FOOT_Y,
    FOOT_Z,
    GAP_COLUMNS,
    GAP_X,
    GAP_Y,
    GAP_Z,
    RISE,
    SIN,
    TOES_X,
    TOES_Y,
    TOES_Z,
    TRACK_FOOT,
    TRACK_TOES,
)

SWING = 0.15
"""How long it takes to let go of a foot, or to lead it to where it lands [s]."""
PASS = 0.2
"""Time between two foot plants in which a foot is led from one to the other [s]."""
TILTED = math.radians(30.0)
"""Tilt of a foot over a transition beyond which it does not wait for a step [rad]."""


class Instant(NamedTuple):
    """An avatar at one time.

    Attributes:
        column: Its column in the window.
        time: The time [s].
        frame: Playback frame.
        following: The next one, the same where the time lies on a frame.
        part: Fraction to the next.
        scale: Size of the body.
        pace: Playback frames a second.
        first: First transition that feet move for.
        middle: First one that is not past.
        last: One past the last.
    """

    column: int
    time: float
    frame: int
    following: int
    part: float
    scale: float
    pace: float
    first: int
    middle: int
    last: int


@kernel(allocates=False)
def weigh_plants(plants, n, foot, at, time):
    """Return the foot plants before and after a time, each followed by its weight, and the first that is not over.

    During a plant its weight is 1. Away from plants a weight fades over ``SWING``; between two that are not further
    than ``PASS`` apart one passes into the other.
    """
    count, spans = plants.counts[n, foot], plants.spans[n, foot]
    while at < count and spans[at, END] < time:
        at += 1
    if at < count and spans[at, BEGIN] <= time:
        return at, 1.0, -1, 0.0, at
    one, other, since, until = -1, -1, math.inf, math.inf
    if at > 0:
        one, since = at - 1, time - spans[at - 1, END]
    if at < count:
        other, until = at, spans[at, BEGIN] - time
    before, after = minimum_jerk(1.0 - since / SWING), minimum_jerk(1.0 - until / SWING)
    if since + until < PASS:
        passed = minimum_jerk(since / (since + until))
        before, after = before * (1.0 - passed), after * passed
    return one, before, other, after, at


@kernel(inline=True)
def _progress(at, move, time, begin, end):
    """Return how far a foot has gone over a transition in a plant, from 0 to 1, and how high it is."""
    if at <= begin:
        return 1.0, 0.0
    if at >= end:
        return 0.0, 0.0
    part = (time - move[BEGIN]) / (move[END] - move[BEGIN])
    rise = part * (1.0 - part) if 0.0 < part < 1.0 else 0.0
    return minimum_jerk(part), 64.0 * rise * rise * rise * move[RISE]


@kernel(allocates=False)
def _rotation_since(p, q, r, at, rest, part):
    """Return nearly the rotation vector from one quaternion to another between two, for small rotations.

    The quaternions begin at column ``at`` of the given rows.
    """
    old = p[at], p[at + 1], p[at + 2], p[at + 3]
    w, x, y, z = relative(
        old,
        (
            q[at] * rest + r[at] * part,
            q[at + 1] * rest + r[at + 1] * part,
            q[at + 2] * rest + r[at + 2] * part,
            q[at + 3] * rest + r[at + 3] * part,
        ),
    )
    double = 2.0 if w >= 0.0 else -2.0
    return double * x, double * y, double * z


@kernel(allocates=False)
def _add_motion(motion, foot, start, steps, direction, scale, stays, share, change):
    """Add a share of what a foot does since a frame: its movement, its rotation, that of its toes.

    ``direction`` is that of its clip in the world. Where the foot ``stays``, only for as long as it does.
    """
    first, last = motion.bounds[start, 0], motion.bounds[start, 1]
    if stays:
        first = last = start
        if motion.contacts[start, foot]:
            first, last = motion.plants[start, foot, 0], motion.plants[start, foot, 1]
    frame = min(max(start + steps, float(first)), float(last))
    low = int(frame)
    part = frame - low
    rest = 1.0 - part
    cos, sin = direction[COS], direction[SIN]
    old, here = motion.tracks[start, foot], motion.tracks[low, foot]
    there = motion.tracks[low + 1 if part > 0.0 else low, foot]
    x, y = here[0] * rest + there[0] * part - old[0], here[1] * rest + there[1] * part - old[1]
    z = here[2] * rest + there[2] * part - old[2]
    change[GAP_X] += share * scale * (x * cos + z * sin)
    change[GAP_Y] += share * scale * y
    change[GAP_Z] += share * scale * (z * cos - x * sin)
    x, y, z = _rotation_since(old, here, there, TRACK_FOOT, rest, part)
    change[FOOT_X] += share * (x * cos + z * sin)
    change[FOOT_Y] += share * y
    change[FOOT_Z] += share * (z * cos - x * sin)
    x, y, z = _rotation_since(old, here, there, TRACK_TOES, rest, part)
    change[TOES_X] += share * x
    change[TOES_Y] += share * y
    change[TOES_Z] += share * z


@kernel(inline=True)
def _played_on(footing, now, foot, k, begin, end):
    """Return how long before and after a transition both motions play on for a foot, and whether it stays meanwhile.

    As in the blend both motions play on; through a plant for as long as the foot stands in them, or while it is in the
    air for the moment of the transition, else up to the plant.
    """
    motion, transitions = footing.motion, footing.transitions
    at, old, new = transitions.times[k], transitions.before[k], transitions.after[k]
    ahead, behind = transitions.spans[k, BEFORE], transitions.spans[k, AFTER]
    stays = begin < at < end and (motion.contacts[old, foot] or motion.contacts[new, foot])
    if at >= end:
        ahead = min(ahead, at - end)
    elif at <= begin:
        behind = min(behind, begin - at)
    elif not stays:
        ahead = min(ahead, (old - motion.plants[old, foot, 0]) / now.pace)
        behind = min(behind, (motion.plants[new, foot, 1] - new) / now.pace)
    return ahead, behind, stays


@kernel(inline=True)
def _add_transition(footing, now, foot, k, plant, weight, shift, rotations, change):
    """Add, times a weight, how far one transition shifts a foot in a plant, and rotate it and its toes."""
    transitions, span = footing.transitions, footing.plants.spans[now.column, foot, plant]
    at, gap, begin, end = transitions.times[k], transitions.gaps[k, foot], span[BEGIN], span[END]
    share, lift = _progress(at, footing.steps.moves[k, foot], now.time, begin, end)
    apart, past, tilt = now.time - at, k < now.middle, share
    if begin < at < end and gap[FOOT_X] * gap[FOOT_X] + gap[FOOT_Z] * gap[FOOT_Z] > TILTED * TILTED:
        # A heel comes up or down with the blend; only where the foot stands, and looks, waits for its step.
        ahead, behind = transitions.spans[k, BEFORE], transitions.spans[k, AFTER]
        tilt = minimum_jerk((apart + ahead) / (ahead + behind))
    if past:
        share, tilt = share - 1.0, tilt - 1.0
    for j in range(GAP_COLUMNS):
        change[j] = (share if j < FOOT_X or j == FOOT_Y else tilt) * gap[j]
    ahead, behind, stays = _played_on(footing, now, foot, k, begin, end)
    plays_on = -ahead < apart < behind
    if plays_on:
        part = minimum_jerk((apart + ahead) / (ahead + behind))
        if past:
            part -= 1.0
        steps, directions, motion = apart * now.pace, transitions.directions[k], footing.motion
        old, new = transitions.before[k], transitions.after[k]
        _add_motion(motion, foot, old, steps, directions[BEFORE], now.scale, stays, -part, change)
        _add_motion(motion, foot, new, steps, directions[AFTER], now.scale, stays, part, change)
    if share != 0.0 or tilt != 0.0 or plays_on:
        for j in range(3):
            shift[j] += weight * change[j]
        rotate_by_vector(rotations[0], change[FOOT_X], change[FOOT_Y], change[FOOT_Z])
        rotate_by_vector(rotations[1], change[TOES_X], change[TOES_Y], change[TOES_Z])
    shift[1] += weight * lift


@kernel(inline=True)
def add_shift(footing, now, foot, plant, weight, shift, rotations, change):
    """Add, times a weight, how far a foot belongs from the motion's own position in a plant, and rotate it.

    Transitions that are past are undone from the latest back, those to come follow from the next on.

    Args:
        footing: A ``Footing``.
        now: An ``Instant``.
        foot: 0 left, 1 right.
        plant: Number of the foot plant.
        weight: Its weight.
        shift: Changed [m]. Shape (3,).
        rotations: Rotation of the foot and of its toes, changed. Shape (2, 4).
        change: Room. Shape (9,).
    """
    for k in range(now.first, now.last):
        index = now.middle - 1 - (k - now.first) if k < now.middle else k
        _add_transition(footing, now, foot, index, plant, weight, shift, rotations, change)

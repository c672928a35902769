"""Compiled shifts of planted feet: how far a foot belongs from where motion has it, through transitions.

A foot is planted over a span of time, through transitions. At a transition the motion's own position of the foot jumps
by delta. With E a step from 0 to 1, a foot belongs at ``motion(t) + sum over transitions of delta (E(t) - [t >= c])``,
which is continuous through transitions, and moves only where E does: E rises while the foot is in the air before or
after the plant, or in a step that the foot makes for the transition, see ``plan_steps``. All other movement of planted
feet is the capture's own. The rotation of the foot, and of its toes, goes along; a heel that is far up comes down with
the blend. Between plants a foot is let go of, or led from one position to the next where they follow closely. Where
there is hardly time for that, it begins to move a little before it lifts off, and to turn even earlier.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import conjugate, multiply, relative, rotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import (
    AFTER,
    BEFORE,
    BEGIN,
    COS,
    END,
    FOOT_X,
    FOOT_Y,
    FOOT_Z,
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
from crowdsim.poses.kernels.transitions import cross_gap

SWING = 0.25
"""How long it takes to let go of a foot, or to lead it to where it lands [s]."""
PASS = 0.5
"""Time between two foot plants in which a foot is led from one to the other [s]."""
ROLL = 0.03
"""How long before it lifts off, and after it has landed, a foot moves on to the next foot plant [s]."""
TURN = 0.3
"""Least time in which a foot turns from one foot plant into the next [s]."""
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
        sizes: Size of the bones of its trunk, legs and arms. Shape (3,).
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
    sizes: NDArray[np.float64]
    pace: float
    first: int
    middle: int
    last: int


@kernel
def _pass_on(spans, k, time, most, longest):
    """Return how far a foot has gone or turned from one plant into the next, 0 to 1.

    Where there is less than ``longest`` between them, it begins on the floor, by ``most`` before it lifts off, and goes
    on for as long after it has landed.
    """
    end, begin = spans[k, END], spans[k + 1, BEGIN]
    room = min(max(0.5 * (longest - begin + end), 0.0), most)
    ahead = min(room, 0.5 * (end - spans[k, BEGIN]))
    behind = min(room, 0.5 * (spans[k + 1, END] - begin))
    return minimum_jerk((time - end + ahead) / (begin + behind - end + ahead))


@kernel
def weigh_plants(plants, n, foot, at, time):
    """Return what foot plants before and after a time mean for a foot.

    During a plant its weight is 1. Between two plants that are not further than ``PASS`` apart the one before passes
    into the one after it; away from others a weight fades.

    Returns:
        The plant before and the one after, -1 where there is none, each followed by its weight; the share of the one
        after in the foot's rotation; and the first plant that is not over.
    """
    count, spans = plants.counts[n, foot], plants.spans[n, foot]
    while at < count and spans[at, END] < time:
        at += 1
    if at < count and spans[at, BEGIN] <= time:
        for k in (at - 1, at):
            if 0 <= k < count - 1 and spans[k + 1, BEGIN] - spans[k, END] < TURN:
                turn, gone = _pass_on(spans, k, time, TURN, TURN), _pass_on(spans, k, time, ROLL, PASS)
                if 0.0 < turn < 1.0:
                    return k, 1.0 - gone, k + 1, gone, turn, at
        return at, 1.0, -1, 0.0, 0.0, at
    one, other, since, until = -1, -1, math.inf, math.inf
    if at > 0:
        one, since = at - 1, time - spans[at - 1, END]
    if at < count:
        other, until = at, spans[at, BEGIN] - time
    if since + until < PASS:
        if since + until < TURN:
            gone = _pass_on(spans, one, time, ROLL, PASS)
            return one, 1.0 - gone, other, gone, _pass_on(spans, one, time, TURN, TURN), at
        passed = minimum_jerk(since / SWING)
        return one, 1.0 - passed, other, passed, passed, at
    before, after = minimum_jerk(1.0 - since / SWING), minimum_jerk(1.0 - until / SWING)
    return one, before, other, after, after / max(before + after, 1e-9), at


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


@kernel
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


@kernel
def _find_change(motion, foot, start, steps, direction, scale, stays, change):
    """Write what a foot does since a frame: its movement, its rotation, that of its toes.

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
    change[GAP_X], change[GAP_Y], change[GAP_Z] = scale * (x * cos + z * sin), scale * y, scale * (z * cos - x * sin)
    x, y, z = _rotation_since(old, here, there, TRACK_FOOT, rest, part)
    change[FOOT_X], change[FOOT_Y], change[FOOT_Z] = x * cos + z * sin, y, z * cos - x * sin
    change[TOES_X], change[TOES_Y], change[TOES_Z] = _rotation_since(old, here, there, TRACK_TOES, rest, part)


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
def _nearly(x, y, z):
    """Return nearly the quaternion of a rotation vector, for small rotations."""
    size = 1.0 / math.sqrt(1.0 + 0.25 * (x * x + y * y + z * z))
    return size, 0.5 * x * size, 0.5 * y * size, 0.5 * z * size


@kernel
def _play_on(past, part, crossed, back, old, new):
    """Return what a foot rotates beyond the motion that is shown while the motions on both sides play on.

    ``old`` and ``new`` are rotation vectors of what they have done since the transition; a foot that has ``crossed`` a
    part of the gap, and would go ``back`` all of it, turns them along.
    """
    ahead, rest = multiply(crossed, back), 1.0 - part
    ox, oy, oz = rotate(crossed, old[0], old[1], old[2])
    nx, ny, nz = rotate(ahead, new[0], new[1], new[2])
    both = _nearly(rest * ox + part * nx, rest * oy + part * ny, rest * oz + part * nz)
    return multiply(both, _nearly(-nx, -ny, -nz) if past else _nearly(-ox, -oy, -oz))


@kernel(inline=True)
def _add_rotation(past, crossed, back, turns):
    """Add a transition to the rotations that follow one another: ``turns[0]`` forth, ``turns[1]`` back before that."""
    forth = turns[0]
    forth[0], forth[1], forth[2], forth[3] = multiply(crossed, forth)
    if past:
        behind = turns[1]
        behind[0], behind[1], behind[2], behind[3] = multiply(behind, back)


@kernel(inline=True)
def _add_transition(footing, now, foot, k, plant, weight, shift, turns, changes, begun):
    """Add, times a weight, how far one transition shifts a foot in a plant, and the rotations of foot and toes.

    Returns:
        Whether this transition, or one before it, is under way.
    """
    transitions, span = footing.transitions, footing.plants.spans[now.column, foot, plant]
    at, gap, begin, end = transitions.times[k], footing.steps.gaps[k, foot], span[BEGIN], span[END]
    share, lift = _progress(at, footing.steps.moves[k, foot], now.time, begin, end)
    apart, past, tilt = now.time - at, k < now.middle, share
    if begin < at < end and gap[FOOT_X] * gap[FOOT_X] + gap[FOOT_Z] * gap[FOOT_Z] > TILTED * TILTED:
        # A heel comes up or down with the blend; only where the foot stands, and looks, waits for its step.
        ahead, behind = transitions.spans[k, BEFORE], transitions.spans[k, AFTER]
        tilt = minimum_jerk((apart + ahead) / (ahead + behind))
    shift[1] += weight * lift
    ahead, behind, stays = _played_on(footing, now, foot, k, begin, end)
    plays_on, left = -ahead < apart < behind, 1.0 if past else 0.0
    if share == left and tilt == left and not plays_on and not (past and begun):
        return begun
    for j in range(3):
        shift[j] += weight * (share - left) * gap[j]
    foot_back, toes_back = footing.steps.returns[k, foot, 0], footing.steps.returns[k, foot, 1]
    foot_turn = toes_turn = (1.0, 0.0, 0.0, 0.0)
    if share == 1.0 and tilt == 1.0:
        foot_turn, toes_turn = conjugate(foot_back), conjugate(toes_back)
    elif share != 0.0 or tilt != 0.0:
        foot_turn = cross_gap(share, tilt, (gap[FOOT_X], 0.0, gap[FOOT_Z]), gap[FOOT_Y])
        toes_turn = cross_gap(tilt, tilt, (gap[TOES_X], gap[TOES_Y], gap[TOES_Z]), 0.0)
    if plays_on:
        part = minimum_jerk((apart + ahead) / (ahead + behind))
        steps, directions, motion = apart * now.pace, transitions.directions[k], footing.motion
        old, new = changes[0], changes[1]
        _find_change(motion, foot, transitions.before[k], steps, directions[BEFORE], now.scale, stays, old)
        _find_change(motion, foot, transitions.after[k], steps, directions[AFTER], now.scale, stays, new)
        for j in range(3):
            shift[j] += weight * (part - left) * (new[j] - old[j])
        more = _play_on(past, part, foot_turn, foot_back, old[FOOT_X:TOES_X], new[FOOT_X:TOES_X])
        foot_turn = multiply(more, foot_turn)
        more = _play_on(past, part, toes_turn, toes_back, old[TOES_X:], new[TOES_X:])
        toes_turn = multiply(more, toes_turn)
    _add_rotation(past, foot_turn, foot_back, turns[0])
    _add_rotation(past, toes_turn, toes_back, turns[1])
    return True


@kernel(inline=True)
def add_shift(footing, now, foot, plant, weight, shift, rotations, turns, changes):
    """Add, times a weight, how far a foot belongs from the motion's own position in a plant, and rotate it.

    Rotations do not commute: a foot goes back over all transitions that are past to the motion of the first one that is
    under way, and from there forth over all of them as far as it has come, so that nothing jumps at a transition.

    Args:
        footing: A ``Footing``.
        now: An ``Instant``.
        foot: 0 left, 1 right.
        plant: Number of the foot plant.
        weight: Its weight.
        shift: Changed [m]. Shape (3,).
        rotations: Rotation of the foot and of its toes, changed. Shape (2, 4).
        turns: Room. Shape (2, 2, 4).
        changes: Room. Shape (2, 9).
    """
    turns[:] = 0.0
    for part in range(2):
        turns[part, 0, 0] = turns[part, 1, 0] = 1.0
    begun = False
    for k in range(now.first, now.last):
        begun = _add_transition(footing, now, foot, k, plant, weight, shift, turns, changes, begun)
    if begun:
        for part in range(2):
            q = rotations[part]
            q[0], q[1], q[2], q[3] = multiply(turns[part, 0], multiply(turns[part, 1], q))

"""Special actions, which follow from damage instead of a choice: staggers, falls, lying and getting up."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.layout import (
    ACTION,
    COHORT,
    DOES,
    DOES_NEXT,
    DOWN_FRAMES,
    DOWNS,
    DROPS,
    END_X,
    END_Z,
    FALL,
    FALL_ACTION,
    FALL_KIND,
    FALL_POLICY,
    FALL_ROW,
    FALLING,
    FALLS,
    HEADING,
    HEALTH,
    HIT_X,
    HIT_Z,
    LENGTH,
    LIES,
    LYING,
    MOST_DOWNS,
    MOVE_X,
    MOVE_Z,
    NEXT,
    NUMBER,
    ORIGIN,
    POLICY,
    REST_GAIN,
    RISES,
    RISING,
    RUN_TIRES,
    SCALE,
    SLIDE_X,
    SLIDE_Z,
    SPEED,
    STAGGERS,
    STAMINA,
    STANCE,
    STANDING,
    STANDING_NEXT,
    STANDS_UP,
    STRIDE,
    STRIKE_TIRES,
    STRIKES,
    STUMBLES,
    TEAM,
    UP,
    X,
    Z,
)
from crowdsim.crowd.kernels.lying import FROM_START, axes_apart, axis_after, axis_of, from_axis, is_on_floor
from crowdsim.jit import kernel

NOWHERE = 1 << 30  # actions from a stance, before any fall is looked at
LIKE = 0.6  # directions of falls are alike that differ by no more from the nearest one to the blow's [rad]
FURTHEST_ASIDE = 2.0  # how much further aside a body falls at the most where there is no room [rad]
ASIDE = 0.1  # how much a radian aside counts, beside the square of the room that lacks [m2]
LASTS = 2.0  # how much motion in a control frame counts beside poses
PARTS = 4096.0  # parts of a square metre
SIDE_BY_SIDE = 1.0  # how far apart the axes of bodies should be that lie [m]
STAGGERS_BY = 0.7  # how far from the axis of a body others stagger [m]
SLIDES, WAYS = 0.4, 8  # how far a body slides at the most that falls beside others [m], and in how many directions
STANDS_BY = 0.5  # how far from the axis of a body others should stand [m]


@kernel(inline=True)
def falls_of(model, policy):
    """Return whether a policy has falls."""
    found = False
    for row in range(model.falls.shape[0]):
        found |= model.falls[row, FALL_POLICY] == policy and model.falls[row, FALL_KIND] == FALLS
    return found


@kernel(inline=True)
def is_down(avatars, i):
    """Return whether an avatar falls, lies, or is out of the fight; not one that has stood up and now chooses again."""
    standing = avatars.conditions[avatars.whole[NUMBER, i], STANDING]
    return standing >= DROPS and standing != RISING


@kernel(inline=True)
def special_action(model, avatars, world, frame, own, observed, q):
    """Return the action that an avatar has to do next because it staggers, falls or is down; -1 where it may choose.

    What it will be doing is noted in its row of ``conditions``; others see it when the action starts.
    """
    row = avatars.conditions[avatars.whole[NUMBER, own]]
    standing = row[STANDING]
    row[STANDING_NEXT] = UP
    if standing == STAGGERS:
        found = _pick(model, avatars, world, own, STUMBLES, observed, q)
        return -1 if found < 0 else model.falls[found, FALL_ACTION]
    if standing == DROPS:
        found = _pick(model, avatars, world, own, FALLS, observed, q)
        row[STANDING_NEXT], row[FALL] = FALLING, found
        _slide(model, avatars, own, found, observed, q)
        return model.falls[found, FALL_ACTION]
    if FALLING <= standing <= LYING:
        avatars.real[SLIDE_X, own], avatars.real[SLIDE_Z, own] = 0.0, 0.0
        rises = standing == LYING and frame >= row[RISES]
        row[STANDING_NEXT] = RISING if rises else LYING
        return _part_of(model, np.int64(row[FALL]), STANDS_UP if rises else LIES)
    return -1


@kernel(inline=True)
def _part_of(model, fall, kind):
    """Return the action of a kind that belongs to a fall."""
    for row in range(model.falls.shape[0]):
        if model.falls[row, FALL_KIND] == kind and model.falls[row, FALL_ROW] == fall:
            return model.falls[row, FALL_ACTION]
    return -1


@kernel(inline=True)
def _pick(model, avatars, world, own, kind, observed, q):
    """Return a row of ``Model.falls`` that leads where the last blow came to, and begins most alike; -1 for none.

    A body falls where most room is, if need be further aside, and staggers nowhere onto others. Of falls alike only
    those count that lead to the avatar's stance, or nearest to it.
    """
    whole, real, falls = avatars.whole, avatars.real, model.falls
    policy, stance = whole[POLICY, own], int(avatars.conditions[whole[NUMBER, own], STANCE])
    blow = math.atan2(real[HIT_X, own], real[HIT_Z, own]) - real[HEADING, own]
    nearest, best, least = math.inf, math.inf, NOWHERE
    for row in range(falls.shape[0]):
        if falls[row, FALL_POLICY] == policy and falls[row, FALL_KIND] == kind:
            nearest = min(nearest, _apart(model.fall_directions[row], blow))
    for row in range(falls.shape[0]):
        if falls[row, FALL_POLICY] == policy and falls[row, FALL_KIND] == kind:
            best = min(best, _unfit(model, avatars, own, row, blow, nearest, observed, q))
    if best == math.inf:
        return -1
    for row in range(falls.shape[0]):
        of_kind = falls[row, FALL_POLICY] == policy and falls[row, FALL_KIND] == kind
        if of_kind and _unfit(model, avatars, own, row, blow, nearest, observed, q) <= best:
            least = min(least, _astray(model, row, stance))
    found, gap = -1, math.inf
    for row in range(falls.shape[0]):
        if falls[row, FALL_POLICY] == policy and falls[row, FALL_KIND] == kind:
            fits = _unfit(model, avatars, own, row, blow, nearest, observed, q) <= best
            if fits and _astray(model, row, stance) == least:
                unlike = _unlike(model, avatars, own, row)
                if unlike < gap:
                    found, gap = row, unlike
    return found


@kernel
def _unlike(model, avatars, own, row):
    """Return how far the pose in which an avatar ends its action, and its motion, are from the start of a fall.

    That is the sum of squares over head, trunk, elbows and fists, and over how far these move in a control frame [m2].
    """
    bodies, arms, ground = model.bodies, model.arms, model.ground
    action, stride = avatars.whole[ACTION, own], model.policies[avatars.whole[POLICY, own], STRIDE]
    left = model.actions[action, ORIGIN] + model.actions[action, LENGTH] * stride
    entered = model.actions[model.falls[row, FALL_ACTION], ORIGIN]
    own_x, own_z = _way(ground, left - stride, left)
    its_x, its_z = _way(ground, entered, entered + stride)
    gap = 0.0
    for k in range(bodies.shape[1] + arms.shape[1]):
        rows, c = (bodies, k) if k < bodies.shape[1] else (arms, k - bodies.shape[1])
        here, there = rows[left, c], rows[entered, c]
        moved = (here - rows[left - stride, c]) - (rows[entered + stride, c] - there)
        moved += (own_x - its_x) * (c % 3 == 0) + (own_z - its_z) * (c % 3 == 2)
        gap += (here - there) ** 2 + (LASTS * moved) ** 2
    return gap


@kernel(inline=True)
def _way(ground, before, after):
    """Return how far a ground transform goes between frames, seen from the first: x, z [m]."""
    cos, sin = cos_sin(ground[before, 2])
    dx, dz = ground[after, 0] - ground[before, 0], ground[after, 1] - ground[before, 1]
    return dx * cos - dz * sin, dx * sin + dz * cos


@kernel
def _unfit(model, avatars, own, row, blow, nearest, observed, q):
    """Return how unfit a fall or stagger is: how far it leads aside from a blow, and how little room there is."""
    aside = _apart(model.fall_directions[row], blow) - nearest
    if aside > FURTHEST_ASIDE:
        return math.inf
    unfit = ASIDE * max(aside - LIKE, 0.0)
    if model.falls[row, FALL_KIND] != FALLS:
        return math.inf if aside > LIKE or _ends_on_body(model, avatars, own, row, observed, q) else unfit
    return unfit + _crowded(model, avatars, own, row, 0.0, 0.0, observed, q)


@kernel
def _crowded(model, avatars, own, row, dx, dz, observed, q):
    """Return how little room there is after a fall that ends further on by (dx, dz) [m].

    The square of the room that lacks is a whole number of parts, so that sums do not depend on the order of neighbours.
    """
    whole, real, size = avatars.whole, avatars.real, avatars.real[SCALE, own]
    cos, sin = cos_sin(real[HEADING, own])
    axis = axis_after(model, row, FROM_START, real[X, own] + dx, real[Z, own] + dz, cos * size, sin * size)
    crowded = 0.0
    for m in range(observed.counts[q]):
        j = observed.neighbours[q, m]
        if whole[TEAM, j] < 0 and is_on_floor(avatars, j):
            lack = max(SIDE_BY_SIDE - axes_apart(axis, axis_of(model, avatars, j)), 0.0)
            crowded += math.floor(PARTS * lack * lack)
        else:
            lack = max(STANDS_BY - from_axis(axis, real[END_X, j], real[END_Z, j]), 0.0)
            crowded += math.floor(0.5 * PARTS * lack * lack)
    return crowded / PARTS


@kernel
def _slide(model, avatars, own, row, observed, q):
    """Choose how far a body slides while it falls: to the place with the most room, or nowhere if none has more."""
    real = avatars.real
    real[SLIDE_X, own], real[SLIDE_Z, own] = 0.0, 0.0
    least = _crowded(model, avatars, own, row, 0.0, 0.0, observed, q)
    for way in range(2 * WAYS):
        # Half the distance in every direction first, then the whole: among equals the shorter slide counts.
        far = SLIDES if way >= WAYS else 0.5 * SLIDES
        cos, sin = cos_sin(2.0 * math.pi * way / WAYS)
        crowded = _crowded(model, avatars, own, row, far * sin, far * cos, observed, q)
        if crowded < least:
            least, real[SLIDE_X, own], real[SLIDE_Z, own] = crowded, far * sin, far * cos


@kernel(inline=True)
def _ends_on_body(model, avatars, own, row, observed, q):
    """Return whether a stagger leads onto a body on the floor: close to its axis, and closer than the avatar is."""
    real, action = avatars.real, model.falls[row, FALL_ACTION]
    x, z, size = real[X, own], real[Z, own], real[SCALE, own]
    cos, sin = cos_sin(real[HEADING, own])
    ex, ez = model.moves[action, MOVE_X] * size, model.moves[action, MOVE_Z] * size
    dx, dz = ex * cos + ez * sin, ez * cos - ex * sin
    found = False
    for m in range(observed.counts[q]):
        j = observed.neighbours[q, m]
        if avatars.whole[TEAM, j] < 0 and is_on_floor(avatars, j):
            axis = axis_of(model, avatars, j)
            near = min(from_axis(axis, x + 0.5 * dx, z + 0.5 * dz), from_axis(axis, x + dx, z + dz))
            found |= near < min(STAGGERS_BY, from_axis(axis, x, z))
    return found


@kernel(inline=True)
def _astray(model, row, stance):
    """Return how many actions from a stance a stagger ends, or an avatar gets up after a fall; 0 for any stance."""
    if stance == 0:
        return 0
    action = np.int64(model.falls[row, FALL_ACTION])
    if model.falls[row, FALL_KIND] == FALLS:
        action = np.int64(_part_of(model, row, STANDS_UP))
    return np.int64(model.stances[model.actions[action, NEXT], stance - 1])


@kernel(inline=True)
def _apart(one, other):
    """Return the angle between two directions [rad]."""
    turn = one - other
    return abs(turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5))


@kernel(inline=True)
def note_condition(model, avatars, world, frame, i, action):
    """Note what an avatar does from now on, as it starts an action; and what that takes from its stamina."""
    whole = avatars.whole
    row, rules = avatars.conditions[whole[NUMBER, i]], world.rules[whole[COHORT, i]]
    row[DOES] = row[DOES_NEXT]
    frames = model.actions[action, LENGTH] / avatars.real[SPEED, i]
    strikes = model.actions[action + 1, STRIKES] - model.actions[action, STRIKES]
    x, z = model.moves[action, MOVE_X], model.moves[action, MOVE_Z]
    spent = rules[STRIKE_TIRES] * strikes + rules[RUN_TIRES] * math.sqrt(x * x + z * z)
    row[STAMINA] = min(max(row[STAMINA] - spent, 0.0) + rules[REST_GAIN] * frames, 1.0)
    if row[STANDING_NEXT] == FALLING and row[STANDING] == DROPS:
        out = row[HEALTH] <= 0.0 or row[DOWNS] >= rules[MOST_DOWNS]
        row[RISES] = math.inf if out else frame + frames + rules[DOWN_FRAMES]
    row[STANDING] = row[STANDING_NEXT]
    if row[STANDING] == UP and whole[TEAM, i] < 0:
        whole[TEAM, i] = -2 - whole[TEAM, i]

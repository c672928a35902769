"""Where avatars fall and stagger: the way the blow sends them, where there is room, as their motion leads into it."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.fall_clearance import roomiest
from crowdsim.crowd.kernels.layout import (
    ACTION,
    FALL_ACTION,
    FALL_KIND,
    FALL_POLICY,
    FALL_ROW,
    FALLS,
    HEADING,
    HIT_X,
    HIT_Z,
    LENGTH,
    MOVE_COS,
    MOVE_SIN,
    MOVE_X,
    MOVE_Z,
    NEXT,
    NUMBER,
    ORIGIN,
    POLICY,
    SCALE,
    STANCE,
    STANDS_UP,
    STRIDE,
    STUMBLES_ON,
    TEAM,
    X,
    Z,
)
from crowdsim.crowd.kernels.lying import axis_of, from_axis, is_on_floor
from crowdsim.jit import kernel

NOWHERE = 1 << 30  # actions from a stance, before any fall is looked at
LIKE = 0.6  # directions of falls are alike that differ by no more from the nearest one to the blow's [rad]
FURTHEST_ASIDE = 2.0  # how much further aside a body falls at the most where there is no room [rad]
ASIDE = 0.1  # how much a radian aside counts, beside the square of the room that lacks [m2]
LASTS = 2.0  # how much motion in a control frame counts beside poses
STAGGERS_BY = 0.7  # how far from the axis of a body others stagger [m]


@kernel(inline=True)
def part_of(model, fall, kind):
    """Return the action of a kind that belongs to a fall."""
    for row in range(model.falls.shape[0]):
        if model.falls[row, FALL_KIND] == kind and model.falls[row, FALL_ROW] == fall:
            return model.falls[row, FALL_ACTION]
    return -1


@kernel(inline=True)
def next_piece(model, row):
    """Return the row of ``Model.falls`` with the next piece of a stagger, by that of a piece; -1 behind the last one.

    Falls are followed by none.
    """
    following = row + 1
    if following < model.falls.shape[0] and model.falls[following, FALL_KIND] == STUMBLES_ON:
        return following
    return -1


@kernel(inline=True)
def pick_fall(model, avatars, world, own, kind, observed, q):
    """Return a row of ``Model.falls`` that leads where the last blow came to, and begins most alike; -1 for none.

    A body falls where most room is, if need be further aside, and staggers nowhere onto others. Of falls alike only
    those count that lead to the avatar's stance, or nearest to it.
    """
    whole, real, falls = avatars.whole, avatars.real, model.falls
    policy, stance = whole[POLICY, own], int(avatars.conditions[whole[NUMBER, own], STANCE])
    blow = math.atan2(real[HIT_X, own], real[HIT_Z, own]) - real[HEADING, own]
    nearest = math.inf
    for row in range(falls.shape[0]):
        if falls[row, FALL_POLICY] == policy and falls[row, FALL_KIND] == kind:
            nearest = min(nearest, _apart(model.fall_directions[row], blow))
    found, best, least, gap = -1, math.inf, NOWHERE, math.inf
    for row in range(falls.shape[0]):
        if falls[row, FALL_POLICY] != policy or falls[row, FALL_KIND] != kind:
            continue
        unfit = _unfit(model, avatars, own, row, blow, nearest, observed, q)
        if unfit > best or unfit == math.inf:
            continue
        astray, unlike = _astray(model, row, stance), _unlike(model, avatars, own, row)
        if unfit < best or astray < least or (astray == least and unlike < gap):
            found, best, least, gap = row, unfit, astray, unlike
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
    return unfit + roomiest(model, avatars, own, row, observed, q)[0]


@kernel(inline=True)
def _ends_on_body(model, avatars, own, row, observed, q):
    """Return whether a stagger leads onto a body on the floor: close to its axis, and closer than the avatar is."""
    real, piece = avatars.real, row
    x, z, size = real[X, own], real[Z, own], real[SCALE, own]
    cos, sin = cos_sin(real[HEADING, own])
    dx, dz = 0.0, 0.0
    while piece >= 0:
        move = model.moves[model.falls[piece, FALL_ACTION]]
        ex, ez = move[MOVE_X] * size, move[MOVE_Z] * size
        dx, dz = dx + ex * cos + ez * sin, dz + ez * cos - ex * sin
        turned, aside = move[MOVE_COS], move[MOVE_SIN]
        cos, sin = cos * turned - sin * aside, sin * turned + cos * aside
        piece = next_piece(model, piece)
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
        action = np.int64(part_of(model, row, STANDS_UP))
    return np.int64(model.stances[model.actions[action, NEXT], stance - 1])


@kernel(inline=True)
def _apart(one, other):
    """Return the angle between two directions [rad]."""
    turn = one - other
    return abs(turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5))

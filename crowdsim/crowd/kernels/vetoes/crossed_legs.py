"""Crossed legs: actions that end with a leg in the leg of a neighbour."""

from crowdsim.core.angles import cos_sin
from crowdsim.core.segments import square_between
from crowdsim.crowd.kernels.layout import (
    ACTION,
    BASE_TURN,
    END_COST,
    END_X,
    END_Z,
    HEADING,
    LENGTH,
    MOVE_COS,
    MOVE_SIN,
    MOVE_X,
    MOVE_Z,
    NEXT,
    ORIGIN,
    POLICY,
    SCALE,
    STRIDE,
    TEAM,
    X,
    Z,
)
from crowdsim.jit import kernel

CROSSED = 1.0  # what an action costs that ends so, in normalised values
APART = 0.13  # how far apart shins of two avatars should be [m]
WITHIN = 1.1  # distance of two avatars from which on legs are not compared [m]
WIDE = 12  # column of ``Model.legs``


@kernel(inline=True)
def crosses_legs(model, avatars, world, now, own, observed, q, action):
    """Return what an action costs that ends with a leg in a neighbour's, which is where its own action ends; else 0."""
    whole, real, moves = avatars.whole, avatars.real, model.moves
    if world.crowding[END_COST] <= 0.0:
        return 0.0
    size = real[SCALE, own]
    cos, sin = cos_sin(real[HEADING, own])
    ex, ez = moves[action, MOVE_X] * size, moves[action, MOVE_Z] * size
    x, z = real[X, own] + ex * cos + ez * sin, real[Z, own] + ez * cos - ex * sin
    turned, aside = moves[action, MOVE_COS], moves[action, MOVE_SIN]
    cos, sin = (cos * turned - sin * aside) * size, (sin * turned + cos * aside) * size
    state = model.actions[action, NEXT]
    wide = size * model.legs[state, WIDE]
    for m in range(observed.counts[q]):
        j = observed.neighbours[q, m]
        dx, dz = real[END_X, j] - x, real[END_Z, j] - z
        if dx * dx + dz * dz > WITHIN * WITHIN or whole[TEAM, j] < 0:
            continue
        scale, other = real[SCALE, j], whole[ACTION, j]
        theirs = model.actions[other, NEXT]
        reach = APART * 0.5 * (size + scale)
        near = reach + wide + scale * model.legs[theirs, WIDE]
        if dx * dx + dz * dz > near * near:
            continue
        last = model.actions[other, ORIGIN] + model.actions[other, LENGTH] * model.policies[whole[POLICY, j], STRIDE]
        cos_2, sin_2 = cos_sin(real[BASE_TURN, j] + model.ground[last, 2])
        cos_2, sin_2 = cos_2 * scale, sin_2 * scale
        # Most legs are separated along the line from one avatar to the other, and need no exact distance.
        ahead = _furthest_along(model.legs, state, dx * cos - dz * sin, dx * sin + dz * cos)
        behind = _furthest_along(model.legs, theirs, dz * sin_2 - dx * cos_2, -dx * sin_2 - dz * cos_2)
        square = dx * dx + dz * dz
        free = square - ahead - behind
        if free > 0.0 and free * free > 1.0001 * reach * reach * square:
            continue
        for leg in range(2):
            knee = _leg_point(model.legs, state, 6 * leg, 0.0, 0.0, size, cos, sin)
            sole = _leg_point(model.legs, state, 6 * leg + 3, 0.0, 0.0, size, cos, sin)
            for their in range(2):
                knee_2 = _leg_point(model.legs, theirs, 6 * their, dx, dz, scale, cos_2, sin_2)
                sole_2 = _leg_point(model.legs, theirs, 6 * their + 3, dx, dz, scale, cos_2, sin_2)
                if square_between(knee, sole, knee_2, sole_2) < reach * reach:
                    return CROSSED
    return 0.0


@kernel(inline=True)
def _furthest_along(legs, state, aside, onwards):
    """Return how far knees and soles of a state reach along a vector in the ground frame, times its length."""
    left = max(legs[state, 0] * aside + legs[state, 2] * onwards, legs[state, 3] * aside + legs[state, 5] * onwards)
    right = max(legs[state, 6] * aside + legs[state, 8] * onwards, legs[state, 9] * aside + legs[state, 11] * onwards)
    return max(left, right)


@kernel(inline=True)
def _leg_point(legs, state, column, x, z, size, cos, sin):
    """Return a point of the legs of an avatar at (x, z) in a state: three columns of ``Model.legs``."""
    px, pz = legs[state, column], legs[state, column + 2]
    return x + px * cos + pz * sin, legs[state, column + 1] * size, z - px * sin + pz * cos

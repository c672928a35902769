"""Crossed legs: actions that end with a leg in the leg of a neighbour."""

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.segments import square_between
from crowdsim.crowd.kernels.layout import KNEE, LEFT, RIGHT, SOLE
from crowdsim.jit import kernel

CROSSED = 1.0  # what an action costs that ends so, in normalised values
APART = 0.13  # how far apart shins of two avatars should be [m]
WITHIN = 1.1  # distance of two avatars from which on legs are not compared [m]


@kernel(inline=True)
def crosses_legs(model, avatars, world, now, own, observed, q, action):
    """Return what an action costs that ends with a leg in a neighbour's, which is where its own action ends; else 0."""
    motion, playback = avatars.motion, avatars.playback
    moves = model.moves
    if world.crowding.end_cost <= 0.0:
        return 0.0
    size = np.float64(playback[own].scale)
    cos, sin = cos_sin(avatars.heading[own])
    ex, ez = moves[action].x * size, moves[action].z * size
    x, z = avatars.x[own] + ex * cos + ez * sin, avatars.z[own] + ez * cos - ex * sin
    turned, aside = moves[action].cos, moves[action].sin
    cos, sin = (cos * turned - sin * aside) * size, (sin * turned + cos * aside) * size
    state = model.actions[action].next
    wide = size * model.leg_reaches[state]
    for m in range(observed.counts[q]):
        j = np.int64(observed.neighbours[q, m])
        dx, dz = motion[j].end_x - x, motion[j].end_z - z
        if dx * dx + dz * dz > WITHIN * WITHIN or avatars.team[j] < 0:
            continue
        scale, other = np.float64(playback[j].scale), motion[j].action
        theirs = model.actions[other].next
        reach = APART * 0.5 * (size + scale)
        near = reach + wide + scale * model.leg_reaches[theirs]
        if dx * dx + dz * dz > near * near:
            continue
        last = model.actions[other].origin + model.actions[other].length * model.policies[avatars.policy[j]].stride
        cos_2, sin_2 = cos_sin(playback[j].base_turn + model.ground[last].heading)
        cos_2, sin_2 = cos_2 * scale, sin_2 * scale
        # Most legs are separated along the line from one avatar to the other, and need no exact distance.
        ahead = _furthest_along(model.legs, state, dx * cos - dz * sin, dx * sin + dz * cos)
        behind = _furthest_along(model.legs, theirs, dz * sin_2 - dx * cos_2, -dx * sin_2 - dz * cos_2)
        square = dx * dx + dz * dz
        free = square - ahead - behind
        if free > 0.0 and free * free > 1.0001 * reach * reach * square:
            continue
        for leg in range(2):
            knee = _leg_point(model.legs, state, leg, KNEE, 0.0, 0.0, size, cos, sin)
            sole = _leg_point(model.legs, state, leg, SOLE, 0.0, 0.0, size, cos, sin)
            for their in range(2):
                knee_2 = _leg_point(model.legs, theirs, their, KNEE, dx, dz, scale, cos_2, sin_2)
                sole_2 = _leg_point(model.legs, theirs, their, SOLE, dx, dz, scale, cos_2, sin_2)
                if square_between(knee, sole, knee_2, sole_2) < reach * reach:
                    return CROSSED
    return 0.0


@kernel(inline=True)
def _furthest_along(legs, state, aside, onwards):
    """Return how far knees and soles of a state reach along a vector in the ground frame, times its length."""
    left = max(_along(legs, state, LEFT, KNEE, aside, onwards), _along(legs, state, LEFT, SOLE, aside, onwards))
    right = max(_along(legs, state, RIGHT, KNEE, aside, onwards), _along(legs, state, RIGHT, SOLE, aside, onwards))
    return max(left, right)


@kernel(inline=True)
def _along(legs, state, leg, point, aside, onwards):
    """Return how far a point of a leg reaches along a vector in the ground frame, times its length."""
    return legs[state, leg, point, 0] * aside + legs[state, leg, point, 2] * onwards


@kernel(inline=True)
def _leg_point(legs, state, leg, point, x, z, size, cos, sin):
    """Return knee or sole of a leg of an avatar at (x, z) in a state."""
    px, pz = legs[state, leg, point, 0], legs[state, leg, point, 2]
    return x + px * cos + pz * sin, legs[state, leg, point, 1] * size, z - px * sin + pz * cos

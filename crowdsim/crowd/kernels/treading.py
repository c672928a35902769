"""How soles in an action come onto a body on the floor: capsules of the body against every control frame's soles."""

import math

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.guards import square_between
from crowdsim.crowd.kernels.layout import (
    FALL,
    HEADING,
    LENGTH,
    NUMBER,
    ORIGIN,
    PATH_COS,
    PATH_SIN,
    PATH_X,
    PATH_Z,
    PATHS,
    POLICY,
    RISING,
    SCALE,
    STANDING,
    STRIDE,
    X,
    Z,
)
from crowdsim.crowd.kernels.lying import floor_transform
from crowdsim.jit import kernel

CLEAR, BESIDE = 0.03, 0.27  # how far from bodies soles should be on their way, and where an action ends [m]
STEPS_ON = 0.8  # what a control frame costs in which a sole comes onto a body, over ending with a sole at its surface
NEARER = 0.005  # how much nearer than at the start of the action a sole has to be for that [m]
LEFT, RIGHT = 0, 6  # columns of ``Model.soles``


@kernel
def treads_on(model, avatars, own, action, j):
    """Return how much an action of an avatar treads on a body on the floor: 1 for a sole that ends at its surface.

    A sole that ends ``BESIDE`` away counts nothing, one inside the body more. To this comes ``STEPS_ON`` for every
    control frame in which a sole is nearer than ``CLEAR``, and nearer than it was. Bodies that get up do not count.
    """
    whole, real, actions, paths = avatars.whole, avatars.real, model.actions, model.paths
    if avatars.conditions[whole[NUMBER, j], STANDING] == RISING:
        return 0.0
    body = floor_transform(model, avatars, j)
    x, z, size = real[X, own], real[Z, own], real[SCALE, own]
    cos, sin = cos_sin(real[HEADING, own])
    cos, sin = cos * size, sin * size
    length, path, origin = actions[action, LENGTH], actions[action, PATHS], actions[action, ORIGIN]
    stride = model.policies[whole[POLICY, own], STRIDE]
    stands = (x, z, cos, sin)
    left = min(_sole_gap(model, avatars, j, body, origin, LEFT, stands) - NEARER, CLEAR)
    right = min(_sole_gap(model, avatars, j, body, origin, RIGHT, stands) - NEARER, CLEAR)
    steps, gap, other = 0, math.inf, math.inf
    for t in range(length):
        dx, dz = paths[PATH_X, path + t], paths[PATH_Z, path + t]
        turned, aside = paths[PATH_COS, path + t], paths[PATH_SIN, path + t]
        then_cos, then_sin = cos * turned - sin * aside, sin * turned + cos * aside
        stands = (x + dx * cos + dz * sin, z + dz * cos - dx * sin, then_cos, then_sin)
        frame = origin + (t + 1) * stride
        gap = _sole_gap(model, avatars, j, body, frame, LEFT, stands)
        other = _sole_gap(model, avatars, j, body, frame, RIGHT, stands)
        steps += (gap < left) + (other < right)
    return max(1.0 - gap / BESIDE, 0.0) + max(1.0 - other / BESIDE, 0.0) + STEPS_ON * steps


@kernel
def _sole_gap(model, avatars, j, body, frame, sole, stands):
    """Return how far a sole, of an avatar that stands somewhere in a frame, is from a body; negative inside [m]."""
    heel = _sole_point(model.soles, frame, sole, stands)
    ball = _sole_point(model.soles, frame, sole + 3, stands)
    fall, size = int(avatars.conditions[avatars.whole[NUMBER, j], FALL]), avatars.real[SCALE, j]
    x, z, turn = body
    cos, sin = cos_sin(turn)
    cos, sin = cos * size, sin * size
    gap = math.inf
    for k in range(model.fall_capsules.shape[1]):
        row = model.fall_capsules[fall, k]
        start = (x + row[0] * cos + row[2] * sin, row[1] * size, z - row[0] * sin + row[2] * cos)
        end = (x + row[3] * cos + row[5] * sin, row[4] * size, z - row[3] * sin + row[5] * cos)
        gap = min(gap, math.sqrt(square_between(heel, ball, start, end)) - row[6] * size)
    return gap


@kernel(inline=True)
def _sole_point(soles, frame, column, stands):
    """Return heel or ball of a sole [m]; where the avatar stands is x, z, cosine and sine times its size."""
    x, z, cos, sin = stands
    px, pz, size = soles[frame, column], soles[frame, column + 2], math.sqrt(cos * cos + sin * sin)
    return x + px * cos + pz * sin, soles[frame, column + 1] * size, z - px * sin + pz * cos

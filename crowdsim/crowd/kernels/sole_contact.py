"""How soles in an action come onto a body on the floor: capsules of the body against every control frame's soles."""

import math

import numpy as np

from crowdsim.core.segments import square_between
from crowdsim.crowd.kernels.layout import BALL, HEEL, LEFT, RIGHT, RISING
from crowdsim.crowd.kernels.lying import floor_transform, placed, seen_from
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel

CLEAR, BESIDE = 0.03, 0.27  # how far from bodies soles should be on their way, and where an action ends [m]
STEPS_ON = 0.8  # what a control frame costs in which a sole comes onto a body, over ending with a sole at its surface
NEARER = 0.005  # how much nearer than at the start of the action a sole has to be for that [m]


@kernel
def treads_on(model, avatars, own, action, j):
    """Return how much an action of an avatar treads on a body on the floor: 1 for a sole that ends at its surface.

    A sole that ends ``BESIDE`` away counts nothing, one inside the body more. To this comes ``STEPS_ON`` for every
    control frame in which a sole is nearer than ``CLEAR``, and nearer than it was. Bodies that get up do not count.
    """
    actions, paths = model.actions, model.paths
    row = avatars.conditions[avatars.number[j]]
    if row.standing == RISING:
        return 0.0
    capsules, unit = model.fall_capsules[int(row.fall)], np.float64(avatars.playback[j].scale)
    px, pz, turn = floor_transform(model, avatars, j)
    own_x, own_z = position_of(avatars, own)
    there = (own_x, own_z, np.float64(avatars.heading[own]), np.float64(avatars.playback[own].scale))
    stands = seen_from((px, pz, turn, unit), there)
    x, z, cos, sin, size = stands
    length, path, origin = actions[action].length, actions[action].paths, actions[action].origin
    stride = model.policies[avatars.policy[own]].stride
    beside, clear = BESIDE / unit, CLEAR / unit
    left = min(sole_gap(model.soles, capsules, origin, LEFT, stands, beside) - NEARER / unit, clear)
    right = min(sole_gap(model.soles, capsules, origin, RIGHT, stands, beside) - NEARER / unit, clear)
    steps, gap, other = 0, beside, beside
    for t in range(length):
        dx, dz = paths.x[path + t], paths.z[path + t]
        turned, aside = paths.cos[path + t], paths.sin[path + t]
        then_cos, then_sin = cos * turned - sin * aside, sin * turned + cos * aside
        stands = (x + dx * cos + dz * sin, z + dz * cos - dx * sin, then_cos, then_sin, size)
        frame = origin + (t + 1) * stride
        gap = sole_gap(model.soles, capsules, frame, LEFT, stands, beside)
        other = sole_gap(model.soles, capsules, frame, RIGHT, stands, beside)
        steps += (gap < left) + (other < right)
    return 2.0 - (gap + other) / beside + STEPS_ON * steps


@kernel
def sole_gap(soles, capsules, frame, sole, stands, most):
    """Return how far a sole, of an avatar that stands somewhere in a frame, is from capsules, at ``most``.

    It is negative inside them. ``stands`` is what ``lying.seen_from`` returns.
    """
    heel, ball = _sole_point(soles, frame, sole, HEEL, stands), _sole_point(soles, frame, sole, BALL, stands)
    x, y, z = 0.5 * (heel[0] + ball[0]), 0.5 * (heel[1] + ball[1]), 0.5 * (heel[2] + ball[2])
    half = math.sqrt((ball[0] - x) ** 2 + (ball[1] - y) ** 2 + (ball[2] - z) ** 2)
    gap = most
    for k in range(capsules.shape[0]):
        capsule = capsules[k]
        dx, dy = 0.5 * (capsule.x + capsule.to_x) - x, 0.5 * (capsule.y + capsule.to_y) - y
        dz = 0.5 * (capsule.z + capsule.to_z) - z
        reach = capsule.bound + half + gap
        if dx * dx + dy * dy + dz * dz < reach * reach:
            start, end = (capsule.x, capsule.y, capsule.z), (capsule.to_x, capsule.to_y, capsule.to_z)
            gap = min(gap, math.sqrt(square_between(heel, ball, start, end)) - capsule.radius)
    return gap


@kernel(inline=True)
def _sole_point(soles, frame, sole, end, stands):
    """Return heel or ball of a sole of an avatar that stands somewhere."""
    return placed(soles[frame, sole, end, 0], soles[frame, sole, end, 1], soles[frame, sole, end, 2], stands)

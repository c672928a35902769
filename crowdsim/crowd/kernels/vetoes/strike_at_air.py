"""Strikes at air: those that would end far from where the opponent is going."""

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.lying import from_axis
from crowdsim.crowd.kernels.positions import course_of
from crowdsim.jit import kernel

AIR = 0.5  # how far from an opponent a strike is thrown at air [m]


@kernel(inline=True)
def strikes_air(model, avatars, world, now, own, observed, q, action):
    """Return what an action costs whose first strike would end far from the opponent's way; 0 for others.

    The way leads to where the opponent's own action ends.
    """
    strikes = model.strikes
    first, opponent = model.actions[action].strikes, avatars.fight[own].next_opponent
    if world.crowding.at_air <= 0.0 or first == model.actions[action + 1].strikes or opponent < 0:
        return 0.0
    j = avatars.slot_of[opponent]
    if j >= now.present:
        return 0.0
    cos, sin = cos_sin(avatars.heading[own])
    size = np.float64(avatars.playback[own].scale)
    fx, fz = strikes[first].x * size, strikes[first].z * size
    x, z = avatars.x[own] + fx * cos + fz * sin, avatars.z[own] - fx * sin + fz * cos
    way = course_of(avatars, j)
    return world.crowding.at_air if from_axis(way, x, z) > AIR else 0.0

"""Strikes at air: those that would end far from where the opponent is going."""

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.layout import (
    AT_AIR,
    END_X,
    END_Z,
    FIST_X,
    FIST_Z,
    HEADING,
    NEXT_OPPONENT,
    SCALE,
    STRIKES,
    Axis,
    X,
    Z,
)
from crowdsim.crowd.kernels.lying import from_axis
from crowdsim.jit import kernel

AIR = 0.6  # how far from an opponent a strike is thrown at air [m]


@kernel(inline=True)
def strikes_air(model, avatars, world, now, own, observed, q, action):
    """Return what an action costs whose first strike would end far from the opponent's way; 0 for others.

    The way leads to where the opponent's own action ends.
    """
    whole, real, strikes = avatars.whole, avatars.real, model.strikes
    first, opponent = model.actions[action, STRIKES], whole[NEXT_OPPONENT, own]
    if world.crowding[AT_AIR] <= 0.0 or first == model.actions[action + 1, STRIKES] or opponent < 0:
        return 0.0
    j = avatars.slot_of[opponent]
    if j >= now.present:
        return 0.0
    cos, sin = cos_sin(real[HEADING, own])
    fx, fz = strikes[first, FIST_X] * real[SCALE, own], strikes[first, FIST_Z] * real[SCALE, own]
    x, z = real[X, own] + fx * cos + fz * sin, real[Z, own] - fx * sin + fz * cos
    way = Axis(real[X, j], real[Z, j], real[END_X, j], real[END_Z, j])
    return world.crowding[AT_AIR] if from_axis(way, x, z) > AIR else 0.0

"""Strikes at air: those that would end far from where the opponent is going, in an action or soon after it."""

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.breaking_off import strike_after
from crowdsim.crowd.kernels.layout import Axis
from crowdsim.crowd.kernels.lying import from_axis
from crowdsim.jit import kernel

AIR = 0.45  # how far from an opponent a strike is thrown at air [m]


@kernel(inline=True)
def strikes_air(model, avatars, world, now, own, observed, q, action):
    """Return what an action costs whose first strike would end far from the opponent's way; 0 for others.

    Likewise where a strike has to follow it. The way leads to where the opponent's own action ends.
    """
    first, opponent = model.actions[action].strikes, avatars.fight[own].next_opponent
    strikes, follows = first < model.actions[action + 1].strikes, model.bound[model.actions[action].next]
    if world.crowding.at_air <= 0.0 or not (strikes or follows >= 0) or opponent < 0:
        return 0.0
    j = avatars.slot_of[opponent]
    if j >= now.present:
        return 0.0
    far = False
    if strikes:
        far = _ends_far(avatars, own, j, model.strikes[first].x, model.strikes[first].z)
    if follows >= 0 and not far:
        x, z = strike_after(model, action)
        far = _ends_far(avatars, own, j, x, z)
    return world.crowding.at_air if far else 0.0


@kernel(inline=True)
def _ends_far(avatars, own, j, x, z):
    """Return whether a point that an avatar sees is far from the way of another one."""
    size = avatars.playback[own].scale
    cos, sin = cos_sin(avatars.heading[own])
    px, pz = avatars.x[own] + size * (x * cos + z * sin), avatars.z[own] - size * (x * sin - z * cos)
    way = Axis(avatars.x[j], avatars.z[j], avatars.motion[j].end_x, avatars.motion[j].end_z)
    return from_axis(way, px, pz) > AIR

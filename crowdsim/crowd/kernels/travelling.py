"""Avatars that travel along a path: where they see their next point."""

import math

from crowdsim.crowd.kernels.hidden import way_to
from crowdsim.crowd.kernels.layout import TRAVELS, Target
from crowdsim.crowd.kernels.obstacle_steering import go_around
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel

AHEAD = 4.0  # how far ahead the point is seen at least, so that an avatar does not halt before it [m]
LOOKS = 1.5  # height at which it is seen, for a body of scale 1 [m]


@kernel(inline=True)
def travels(avatars, i):
    """Return whether an avatar travels, whatever its opponents do."""
    return avatars.conditions.shape[0] > 0 and avatars.conditions[avatars.number[i]].mode == TRAVELS


@kernel(inline=True)
def see_way(model, avatars, world, frame, own, observed, q):
    """Decide that an avatar travels on, without an opponent; return where it goes, around obstacles and bodies."""
    row = avatars.conditions[avatars.number[own]]
    row.does_next = TRAVELS
    avatars.fight[own].next_opponent = -1
    x, z = position_of(avatars, own)
    size = avatars.playback[own].scale
    way = Target(row.way_x, LOOKS * size, row.way_z, 0.0, 0.0, 0.0)
    if world.places.parts.shape[0] > 0:
        way = way_to(world.places, frame, x, z, way)
    dx, dz = way.x - x, way.z - z
    far = max(math.sqrt(dx * dx + dz * dz), 1e-6)
    part = max(AHEAD * size / far, 1.0)
    return go_around(model, avatars, own, Target(x + part * dx, way.y, z + part * dz, 0.0, 0.0, 0.0), observed, q)

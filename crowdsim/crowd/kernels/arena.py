"""The arena: how far a position lies outside it."""

import math

from crowdsim.crowd.kernels.layout import CIRCLE, RECTANGLE
from crowdsim.jit import kernel


@kernel(inline=True)
def outside(arena, x, z):
    """Return how far a position lies outside the arena [m]; 0 inside."""
    if arena.kind == CIRCLE:
        dx, dz = x - arena.x, z - arena.z
        return max(math.sqrt(dx * dx + dz * dz) - arena.half_x, 0.0)
    if arena.kind == RECTANGLE:
        dx, dz = max(abs(x - arena.x) - arena.half_x, 0.0), max(abs(z - arena.z) - arena.half_z, 0.0)
        return math.sqrt(dx * dx + dz * dz)
    return 0.0


@kernel(inline=True)
def may_leave(arena, x, z, furthest):
    """Return whether an avatar at (x, z) that travels this distance may end outside the arena."""
    dx, dz = abs(x - arena.x), abs(z - arena.z)
    if arena.kind == CIRCLE:
        return furthest > arena.half_x or dx * dx + dz * dz > (arena.half_x - furthest) ** 2
    return arena.kind == RECTANGLE and (dx + furthest > arena.half_x or dz + furthest > arena.half_z)

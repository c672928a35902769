"""The arena: how far a position lies outside it."""

import math

from crowdsim.crowd.kernels.layout import ARENA, CENTRE_X, CENTRE_Z, CIRCLE, HALF_X, HALF_Z, RECTANGLE
from crowdsim.jit import kernel


@kernel(inline=True)
def outside(arena, x, z):
    """Return how far a position lies outside the arena [m]; 0 inside."""
    if arena[ARENA] == CIRCLE:
        dx, dz = x - arena[CENTRE_X], z - arena[CENTRE_Z]
        return max(math.sqrt(dx * dx + dz * dz) - arena[HALF_X], 0.0)
    if arena[ARENA] == RECTANGLE:
        dx, dz = max(abs(x - arena[CENTRE_X]) - arena[HALF_X], 0.0), max(abs(z - arena[CENTRE_Z]) - arena[HALF_Z], 0.0)
        return math.sqrt(dx * dx + dz * dz)
    return 0.0


@kernel(inline=True)
def may_leave(arena, x, z, furthest):
    """Return whether an avatar at (x, z) that travels this distance may end outside the arena."""
    dx, dz = abs(x - arena[CENTRE_X]), abs(z - arena[CENTRE_Z])
    if arena[ARENA] == CIRCLE:
        return furthest > arena[HALF_X] or dx * dx + dz * dz > (arena[HALF_X] - furthest) ** 2
    return arena[ARENA] == RECTANGLE and (dx + furthest > arena[HALF_X] or dz + furthest > arena[HALF_Z])

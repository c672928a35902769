"""Whether a fist lands on a posed body: within a tolerance of the surface of head and torso (``policy.rewards.lands``).

A body is a ball, the head, and a capsule, the torso; its signed distance is the lesser of the distances from the two.
Points are tuples of three numbers [m].
"""

import math
from typing import Any, NamedTuple

from crowdsim.core.segments import square_from
from crowdsim.jit import kernel

BEYOND = 1.1
"""Square of how much further than a body's axis a kick may end that lands on its side."""


@kernel(inline=True)
def comes_through(x, z, from_x, from_z, axis_x, axis_z):
    """Return whether a kick that ends over (x, z) comes through a body with its axis over a point.

    That is where it ends clearly further from where the kick comes from than the axis is. Where it comes from is given
    for kicks alone; punches have their own end there, and never do.
    """
    far = (x - from_x) ** 2 + (z - from_z) ** 2
    return far > BEYOND * ((axis_x - from_x) ** 2 + (axis_z - from_z) ** 2)


class PosedBody(NamedTuple):
    """A body that may be hit: centre of the head, upper and lower end of the torso, and their radii [m]."""

    head: Any
    neck: Any
    pelvis: Any
    head_radius: float
    torso_radius: float


@kernel(inline=True)
def lands_on_posed_body(fist, body, tolerance):
    """Return whether a fist lands on a ``PosedBody``."""
    return -tolerance <= distance_from_body(fist, body) <= tolerance


@kernel(inline=True)
def distance_from_body(fist, body):
    """Return the signed distance of a fist from the surface of a ``PosedBody``, negative inside [m]."""
    head, neck, pelvis = body.head, body.neck, body.pelvis
    hx, hy, hz = fist[0] - head[0], fist[1] - head[1], fist[2] - head[2]
    distance = math.sqrt(hx * hx + hy * hy + hz * hz) - body.head_radius
    return min(distance, math.sqrt(square_from(fist, pelvis, neck)) - body.torso_radius)

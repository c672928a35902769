"""Playback frames at a fractional frame."""

from crowdsim.jit import kernel


@kernel(inline=True)
def between(points, frame, point, axis):
    """Return a coordinate of one of the ``points`` (L, K, 3) of playback frames at a fractional frame."""
    below = int(frame)
    share = frame - below
    value = float(points[below, point, axis])
    if share > 0.0:
        value += share * (points[below + 1, point, axis] - value)
    return value


@kernel(inline=True)
def ground_at(ground, frame):
    """Return the ground transform at a fractional frame: x, z [m] and heading [rad]."""
    below = int(frame)
    share = frame - below
    x, z, heading = ground[below].x, ground[below].z, ground[below].heading
    if share > 0.0:
        x += share * (ground[below + 1].x - x)
        z += share * (ground[below + 1].z - z)
        heading += share * (ground[below + 1].heading - heading)
    return x, z, heading


@kernel(inline=True)
def point_at(points, frame, point, x, z, size, cos, sin):
    """Return the position of one of the ``points`` of a body at (x, z), at a fractional frame."""
    px, pz = between(points, frame, point, 0), between(points, frame, point, 2)
    return x + px * cos + pz * sin, between(points, frame, point, 1) * size, z - px * sin + pz * cos

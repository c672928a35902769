"""Compiled distances of points and segments, such as the axes of capsules."""

import math

from crowdsim.jit import kernel

_POINT = 1e-12
"""Square of the length below which a segment is a point [m2]."""


@kernel(inline=True)
def square_from(point, start, end):
    """Return the square of a point's distance from a segment."""
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    lx, ly, lz = point[0] - start[0], point[1] - start[1], point[2] - start[2]
    square = dx * dx + dy * dy + dz * dz
    t = 0.0
    if square > 0.0:
        t = min(max((lx * dx + ly * dy + lz * dz) / square, 0.0), 1.0)
    lx, ly, lz = lx - t * dx, ly - t * dy, lz - t * dz
    return lx * lx + ly * ly + lz * lz


@kernel(inline=True)
def square_between(p, q, r, s):
    """Return the square of the distance between the segments p q and r s.

    After Ericson, Real-Time Collision Detection (2005), section 5.1.9. Of single numbers it is less accurate than
    ``nearest_on_segments`` where segments are almost parallel.
    """
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = s[0] - r[0], s[1] - r[1], s[2] - r[2]
    wx, wy, wz = p[0] - r[0], p[1] - r[1], p[2] - r[2]
    a, e, b = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    c, f = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    across = a * e - b * b
    t = min(max((b * f - c * e) / across, 0.0), 1.0) if across > _POINT else 0.0
    u = (b * t + f) / e if e > _POINT else 0.0
    if u < 0.0 or u > 1.0:
        u = min(max(u, 0.0), 1.0)
        t = min(max((b * u - c) / a, 0.0), 1.0) if a > _POINT else 0.0
    x, y, z = wx + t * ux - u * vx, wy + t * uy - u * vy, wz + t * uz - u * vz
    return x * x + y * y + z * z


@kernel
def nearest_on_segments(p, q, r, s):
    """Return where the segments p q and r s are nearest to one another.

    Returns:
        The share of the way from p to q, of the way from r to s, and the distance there.
    """
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = s[0] - r[0], s[1] - r[1], s[2] - r[2]
    wx, wy, wz = p[0] - r[0], p[1] - r[1], p[2] - r[2]
    a, e, b = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    c, f = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    square = a * e - b * b
    t = min(max((b * f - c * e) / square, 0.0), 1.0) if square > _POINT else 0.0
    u = min(max((b * t + f) / e, 0.0), 1.0) if e > _POINT else 0.0
    t = min(max((b * u - c) / a, 0.0), 1.0) if a > _POINT else 0.0
    x, y, z = wx + t * ux - u * vx, wy + t * uy - u * vy, wz + t * uz - u * vz
    return t, u, math.sqrt(x * x + y * y + z * z)

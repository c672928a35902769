"""Squares of distances of points and lines in space."""

from crowdsim.jit import kernel


@kernel(inline=True)
def square_from(point, start, end):
    """Return the square of a point's distance from the line between two others."""
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    lx, ly, lz = point[0] - start[0], point[1] - start[1], point[2] - start[2]
    square = dx * dx + dy * dy + dz * dz
    t = 0.0
    if square > 0.0:
        t = min(max((lx * dx + ly * dy + lz * dz) / square, 0.0), 1.0)
    lx, ly, lz = lx - t * dx, ly - t * dy, lz - t * dz
    return lx * lx + ly * ly + lz * lz


@kernel(inline=True)
def square_between(start, end, first, last):
    """Return the square of the least distance between two lines, each from a point to another.

    After Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    ux, uy, uz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    vx, vy, vz = last[0] - first[0], last[1] - first[1], last[2] - first[2]
    wx, wy, wz = start[0] - first[0], start[1] - first[1], start[2] - first[2]
    a, e, b = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    c, f = ux * wx + uy * wy + uz * wz, vx * wx + vy * wy + vz * wz
    across = a * e - b * b
    s = min(max((b * f - c * e) / across, 0.0), 1.0) if across > 1e-12 else 0.0
    t = (b * s + f) / e if e > 1e-12 else 0.0
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((b * t - c) / a, 0.0), 1.0) if a > 1e-12 else 0.0
    dx, dy, dz = wx + s * ux - t * vx, wy + s * uy - t * vy, wz + s * uz - t * vz
    return dx * dx + dy * dy + dz * dz

"""Slow and obvious versions of what the ray-casting kernels compute."""

import numpy as np


def spheres(cone, count=4001):
    """Centres and radii of the spheres that make a rounded cone (8,): middle, half axis, radius, half difference."""
    s = np.linspace(-1.0, 1.0, count)
    return cone[:3] + s[:, None] * cone[3:6], cone[6] + s * cone[7]


def first_hit(direction, cone):
    """Distance at which a ray from the origin enters a rounded cone, and the unit normal there; inf where it misses."""
    centres, radii = spheres(cone)
    along = centres @ direction
    square = np.sum(centres**2, axis=1) - along**2
    half = radii**2 - square
    enters = np.where(half > 0.0, along - np.sqrt(np.maximum(half, 0.0)), np.inf)
    best = int(np.argmin(enters))
    if not np.isfinite(enters[best]):
        return np.inf, np.zeros(3)
    normal = direction * enters[best] - centres[best]
    return float(enters[best]), normal / np.linalg.norm(normal)


def gap(direction, cone):
    """Least distance between a ray and the surface of a rounded cone, negative where it enters."""
    centres, radii = spheres(cone)
    square = np.maximum(np.sum(centres**2, axis=1) - (centres @ direction) ** 2, 0.0)
    return float((np.sqrt(square) - radii).min())


def is_shaded(point, sun, cones):
    """Whether the ray from a point to the sun meets one of some rounded cones."""
    return any(np.isfinite(first_hit(sun, np.concatenate([cone[:3] - point, cone[3:]]))[0]) for cone in cones)


def checker(x, z, wide_x, wide_z, count=81):
    """Mean of a chequered floor of +1 and -1 in squares of 1 m over a rectangle about a place."""
    offsets = (np.arange(count) + 0.5) / count - 0.5
    a = np.where(np.floor(x + wide_x * offsets) % 2 == 0, 1.0, -1.0)
    b = np.where(np.floor(z + wide_z * offsets) % 2 == 0, 1.0, -1.0)
    return float(a.mean() * b.mean())


def to_yuv(picture):
    """Y, U, V of BT.709 in limited range, as floats; U and V of every 2 x 2 pixels."""
    r, g, b = np.moveaxis(picture.astype(float) / 255.0, -1, 0)
    y = 0.2126 * r + 0.7152 * g + 0.0722 * b
    u, v = (b - y) / 1.8556, (r - y) / 1.5748
    small = [plane.reshape(plane.shape[0] // 2, 2, plane.shape[1] // 2, 2).mean(axis=(1, 3)) for plane in (u, v)]
    return 16.0 + 219.0 * y, 128.0 + 224.0 * small[0], 128.0 + 224.0 * small[1]


def beyond_arena(x, z, arena):
    """How far places are outside an arena, negative inside; at the corners of a rectangle along the further axis."""
    kind, cx, cz, half_x, half_z = arena
    if kind == 1.0:
        return np.hypot(x - cx, z - cz) - half_x
    return np.maximum(np.abs(x - cx) - half_x, np.abs(z - cz) - half_z)

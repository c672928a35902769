"""Naive twins of the geometry of obstacles: everything is compared with everything, lines by many points on them."""

import numpy as np


def gap_to(part, x, z):
    """How far points are from a part, by its rectangle's own axes; negative inside."""
    dx, dz = x - part["x"], z - part["z"]
    along, across = dx * part["ux"] + dz * part["uz"], -dx * part["uz"] + dz * part["ux"]
    over, beside = abs(along) - part["half_along"], abs(across) - part["half_across"]
    inside, outside = np.maximum(over, beside), np.hypot(np.maximum(over, 0), np.maximum(beside, 0))
    return np.where((over <= 0) & (beside <= 0), inside, outside) - part["radius"]


def stands(part, frame):
    return not part["opens"] <= frame < part["closes"]


def gap_at(parts, frame, x, z, reach):
    return min([reach, *(gap_to(part, x, z) for part in parts if stands(part, frame))])


def way_gap(part, start, end, points=2001):
    """How near the points of a straight way come to a part, not below that of its middle line."""
    shares = np.linspace(0, 1, points)[:, None]
    gaps = gap_to(part, *(np.asarray(start) + shares * (np.asarray(end) - start)).T)
    return max(gaps.min(), -part["radius"])


def is_way_free(parts, frame, start, end, height):
    return all(way_gap(p, start, end) > 0 for p in parts if stands(p, frame) and p["height"] >= height)

"""Strikers that go onto bodies, ball by ball and capsule by capsule."""

import numpy as np


def deepest(point, offsets, radii, surface):
    """Return how far outside of capsules (K) the deepest of some balls is, and the way out."""
    best, way = np.inf, np.zeros(3)
    for offset, radius in zip(offsets, radii, strict=True):
        for start, axis, thick in zip(*surface, strict=True):
            share = float(np.clip((point + offset - start) @ axis / max(axis @ axis, 1e-12), 0.0, 1.0))
            out = point + offset - start - share * axis
            gap = np.linalg.norm(out) - thick[0] - share * (thick[1] - thick[0]) - radius
            if gap < best:
                best, way = gap, out / max(np.linalg.norm(out), 1e-9)
    return best, way


def touch(point, offsets, radii, surface, beside, deep, lifted, rounds=60, around=12):
    """Return where the first of a striker's balls touches a body: see ``outlines.touch_surface``."""
    point = np.array(point, float)
    for step in range(rounds):
        before = point.copy()
        gap, way = deepest(point, offsets[1:], radii[1:], surface)
        point += max(-deep - gap, 0.0) * way
        if step < around:
            gap, way = deepest(point, offsets, radii, beside)
            point += max(-gap, 0.0) * way
        gap, way = deepest(point, offsets[:1], radii[:1], surface)
        point -= gap * way
        if np.linalg.norm(point - before) <= 1e-4:
            break
    gap, way = deepest(point, offsets[1:], radii[1:], surface)
    return point + min(max(-deep - gap, 0.0), lifted) * way

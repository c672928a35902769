"""Compiled depth of posed bodies in one another, capsule by capsule."""

import math
from typing import NamedTuple

from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.take.kernels.segments import nearest_on_segments

NEAR = 1.9
"""Distance on the ground of the middles of bodies beyond which they do not touch [m]."""


class Capsules(NamedTuple):
    """Bodies of N avatars at T times, K capsules each.

    Attributes:
        starts: One end of each axis, NaN while absent [m]. Shape (T, N, K, 3).
        ends: The other end [m]. Shape (T, N, K, 3).
        radii: Radius at both ends [m]. Shape (N, K, 2).
        bounds: Radius of a sphere around each [m]. Shape (N, K).
        arms: Whether each is of an arm. Shape (N, K), bool.
        counts: How many capsules each body has. Shape (N,).
    """

    starts: Array
    ends: Array
    radii: Array
    bounds: Array
    arms: Array
    counts: Array


@kernel(allocates=False)
def _depth(capsules, t, a, i, b, j):
    """Return how deep a capsule of one body is in one of another [m]; negative, roughly, where they are apart."""
    p, q = capsules.starts[t, a, i], capsules.ends[t, a, i]
    r, s = capsules.starts[t, b, j], capsules.ends[t, b, j]
    x, y, z = p[0] + q[0] - r[0] - s[0], p[1] + q[1] - r[1] - s[1], p[2] + q[2] - r[2] - s[2]
    if x * x + y * y + z * z > 4.0 * (capsules.bounds[a, i] + capsules.bounds[b, j]) ** 2:
        return -1.0
    share, part, far = nearest_on_segments(p, q, r, s)
    own, other = capsules.radii[a, i], capsules.radii[b, j]
    return own[0] + share * (own[1] - own[0]) + other[0] + part * (other[1] - other[0]) - far


@kernel(allocates=False)
def _compare(capsules, t, a, b, deepest):
    """Raise the greatest depths of two bodies to how deep they are in one another."""
    for i in range(capsules.counts[a]):
        for j in range(capsules.counts[b]):
            depth = _depth(capsules, t, a, i, b, j)
            kind = 1 if capsules.arms[a, i] or capsules.arms[b, j] else 0
            deepest[t, a, kind] = max(deepest[t, a, kind], depth)
            deepest[t, b, kind] = max(deepest[t, b, kind], depth)


@kernel(allocates=False)
def find_penetrations(first, stop, capsules, order, deepest):
    """Find how deep each avatar is in another one, or another one in it.

    Args:
        first: First of the times.
        stop: One past the last.
        capsules: A ``Capsules``; the first of each body lies in its middle.
        order: The avatars by x of that capsule, absent ones last. Shape (T, N).
        deepest: Written: greatest depth between trunks, heads and legs, and of arms; 0 where there is none [m].
            Shape (T, N, 2).
    """
    count = order.shape[1]
    for t in range(first, stop):
        for n in range(count):
            deepest[t, n, 0] = deepest[t, n, 1] = 0.0
        for k in range(count):
            a = order[t, k]
            x, z = capsules.starts[t, a, 0, 0], capsules.starts[t, a, 0, 2]
            if not math.isfinite(x):
                break
            for m in range(k + 1, count):
                b = order[t, m]
                if not capsules.starts[t, b, 0, 0] - x < NEAR:
                    break
                if abs(capsules.starts[t, b, 0, 2] - z) < NEAR:
                    _compare(capsules, t, a, b, deepest)

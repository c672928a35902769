"""Compiled depth of posed bodies in one another, capsule by capsule."""

import math

from crowdsim.jit import kernel
from crowdsim.poses.kernels.capsules import NEAR, are_near, capsule_depth


@kernel
def _compare(capsules, arms, t, a, b, deepest):
    """Raise the greatest depths of two bodies to how deep they are in one another."""
    for i in range(capsules.counts[a]):
        for j in range(capsules.counts[b]):
            if are_near(capsules, t, a, i, b, j, 0.0):
                depth = capsule_depth(
                    capsules.starts[t, a, i], capsules.ends[t, a, i], capsules.radii[a, i],
                    capsules.starts[t, b, j], capsules.ends[t, b, j], capsules.radii[b, j],
                )[0]  # fmt: skip
                kind = 1 if arms[a, i] or arms[b, j] else 0
                deepest[t, a, kind] = max(deepest[t, a, kind], depth)
                deepest[t, b, kind] = max(deepest[t, b, kind], depth)


@kernel
def find_penetrations(first, stop, capsules, arms, order, deepest):
    """Find how deep each avatar is in another one, or another one in it.

    Args:
        first: First of the times.
        stop: One past the last.
        capsules: A ``Capsules``.
        arms: Whether each is of an arm. Shape (N, K), bool.
        order: The avatars by x of the first capsule, absent ones last. Shape (T, N).
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
                    _compare(capsules, arms, t, a, b, deepest)

"""Compiled spheres around limbs and trunks, by which capsules are passed over that are far from one another."""

import math

import numpy as np

from crowdsim.jit import kernel

LIMBS = 4
"""Limbs of a body: left and right arm, left and right leg. With the trunk behind them they are its groups."""


@kernel(inline=True)
def group_of(limb):
    """Return the group of a capsule that belongs to a limb, or to none and so to the trunk."""
    return limb if limb >= 0 else LIMBS


@kernel(allocates=False)
def bound_limbs(capsules, limbs, t, n, spheres):
    """Write spheres around the limbs of an avatar and its trunk; the radius of what has no capsules is -1.

    Args:
        capsules: A ``Capsules``.
        limbs: Limb of each capsule of the avatar, -1 for those of the trunk. Shape (K,).
        t: The time.
        n: The avatar.
        spheres: Written: middle and radius of each group [m]. Shape (5, 4).
    """
    spheres[:] = 0.0
    spheres[:, 3] = -1.0
    for i in range(capsules.counts[n]):
        p, q, sphere = capsules.starts[t, n, i], capsules.ends[t, n, i], spheres[group_of(limbs[i])]
        x, y, z = 0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), 0.5 * (p[2] + q[2])
        if sphere[3] < 0.0:
            sphere[0], sphere[1], sphere[2], sphere[3] = x, y, z, capsules.bounds[n, i]
            continue
        x, y, z = x - sphere[0], y - sphere[1], z - sphere[2]
        far = math.sqrt(x * x + y * y + z * z)
        more = 0.5 * (far + capsules.bounds[n, i] - sphere[3])
        if more > 0.0:
            part = min(more / max(far, 1e-9), 1.0)
            sphere[0] += part * x
            sphere[1] += part * y
            sphere[2] += part * z
            sphere[3] = max(sphere[3] + more, capsules.bounds[n, i]) + 1e-6


@kernel(inline=True)
def limbs_near(x, y, z, bound, margin, spheres):
    """Return which limbs a sphere may be nearer than a margin [m], a bit for each; spheres has shape (4 or more, 4)."""
    near = 0
    for limb in range(LIMBS):
        dx, dy, dz = x - spheres[limb, 0], y - spheres[limb, 1], z - spheres[limb, 2]
        reach = spheres[limb, 3] + bound + margin
        near |= np.int64(spheres[limb, 3] >= 0.0 and dx * dx + dy * dy + dz * dz <= reach * reach) << limb
    return near


@kernel(allocates=False)
def groups_near(groups, margin, spheres):
    """Return which groups of a body may be near a limb of another one, a bit for each; spheres are of shape (5, 4)."""
    near = 0
    for group in range(LIMBS + 1):
        x, y, z, bound = groups[group, 0], groups[group, 1], groups[group, 2], groups[group, 3]
        near |= np.int64(bound >= 0.0 and limbs_near(x, y, z, bound, margin, spheres) > 0) << group
    return near

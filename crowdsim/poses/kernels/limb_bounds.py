"""Compiled boxes around limbs and trunks, by which capsules are passed over that are far from one another."""

import math

import numpy as np

from crowdsim.jit import kernel

LIMBS = 4
"""Limbs of a body: left and right arm, left and right leg. With the trunk behind them they are its groups."""
WHOLE = LIMBS + 1
"""Row of the box around all of a body, behind those around its groups."""


@kernel(inline=True)
def group_of(limb):
    """Return the group of a capsule that belongs to a limb, or to none and so to the trunk."""
    return limb if limb >= 0 else LIMBS


@kernel
def bound_limbs(capsules, limbs, t, n, boxes):
    """Write boxes around the limbs of an avatar, around its trunk and around all of it.

    Args:
        capsules: A ``Capsules``.
        limbs: Limb of each capsule of the avatar, -1 for those of the trunk. Shape (K,).
        t: The time.
        n: The avatar.
        boxes: Written: least x, y and z, and greatest [m]; of what has no capsules, infinitely far. Shape (6, 6).
    """
    boxes[:, :3] = math.inf
    boxes[:, 3:] = -math.inf
    for i in range(capsules.counts[n]):
        p, q, box = capsules.starts[t, n, i], capsules.ends[t, n, i], boxes[group_of(limbs[i])]
        radius = np.float32(max(capsules.radii[n, i, 0], capsules.radii[n, i, 1]))
        for k in range(3):
            box[k] = min(box[k], min(p[k], q[k]) - radius)
            box[3 + k] = max(box[3 + k], max(p[k], q[k]) + radius)
    whole = boxes[WHOLE]
    for group in range(WHOLE):
        for k in range(3):
            whole[k] = min(whole[k], boxes[group, k])
            whole[3 + k] = max(whole[3 + k], boxes[group, 3 + k])


@kernel
def bound_capsules(capsules, limbs, t, n, margins, boxes):
    """Write boxes around the capsules of an avatar's limbs.

    Args:
        capsules: A ``Capsules``.
        limbs: Limb of each capsule of the avatar, -1 for those of the trunk. Shape (K,).
        t: The time.
        n: The avatar.
        margins: How far boxes go beyond capsules of each limb [m]. Shape (4,).
        boxes: Written, as of ``bound_limbs``; those of the trunk are not. Shape (K, 6).
    """
    for i in range(capsules.counts[n]):
        if limbs[i] >= 0:
            p, q, box = capsules.starts[t, n, i], capsules.ends[t, n, i], boxes[i]
            radius = np.float32(max(capsules.radii[n, i, 0], capsules.radii[n, i, 1]) + margins[limbs[i]])
            for k in range(3):
                box[k] = min(p[k], q[k]) - radius
                box[3 + k] = max(p[k], q[k]) + radius


@kernel(inline=True)
def boxes_meet(box, other, margin):
    """Return whether two boxes are no further apart than a margin along any axis of the world [m]."""
    return (
        (box[0] - other[3] <= margin)
        & (other[0] - box[3] <= margin)
        & (box[2] - other[5] <= margin)
        & (other[2] - box[5] <= margin)
        & (box[1] - other[4] <= margin)
        & (other[1] - box[4] <= margin)
    )


@kernel(inline=True)
def limbs_near(limbs, box, among, margins):
    """Return which limbs of a body, ``among`` some, may be near a box, a bit for each.

    Args:
        limbs: Boxes around them. Shape (4 or more, 6).
        box: The box. Shape (6,).
        among: A bit for each limb that counts.
        margins: How near is near, for each limb [m]. Shape (4,).
    """
    near = 0
    for limb in range(LIMBS):
        near |= np.int64(boxes_meet(limbs[limb], box, margins[limb])) << limb
    return near & among

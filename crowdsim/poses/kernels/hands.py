"""Compiled lifting of hands that longer arms, or shorter legs, would bring under the floor."""

import math

import numpy as np

from crowdsim.core.quaternions import rotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import ARM, LEG, LOWER, TRUNK
from crowdsim.poses.kernels.fists import point_arm
from crowdsim.poses.kernels.limbs import World, pose_chain, soft_ramp

_EASE = 0.004
"""Height over which hands ease onto the floor [m]."""


@kernel
def _lift_hand(arms, hand, scale, glove, pose, world):
    """Bend an arm so that its glove is on the floor, not under it."""
    end, o = arms.joints[hand, LOWER], arms.points[hand, 0]
    wrist, ease = world.positions[end], _EASE * scale
    height = wrist[1] + rotate(world.rotations[end], o[0] * scale, o[1] * scale, o[2] * scale)[1] - glove * scale
    if height > 20.0 * ease:
        return
    point_arm(arms, hand, pose, world, (wrist[0], wrist[1] + ease * soft_ramp(-height / ease), wrist[2]))


@kernel(allocates=True)
def lift_hands(first, stop, moments, sizes, arms, glove, poses):
    """Lift hands of avatars with legs or arms of other lengths than captured off the floor, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        sizes: Sizes of bones by column, see ``Rows``. Shape (n, 3).
        arms: A ``motion.Limbs``.
        glove: Radius of a glove [m].
        poses: Rotations are changed, a ``Posed``.
    """
    joints = arms.parents.shape[0]
    world = World(np.empty((joints, 3)), np.empty((joints, 4)))
    for i in range(first, stop):
        size = sizes[moments.columns[i]]
        if size[LEG] == size[TRUNK] and size[ARM] == size[TRUNK]:
            continue
        for t in range(poses.roots.shape[0]):
            root, pose = poses.roots[t, i], poses.rotations[t, i]
            if math.isfinite(root[0]):
                pose_chain(arms, size, root, pose, world)
                for hand in range(2):
                    _lift_hand(arms, hand, size[TRUNK], glove, pose, world)

"""How capsules of a body go along with its limbs where these give way."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.poses.capsules import capsule_order
from crowdsim.poses.kernels.limb_moves import END, JOINT, MOVED
from crowdsim.poses.motion import PoseMotion


def ride_along(motion: PoseMotion) -> tuple[Array, Array]:
    """Return which limb each capsule of a body rides on, and how far its ends go along with it.

    Returns:
        For the capsules in ``capsule_order`` the limb, left and right arm, left and right leg, or -1, shape (K,); and
        how far either end goes along with the middle and the end joint of that limb, shape (K, 2, 2).
    """
    body, skeleton = motion.body, motion.skeleton
    order = capsule_order(body)
    joints = np.concatenate([motion.arms.joints, motion.legs.joints])
    limbs, weights = np.full(len(order), -1, np.int64), np.zeros((len(order), 2, MOVED))
    for row, capsule in enumerate(order):
        at = int(body.capsule_joints[capsule])
        while at >= 0 and not (joints == at).any():
            at = int(skeleton.parents[at])
        if at < 0:
            continue
        limb, part = (int(value[0]) for value in np.nonzero(joints == at))
        limbs[row] = limb
        for end, offset in enumerate((body.capsule_starts[capsule], body.capsule_ends[capsule])):
            if part == 2:
                weights[row, end, END] = 1.0
                continue
            bone = np.asarray(skeleton.offsets[joints[limb, part + 1]], dtype=float)
            along = float(np.clip(offset @ bone / max(float(bone @ bone), 1e-12), 0.0, 1.0))
            weights[row, end] = (along, 0.0) if part == 0 else (1.0 - along, along)
        if limb >= 2:
            # A knee goes half the way of its ankle, besides where the leg swivels.
            weights[row, :, END] += 0.5 * weights[row, :, JOINT]
    limbs[(weights == 0.0).all(axis=(1, 2))] = -1
    return limbs, weights

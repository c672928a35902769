"""Inverse kinematics on whole blocks of poses: legs to where feet belong, arms to where fists land."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import quaternion
from crowdsim.motion.ik import reach_with_joints
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.take.motion import PoseMotion

Array = NDArray[Any]

KNEE_LIMITS = (np.deg2rad(3.0), np.deg2rad(155.0))
"""Least and most flexion of a knee [rad]."""
_SIDES = ("left", "right")


def plant_feet(
    motion: PoseMotion, scales: Array, homes: Array, firmness: Array, roots: Array, rotations: Array
) -> None:
    """Bend legs so that the balls of planted feet come to lie where they belong, in place.

    Feet keep their rotation in the world, knees their plane; no sole goes below the floor. What a leg cannot reach it
    goes towards.

    Args:
        motion: The policy's motion.
        scales: Size of each body. Shape (n,).
        homes: Where the balls belong [m]. Shape (T, n, 2, 3).
        firmness: How firmly, 0 to 1. Shape (T, n, 2).
        roots: Places of the roots [m]. Shape (T, n, 3).
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    times, count, joints = rotations.shape[:3]
    body, skeleton = motion.body, motion.skeleton
    there = np.flatnonzero(np.isfinite(roots[..., 0]).reshape(-1))
    if not len(there):
        return
    sizes = np.broadcast_to(scales, (times, count)).reshape(-1)[there]
    flat = rotations.reshape(-1, joints, 4)
    local = flat[there]
    # Limbs are worked on at the skeleton's own size.
    places = (roots.reshape(-1, 3)[there] / sizes[:, None]).astype(np.float32)
    positions, turns = forward_kinematics(skeleton, places, local, parallel=False)
    for foot, side in enumerate(_SIDES):
        joint = body.roles[f"{side}_foot"]
        ankles = positions[:, joint].astype(float)
        heel, ball = (quaternion.rotate(turns[:, joint], sole) for sole in body.sole_offsets[foot])
        home = homes[:, :, foot].reshape(-1, 3)[there] / sizes[:, None]
        firm = firmness[:, :, foot].reshape(-1)[there]
        targets = ankles + (home - ankles - ball) * firm[:, None]
        targets[:, 1] += np.maximum(0.0, -(targets[:, 1] + np.minimum(heel[:, 1], ball[:, 1])))
        moved = np.flatnonzero(np.linalg.norm(targets - ankles, axis=1) > 1e-5)
        if not len(moved):
            continue
        limb = (body.roles[f"{side}_hip"], body.roles[f"{side}_knee"], joint)
        local[moved] = reach_with_joints(
            skeleton,
            local[moved],
            positions[moved],
            turns[moved],
            limb,
            targets[moved],
            _hinge(motion, side, turns[moved]),
            KNEE_LIMITS,
        )
    flat[there] = local


def _hinge(motion: PoseMotion, side: str, turns: Array) -> Array:
    """Axis of the knee in the hip's frame: to the right of where the pelvis looks, about which flexion is positive."""
    roles = motion.body.roles
    rest = motion.skeleton.rest_positions()
    across = rest[roles["right_hip"]] - rest[roles["left_hip"]]
    return across / np.linalg.norm(across)

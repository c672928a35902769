"""Joints of poses in the world."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.kernels.stretching import stretch_limbs


def world_joints(
    skeleton: Skeleton, segments: Array, scales: Array, stretches: Array, poses: Posed
) -> tuple[Array, Array]:
    """Return positions (T, n, J, 3) [m] and rotations (T, n, J, 4) in the world of poses of bodies.

    Args:
        skeleton: Their skeleton, unscaled.
        segments: What each joint carries, see ``builds.joint_segments``. Shape (J,).
        scales: Size of each body. Shape (n,).
        stretches: How long the bones of its trunk, legs and arms are for its size. Shape (n, 3).
        poses: The poses.
    """
    times, count, joints = poses.rotations.shape[:3]
    flat = poses.rotations.reshape(-1, joints, 4)
    positions, rotations = forward_kinematics(skeleton, np.zeros((len(flat), 3), np.float32), flat, threads=1)
    positions = positions.reshape(times, count, joints, 3) * scales[:, None, None].astype(np.float32)
    if (stretches != 1.0).any():
        parents = np.asarray(skeleton.parents, dtype=np.int64)
        share(times * count, stretch_limbs, parents, segments, stretches, positions, threads=1)
    return positions + poses.roots[:, :, None], rotations.reshape(times, count, joints, 4)

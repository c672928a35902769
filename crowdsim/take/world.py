"""Joints of poses in the world."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.take.kernels.records import Posed


def world_joints(skeleton: Skeleton, scales: Array, poses: Posed) -> tuple[Array, Array]:
    """Return positions (T, n, J, 3) [m] and rotations (T, n, J, 4) in the world of poses of bodies of sizes (n,)."""
    times, count, joints = poses.rotations.shape[:3]
    flat = poses.rotations.reshape(-1, joints, 4)
    positions, rotations = forward_kinematics(skeleton, np.zeros((len(flat), 3), np.float32), flat, threads=1)
    positions = positions.reshape(times, count, joints, 3) * scales[:, None, None].astype(np.float32)
    return positions + poses.roots[:, :, None], rotations.reshape(times, count, joints, 4)

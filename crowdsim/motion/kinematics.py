"""Forward kinematics: from local joint rotations to positions and rotations in the world."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.kinematics_kernels import pose_joints, pose_joints_parallel
from crowdsim.motion.skeleton import Clip, Skeleton

_PARALLEL_FROM = 4096
"""Frames from which threads pay."""


def forward_kinematics(
    skeleton: Skeleton,
    root_positions: Array,
    rotations: Array,
    translations: Array | None = None,
    parallel: bool | None = None,
) -> tuple[Array, Array]:
    """Return the positions and rotations of all joints in the world.

    Args:
        skeleton: The skeleton, J joints.
        root_positions: Position of the root [m]. Shape (F, 3).
        rotations: Local rotations. Shape (F, J, 4).
        translations: Positions of joints in their parents' frames [m], for joints that move. Shape (F, J, 3).
        parallel: Use every numba thread; by default when there are many frames. The result is the same.

    Returns:
        Positions [m], shape (F, J, 3), and rotations, shape (F, J, 4), both in the dtype of ``rotations``.

    Raises:
        ValueError: Shapes do not fit together.
    """
    rotations = np.ascontiguousarray(rotations)
    frames, joints = rotations.shape[:2]
    if joints != skeleton.joint_count or root_positions.shape != (frames, 3) or rotations.shape[2:] != (4,):
        raise ValueError(
            f"rotations {rotations.shape} and root positions {root_positions.shape} do not fit each other "
            f"and a skeleton of {skeleton.joint_count} joints; expected (F, {skeleton.joint_count}, 4) and (F, 3)"
        )
    dtype = rotations.dtype
    roots = np.ascontiguousarray(root_positions, dtype=dtype)
    offsets = np.ascontiguousarray(skeleton.offsets, dtype=dtype)
    moved = np.zeros((0, 0, 3), dtype) if translations is None else np.ascontiguousarray(translations, dtype=dtype)
    parents = np.ascontiguousarray(skeleton.parents, dtype=np.int32)
    out_positions = np.empty((frames, joints, 3), dtype)
    out_rotations = np.empty((frames, joints, 4), dtype)
    if parallel is None:
        parallel = frames >= _PARALLEL_FROM
    if parallel:
        pose_joints_parallel(parents, offsets, roots, rotations, moved, out_positions, out_rotations)
    else:
        pose_joints(parents, offsets, roots, rotations, moved, 0, frames, out_positions, out_rotations)
    return out_positions, out_rotations


def clip_kinematics(clip: Clip) -> tuple[Array, Array]:
    """Return world positions [m] (F, J, 3) and rotations (F, J, 4) of all joints of a clip."""
    return forward_kinematics(clip.skeleton, clip.root_positions, clip.rotations, clip.translations)

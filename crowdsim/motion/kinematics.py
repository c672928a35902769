"""Forward kinematics: from local joint rotations to positions and rotations in the world."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.kinematics_kernels import pose_joints
from crowdsim.motion.skeleton import Clip, Skeleton

_LEAST = 1024
"""Frames that a thread works on at least."""


def forward_kinematics(
    skeleton: Skeleton,
    root_positions: Array,
    rotations: Array,
    translations: Array | None = None,
    threads: int | None = None,
) -> tuple[Array, Array]:
    """Return the positions and rotations of all joints in the world.

    Args:
        skeleton: The skeleton, J joints.
        root_positions: Position of the root [m]. Shape (F, 3).
        rotations: Local rotations. Shape (F, J, 4).
        translations: Positions of joints in their parents' frames [m], for joints that move. Shape (F, J, 3).
        threads: Number of threads (``share``). The result is the same.

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
    arguments = parents, offsets, roots, rotations, moved, out_positions, out_rotations
    share(frames, pose_joints, *arguments, threads=threads, least=_LEAST)
    return out_positions, out_rotations


def clip_kinematics(clip: Clip) -> tuple[Array, Array]:
    """Return world positions [m] (F, J, 3) and rotations (F, J, 4) of all joints of a clip."""
    return forward_kinematics(clip.skeleton, clip.root_positions, clip.rotations, clip.translations)

"""Arms and legs as the capture has them: how far they are bent, and about which axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.motion import quaternion


def flexion(uppers: ArrayLike, middles: ArrayLike, ends: ArrayLike) -> Array:
    """Return how far limbs are bent [rad], 0 where they are straight; positions have the shape (..., 3)."""
    uppers, middles, ends = (np.asarray(positions, dtype=float) for positions in (uppers, middles, ends))
    bone, other = middles - uppers, ends - middles
    return np.arctan2(np.linalg.norm(np.cross(bone, other), axis=-1), np.sum(bone * other, axis=-1))


def hinge_axis(uppers: ArrayLike, middles: ArrayLike, ends: ArrayLike, upper_rotations: ArrayLike) -> Array:
    """Return the axis, in the upper joint's frame, about which a limb bends over many poses.

    Args:
        uppers: Positions of the upper joint [m]. Shape (F, 3).
        middles: Positions of the middle joint [m]. Shape (F, 3).
        ends: Positions of the end [m]. Shape (F, 3).
        upper_rotations: Rotations of the upper joint in the world. Shape (F, 4).

    Returns:
        A unit vector about which flexion is a positive rotation, poses bent more counting more; zero where the limb is
        straight in all of them. Shape (3,).
    """
    uppers, middles, ends = (np.asarray(positions, dtype=float) for positions in (uppers, middles, ends))
    normals = np.cross(middles - uppers, ends - middles)
    total = quaternion.rotate(quaternion.conjugate(upper_rotations), normals).sum(axis=0)
    length = float(np.linalg.norm(total))
    return total / length if length > 1e-9 * max(1, len(normals)) else np.zeros(3)

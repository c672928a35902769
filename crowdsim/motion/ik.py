"""Inverse kinematics of arms and legs: two bones, a joint between them that bends one way, and limits to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdsim.motion import quaternion
from crowdsim.motion.ik_kernels import bend_limbs
from crowdsim.motion.skeleton import Skeleton

Array = NDArray[Any]

LEAST_FLEXION = math.radians(2.0)
"""How far elbows and knees stay bent at the least [rad], so that they keep their plane."""

MOST_FLEXION = math.radians(155.0)
"""How far elbows and knees bend at the most [rad]."""


@dataclass(frozen=True)
class Reach:
    """Limbs after inverse kinematics, in the world.

    Attributes:
        upper_rotations: Rotation of each upper joint. Shape (N, 4).
        middle_rotations: Rotation of each middle joint. Shape (N, 4).
        end_positions: Where each end comes to lie [m]. Shape (N, 3).
    """

    upper_rotations: Array
    middle_rotations: Array
    end_positions: Array


def two_bone(
    uppers: ArrayLike,
    middles: ArrayLike,
    ends: ArrayLike,
    upper_rotations: ArrayLike,
    middle_rotations: ArrayLike,
    targets: ArrayLike,
    hinges: ArrayLike = (0.0, 0.0, 0.0),
    limits: ArrayLike = (LEAST_FLEXION, MOST_FLEXION),
    softness: float = 0.0,
) -> Reach:
    """Bend limbs at their middle joints and swing them at their upper joints so that their ends reach targets.

    A target within the limits is reached exactly. Any other is approached along the line from the upper joint to it, as
    near as the limits let. A limb keeps the plane it is bent in; one that is nearly straight, or bent backwards, bends
    about its hinge axis. A limb without length, or with a target that is not finite, stays as it is.

    Everything is in the world, leading axes broadcast.

    Args:
        uppers: Places of shoulders or hips [m]. Shape (..., 3).
        middles: Places of elbows or knees [m]. Shape (..., 3).
        ends: Places of hands or feet, or of whatever hangs on the middle joint [m]. Shape (..., 3).
        upper_rotations: Rotations of the upper joints. Shape (..., 4).
        middle_rotations: Rotations of the middle joints. Shape (..., 4).
        targets: Where the ends shall be [m]. Shape (..., 3).
        hinges: Axes about which flexion is a positive turn, as the limb lies now; zero where it is unknown, then a limb
            may bend to any side. Shape (..., 3).
        limits: Least and most flexion [rad], 0 where a limb is straight, within 0..pi. Shape (..., 2).
        softness: Part of the longest reach over which the limb eases into it, so that it does not snap straight; with
            it, targets in that part are not quite reached.

    Raises:
        ValueError: Limits are out of order or out of range.
    """
    vectors = [np.asarray(array, dtype=float) for array in (uppers, middles, ends, targets, hinges)]
    turns = [np.asarray(array, dtype=float) for array in (upper_rotations, middle_rotations)]
    bounds = np.asarray(limits, dtype=float)
    least, most = bounds[..., 0], bounds[..., 1]
    if not ((least >= 0.0) & (least <= most) & (most <= math.pi + 1e-12)).all():
        raise ValueError(f"flexion limits {bounds.tolist()} are out of order, expected 0 <= least <= most <= pi")
    lead = np.broadcast_shapes(*(array.shape[:-1] for array in (*vectors, *turns, bounds)))
    count = math.prod(lead)

    def flat(array: Array) -> Array:
        width = array.shape[-1]
        return np.ascontiguousarray(np.broadcast_to(array, (*lead, width)).reshape(count, width))

    upper, middle, end, target, hinge = (flat(array) for array in vectors)
    upper_turn, middle_turn = (flat(array) for array in turns)
    new_upper, new_middle, new_end = np.empty((count, 4)), np.empty((count, 4)), np.empty((count, 3))
    ease, flexion = float(softness), flat(bounds)
    bend_limbs(
        upper, middle, end, upper_turn, middle_turn, target, hinge, flexion, ease, new_upper, new_middle, new_end
    )
    return Reach(new_upper.reshape(*lead, 4), new_middle.reshape(*lead, 4), new_end.reshape(*lead, 3))


def flexion(uppers: ArrayLike, middles: ArrayLike, ends: ArrayLike) -> Array:
    """Return how far limbs are bent [rad], 0 where they are straight; places have the shape (..., 3)."""
    uppers, middles, ends = (np.asarray(places, dtype=float) for places in (uppers, middles, ends))
    bone, other = middles - uppers, ends - middles
    return np.arctan2(np.linalg.norm(np.cross(bone, other), axis=-1), np.sum(bone * other, axis=-1))


def hinge_axis(uppers: ArrayLike, middles: ArrayLike, ends: ArrayLike, upper_rotations: ArrayLike) -> Array:
    """Return the axis, in the upper joint's frame, about which a limb bends over many poses.

    Args:
        uppers: Places of the upper joint [m]. Shape (F, 3).
        middles: Places of the middle joint [m]. Shape (F, 3).
        ends: Places of the end [m]. Shape (F, 3).
        upper_rotations: Rotations of the upper joint in the world. Shape (F, 4).

    Returns:
        A unit vector about which flexion is a positive turn, poses bent more counting more; zero where the limb is
        straight in all of them. Shape (3,).
    """
    uppers, middles, ends = (np.asarray(places, dtype=float) for places in (uppers, middles, ends))
    normals = np.cross(middles - uppers, ends - middles)
    total = quaternion.rotate(quaternion.conjugate(upper_rotations), normals).sum(axis=0)
    length = float(np.linalg.norm(total))
    return total / length if length > 1e-9 * max(1, len(normals)) else np.zeros(3)


def reach_with_joints(
    skeleton: Skeleton,
    rotations: Array,
    positions: Array,
    world_rotations: Array,
    joints: tuple[int, int, int],
    targets: Array,
    hinge: ArrayLike = (0.0, 0.0, 0.0),
    limits: ArrayLike = (LEAST_FLEXION, MOST_FLEXION),
    softness: float = 0.0,
    keep_end: bool = True,
) -> Array:
    """Return local rotations of whole poses in which one limb reaches targets.

    Args:
        skeleton: The skeleton, J joints.
        rotations: Local rotations. Shape (F, J, 4).
        positions: Places of the joints in the world [m]. Shape (F, J, 3).
        world_rotations: Rotations of the joints in the world. Shape (F, J, 4).
        joints: Upper, middle and end joint; each hangs on the one before, possibly with joints between them that do
            not move.
        targets: Where the end joint shall be [m]. Shape (F, 3) or (3,).
        hinge: Axis of flexion in the upper joint's frame, or zero when unknown. Shape (3,) or (F, 3).
        limits: Least and most flexion [rad].
        softness: As for ``two_bone``.
        keep_end: Keep the end joint's rotation in the world, as a foot on the floor does; else it follows the limb.

    Returns:
        A copy of ``rotations`` with other upper, middle and end rotations. Shape (F, J, 4).
    """
    upper, middle, end = joints
    reach = two_bone(
        positions[:, upper],
        positions[:, middle],
        positions[:, end],
        world_rotations[:, upper],
        world_rotations[:, middle],
        targets,
        quaternion.rotate(world_rotations[:, upper], np.asarray(hinge, dtype=float)),
        limits,
        softness,
    )
    new = np.array(rotations)
    turned = quaternion.multiply
    undo_upper = quaternion.conjugate(world_rotations[:, upper])
    undo_middle = quaternion.conjugate(world_rotations[:, middle])
    upper_swing = turned(reach.upper_rotations, undo_upper)
    middle_swing = turned(reach.middle_rotations, undo_middle)
    still = np.zeros_like(upper_swing)
    still[:, 0] = 1.0
    for joint, before, after in ((upper, still, upper_swing), (middle, upper_swing, middle_swing)):
        new[:, joint] = _turned_in_parent(skeleton, rotations, world_rotations, joint, before, after)
    if keep_end:
        new[:, end] = _turned_in_parent(skeleton, rotations, world_rotations, end, middle_swing, still)
    return new


def _turned_in_parent(
    skeleton: Skeleton, rotations: Array, world_rotations: Array, joint: int, before: Array, after: Array
) -> Array:
    """Return a joint's local rotation when its parent turns by ``before`` and it turns by ``after`` in the world."""
    parent = int(skeleton.parents[joint])
    world = quaternion.multiply(after, world_rotations[:, joint])
    if parent < 0:
        return world
    parent_world = quaternion.multiply(before, world_rotations[:, parent])
    return quaternion.multiply(quaternion.conjugate(parent_world), world)

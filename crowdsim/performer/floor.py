"""What keeps a falling body on the floor and out of it: the pelvis rests on it, and limbs clear it."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion as quat
from crowdsim.motion.body import Body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer import skeleton as bones
from crowdsim.performer.curves import soft_cap, soft_floor
from crowdsim.performer.pose import LEG_REACH, triangle, unit

HIP, KNEE, ELBOW, FIST = 0.092, 0.054, 0.046, 0.062
"""Radii of thighs at the hip, knees, elbows and fists, and a little more [m]."""
_SOFT = 0.006
_LEAST_LEG = 0.24
"""Least distance from hip to ankle [m]: thigh and shank have flesh."""
_DOWN, _AHEAD, _LEFT = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])

_HANGS, _BACK = (_DOWN + _AHEAD) / np.sqrt(2.0), (_DOWN - _AHEAD) / np.sqrt(2.0)


def lowest(body: Body, joints: Array, positions: Array, rotations: Array) -> Array:
    """Return how low the capsules of some joints reach, together [m]. Shape (F,).

    Args:
        body: The body.
        joints: The joints.
        positions: Of all joints. Shape (F, J, 3).
        rotations: Of all joints in the world. Shape (F, J, 4).
    """
    some = np.flatnonzero(np.isin(body.capsule_joints, joints))
    least = []
    for capsule in some:
        joint = body.capsule_joints[capsule]
        for end, radius in zip((body.capsule_starts, body.capsule_ends), body.capsule_radii[capsule], strict=True):
            low = positions[:, joint, 1] + quat.rotate(rotations[:, joint], end[capsule])[:, 1]
            least.append(low - radius)
    return np.min(least, axis=0)


TRUNK = np.array([bones.HIPS, bones.SPINE, bones.SPINE1, bones.SPINE2, bones.NECK, bones.HEAD])


def rest_height(body: Body, skeleton: Skeleton, hips: Array, rotations: Array) -> Array:
    """Return the least height of the pelvis at which trunk, head and hips are out of the floor [m]. Shape (F,)."""
    positions, turned = forward_kinematics(skeleton, hips, rotations)
    low = np.minimum(lowest(body, TRUNK, positions, turned), positions[:, list(bones.UP_LEGS), 1].min(axis=1) - HIP)
    return np.asarray(hips[:, 1] - low)


def clear_feet(body: Body, ankles: Array, soles: tuple[Array, Array]) -> Array:
    """Return how far each foot must rise, so that its shoe is out of the floor [m]. Shape (F, 2)."""
    lifts = np.empty(ankles.shape[:2])
    for foot in range(2):
        (shoe,) = np.flatnonzero(body.capsule_joints == bones.FEET[foot])
        low = ankles[:, foot, 1] - 0.037
        for end, radius in zip((body.capsule_starts, body.capsule_ends), body.capsule_radii[shoe], strict=True):
            low = np.minimum(low, ankles[:, foot, 1] + quat.rotate(soles[foot], end[shoe])[:, 1] - radius)
        lifts[:, foot] = soft_floor(-low, 0.0, 0.003)
    return lifts


def within_leg(ankle: Array, hip: Array) -> Array:
    """Return ankles (F, 3) drawn to where legs from their hips (F, 3) reach, neither folded up nor stretched."""
    gap = ankle - hip
    far = np.linalg.norm(gap, axis=-1, keepdims=True)
    held = soft_cap(soft_floor(far, _LEAST_LEG, 0.02), LEG_REACH * (bones.THIGH + bones.SHANK), 0.008)
    found = hip + gap * (held / np.maximum(far, 1e-9))
    found[:, 1] = soft_floor(found[:, 1], ankle[:, 1], 0.003)
    return np.asarray(found)


def knee_direction(hips_rotation: Array, hip: Array, ankle: Array, splay: Array, sign: int) -> Array:
    """Return where the knee of a leg in any position points: ahead of the pelvis where the leg hangs. Shape (F, 3)."""
    axis = unit(ankle - hip)
    carried = quat.multiply(quat.between(quat.rotate(hips_rotation, _DOWN), axis), hips_rotation)
    ahead, out = quat.rotate(carried, _AHEAD), quat.rotate(carried, _LEFT) * sign
    return np.asarray(np.cos(splay)[:, None] * ahead + np.sin(splay)[:, None] * out)


def knee_height(hip: Array, ankle: Array, ahead: Array) -> Array:
    """Return how high the knee is between a hip and an ankle [m]. Shape (F,)."""
    gap = ankle - hip
    distance = np.linalg.norm(gap, axis=-1)
    axis = gap / distance[:, None]
    pole = unit(ahead - axis * np.sum(axis * ahead, axis=-1, keepdims=True))
    distance = np.minimum(distance, 0.9995 * (bones.THIGH + bones.SHANK))
    thigh, _, _ = triangle(axis, distance, bones.THIGH, bones.SHANK, pole)
    return np.asarray(hip[:, 1] + bones.THIGH * thigh[:, 1])


def elbow_frame(chest_rotation: Array, axis: Array, sign: int) -> tuple[Array, Array]:
    """Return where the elbow of an arm along ``axis`` points at a swivel of 0, and outwards. All of shape (F, 3).

    Both are carried from an arm that hangs down and ahead, whose elbow points back and down: arms of a falling body go
    any way but up and back, where they would be undefined.
    """
    carried = quat.multiply(quat.between(quat.rotate(chest_rotation, _HANGS), axis), chest_rotation)
    return quat.rotate(carried, _BACK), quat.rotate(carried, _LEFT) * sign


def clear_elbow(shoulder: Array, fist: Array, down: Array, out: Array, swivel: Array) -> Array:
    """Return the swivel of an elbow (F,) nearest to the given one at which it is out of the floor [rad].

    Args:
        shoulder: Position of the shoulder joint [m]. Shape (F, 3).
        fist: Position of the fist [m]. Shape (F, 3).
        down: Where the elbow points at a swivel of 0. Shape (F, 3).
        out: Where it points at a quarter of a circle. Shape (F, 3).
        swivel: The swivel wanted [rad]. Shape (F,).
    """
    lower = bones.FOREARM + bones.FIST_AHEAD
    gap = fist - shoulder
    distance = np.linalg.norm(gap, axis=-1)
    cosine = np.clip((bones.UPPER_ARM**2 + distance**2 - lower**2) / (2.0 * bones.UPPER_ARM * distance), -1.0, 1.0)
    middle = shoulder[:, 1] + bones.UPPER_ARM * cosine * gap[:, 1] / distance
    size = bones.UPPER_ARM * np.sqrt(1.0 - cosine**2) * np.hypot(down[:, 1], out[:, 1])
    highest = np.arctan2(out[:, 1], down[:, 1])
    most = np.arccos(np.clip((ELBOW - middle) / np.maximum(size, 1e-6), -1.0, 1.0))
    away = (swivel - highest + np.pi) % (2.0 * np.pi) - np.pi
    held = np.sign(away) * soft_cap(np.abs(away), most, 0.05)
    return np.asarray(swivel + np.where(most < np.pi - 1e-9, held - away, 0.0))

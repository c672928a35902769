"""From tracks of the body's parts to joint rotations: trunk by angles, legs and arms by two-bone inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion as quat
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer import skeleton as bones
from crowdsim.performer.curves import soft_cap, soft_floor

_ARM_REACH = 0.982
LEG_REACH = 0.988 * (bones.THIGH + bones.SHANK)
"""Share of an arm's length, and distance of an ankle from its hip [m], that keep elbows and knees bent."""

LEFT, DOWN, AHEAD = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
_SPINE_SHARES = (0.28, 0.36, 0.36)
NECK_SHARE = 0.42
"""How the joints of the spine share its bend, and how much of the turn of a head is the neck's."""


@dataclass(frozen=True)
class Trunk:
    """The trunk over F frames, in the world.

    Attributes:
        hips: Position of the pelvis [m]. Shape (F, 3).
        hips_rotation: Rotation of the pelvis. Shape (F, 4).
        spine: Local rotations of Spine, Spine1, Spine2. Shape (F, 3, 4).
        chest: Position of Spine2 [m]. Shape (F, 3).
        chest_rotation: Its rotation. Shape (F, 4).
    """

    hips: Array
    hips_rotation: Array
    spine: Array
    chest: Array
    chest_rotation: Array


def pose_trunk(skeleton: Skeleton, hips: Array, hips_rotation: Array, twist: Array, flex: Array, bend: Array) -> Trunk:
    """Bend the spine by angles (F,) [rad] that its three joints share."""
    spine = np.stack([turned(twist * share, flex * share, bend * share) for share in _SPINE_SHARES], axis=1)
    position, rotation = hips, hips_rotation
    for index, joint in enumerate((bones.SPINE, bones.SPINE1, bones.SPINE2)):
        position = position + quat.rotate(rotation, skeleton.offsets[joint])
        rotation = quat.multiply(rotation, spine[:, index])
    return Trunk(hips, hips_rotation, spine, position, rotation)


def turned(turn: Array, tilt: Array, bend: Array) -> Array:
    """Return rotations (F, 4) that turn to the left, tilt forward and bend to the left by angles (F,) [rad]."""
    return quat.from_euler(np.stack([turn, tilt, -bend], axis=-1), "YXZ")


def pose_head(chest_rotation: Array, gaze: Array) -> Array:
    """Return local rotations of Neck and Head (F, 2, 4) that look as ``gaze`` (F, 4) does, as far as a neck rotates."""
    vector = quat.to_rotation_vector(quat.multiply(quat.conjugate(chest_rotation), gaze))
    size = np.linalg.norm(vector, axis=-1, keepdims=True)
    held = soft_cap(size, 1.25, 0.12) / np.maximum(size, 1e-9)
    vector = np.where(size > 1e-9, vector * held, vector)
    return np.stack([quat.from_rotation_vector(vector * share) for share in (NECK_SHARE, 1.0 - NECK_SHARE)], axis=1)


def frame_of(x: Array, y: Array, z: Array) -> Array:
    """Return the rotations (F, 4) that take the axes to the given orthonormal directions (F, 3)."""
    m00, m10, m20 = np.moveaxis(x, -1, 0)
    m01, m11, m21 = np.moveaxis(y, -1, 0)
    m02, m12, m22 = np.moveaxis(z, -1, 0)
    squares = np.stack([1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22], axis=-1)
    rows = np.stack(
        [
            np.stack([squares[..., 0], m21 - m12, m02 - m20, m10 - m01], axis=-1),
            np.stack([m21 - m12, squares[..., 1], m10 + m01, m02 + m20], axis=-1),
            np.stack([m02 - m20, m10 + m01, squares[..., 2], m21 + m12], axis=-1),
            np.stack([m10 - m01, m02 + m20, m21 + m12, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)
    return quat.normalise(np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :])


def hip_offset(foot: int) -> Array:
    """Return the position of a hip joint in the frame of the pelvis [m]. Shape (3,)."""
    return np.array([bones.HIP_HALF * (1 - 2 * foot), -bones.HIP_DROP, 0.0])


def unit(v: Array) -> Array:
    """Return directions (..., 3) of unit length."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def triangle(axis: Array, distance: Array, upper: float, lower: float, pole: Array) -> tuple[Array, Array, Array]:
    """Solve a limb of two bones, ``upper`` and ``lower`` [m] long, whose ends are ``distance`` (F,) [m] apart.

    ``axis`` (F, 3) is the direction from the upper end to the lower one, and ``pole`` (F, 3), at a right angle to it,
    that to which the middle joint points.

    Returns:
        Direction of the upper bone (F, 3), the direction at a right angle to it, in the limb's plane, that points away
        from where the lower bone folds (F, 3), and the fold of the middle joint (F,) [rad], 0 when straight.
    """
    cosine = (upper**2 + distance**2 - lower**2) / (2.0 * upper * distance)
    cosine = np.clip(cosine, -1.0, 1.0)[:, None]
    sine = np.sqrt(1.0 - cosine**2)
    inner = (upper**2 + lower**2 - distance**2) / (2.0 * upper * lower)
    fold = np.pi - np.arccos(np.clip(inner, -1.0, 1.0))
    return cosine * axis + sine * pole, cosine * pole - sine * axis, fold


def within_limb(ends: Array, roots: Array, least: float, softness: float, most: float) -> Array:
    """Return ends (..., 3) of limbs drawn to between ``least`` and ``most`` [m] from their roots (..., 3)."""
    gap = ends - roots
    far = np.linalg.norm(gap, axis=-1, keepdims=True)
    held = soft_cap(soft_floor(far, least, softness), most, 0.008)
    return np.asarray(roots + gap * (held / np.maximum(far, 1e-9)))


def within_reach(fists: Array, shoulders: Array) -> Array:
    """Return fists (..., 3) drawn to where arms from their shoulders (..., 3) reach, neither folded nor stretched."""
    return within_limb(fists, shoulders, 0.17, 0.01, _ARM_REACH * (bones.UPPER_ARM + bones.FOREARM + bones.FIST_AHEAD))


def carry(rotation: Array, hangs: Array, gap: Array, towards: Array, side: int) -> tuple[Array, Array]:
    """Return two directions (F, 3) of a limb along ``gap`` (F, 3): ``towards`` and outwards, for the side 0 or 1.

    They are given for a limb that hangs along ``hangs`` (3,) from a body with a rotation (F, 4), and carried from there
    by the smallest rotation.
    """
    axis = gap / np.maximum(np.linalg.norm(gap, axis=-1), 1e-9)[:, None]
    carried = quat.multiply(quat.between(quat.rotate(rotation, hangs), axis), rotation)
    return quat.rotate(carried, towards), quat.rotate(carried, LEFT) * (1 - 2 * side)


def swivelled(down: Array, out: Array, swivel: Array) -> Array:
    """Return the direction (F, 3) that a swivel (F,) [rad] turns from ``down`` towards ``out``, both (F, 3)."""
    return np.asarray(np.cos(swivel)[:, None] * down + np.sin(swivel)[:, None] * out)


def pose_arm(
    side: int, chest_rotation: Array, collar: Array, shoulder: Array, fist: Array, swivel: Array, roll: Array
) -> tuple[Array, Array, Array]:
    """Bend an arm so that the fist is where it should be; return rotations of upper arm, forearm and hand, (F, 4) each.

    ``side`` is 0 for the left arm, 1 for the right. Rotations of the chest and of the collar bone in the world have
    shape (F, 4), positions of the shoulder joint and of the fist, within reach [m], (F, 3). ``swivel`` (F,) [rad] turns
    the elbow from hanging to the outside, ``roll`` (F,) [rad] is the pronation of the fist, from thumb up.
    """
    # The elbow hangs when the arm points ahead; carried along the smallest rotation from there, it is before the chest
    # when the fist is up, and behind it when the fist is down, and only an arm that points back would leave it
    # undefined.
    down, out = carry(chest_rotation, AHEAD, fist - shoulder, DOWN, side)
    return bend_arm(side, collar, shoulder, fist, swivelled(down, out, swivel), roll)


def bend_arm(
    side: int, collar: Array, shoulder: Array, fist: Array, pole: Array, roll: Array
) -> tuple[Array, Array, Array]:
    """Bend an arm as ``pose_arm`` does, the elbow where ``pole`` (F, 3) points, at a right angle to the arm."""
    sign = 1.0 if side == 0 else -1.0
    lower = bones.FOREARM + bones.FIST_AHEAD
    gap = fist - shoulder
    distance = np.linalg.norm(gap, axis=-1)
    axis = gap / np.maximum(distance, 1e-9)[:, None]
    bone, away, fold = triangle(axis, distance, bones.UPPER_ARM, lower, pole)
    x, z = bone * sign, -away
    upper_rotation = frame_of(x, np.cross(z, x), z)
    half = np.zeros_like(upper_rotation)
    half[:, 0], half[:, 2] = np.cos(0.5 * fold), -sign * np.sin(0.5 * fold)
    forearm = quat.multiply(half, about_x(0.6 * roll))
    hand = about_x(0.4 * roll)
    return quat.multiply(quat.conjugate(collar), upper_rotation), forearm, hand


def about_x(angle: Array) -> Array:
    """Return rotations (F, 4) that tilt forward by angles (F,) [rad]."""
    rotation = np.zeros((*np.shape(angle), 4))
    rotation[..., 0], rotation[..., 1] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return rotation


def foot_rotation(yaw: Array, heel: Array) -> Array:
    """Return the rotation of a foot (F, 4) that looks along ``yaw`` with the heel up by ``heel`` (F,) [rad]."""
    return quat.multiply(quat.about_y(yaw), about_x(heel))


def ankle_position(ball: Array, rotation: Array) -> Array:
    """Return where the ankle is [m] when the ball of the foot is at ``ball`` (F, 3) and the foot has this rotation."""
    return ball - quat.rotate(rotation, np.array([0.0, bones.BALL_HEIGHT - bones.ANKLE_HEIGHT, bones.BALL_AHEAD]))


def solve_leg(hip: Array, ankle: Array, ahead: Array) -> tuple[Array, Array, Array]:
    """Solve a leg whose knee points as nearly ``ahead`` (F, 3) as it can, as ``triangle`` does."""
    gap = ankle - hip
    distance = np.linalg.norm(gap, axis=-1)
    axis = gap / distance[:, None]
    pole = unit(ahead - axis * np.sum(axis * ahead, axis=-1, keepdims=True))
    distance = np.minimum(distance, 0.9995 * (bones.THIGH + bones.SHANK))
    return triangle(axis, distance, bones.THIGH, bones.SHANK, pole)


def pose_leg(hips_rotation: Array, hip: Array, ankle: Array, foot: Array, ahead: Array) -> tuple[Array, Array, Array]:
    """Bend a leg as ``solve_leg`` does; return local rotations of thigh, shank and foot, (F, 4) each."""
    bone, away, fold = solve_leg(hip, ankle, ahead)
    y, z = -bone, away
    thigh = frame_of(np.cross(y, z), y, z)
    shank = about_x(fold)
    lower = quat.multiply(thigh, shank)
    return quat.multiply(quat.conjugate(hips_rotation), thigh), shank, quat.multiply(quat.conjugate(lower), foot)

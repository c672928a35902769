"""The pose in which a body is bound to its skeleton: arms lowered, elbows and knees half bent, feet level."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT, Body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton

SIDES = ("left", "right")
_LOWERED, _AHEAD = np.deg2rad(52.0), 0.12
"""How far arms are lowered from the horizontal, and how far they point ahead."""
_ELBOW, _HIP, _KNEE, _APART = np.deg2rad([45.0, 16.0, 30.0, 5.0])
"""Angles of joints in the middle of what they bend in fights, so that skin is carried half as far."""


@dataclass(frozen=True)
class Segment:
    """A stretch of the body with axes of its own, in the binding pose.

    Attributes:
        joint: Joint that carries it.
        start: Where it begins [m]. Shape (3,).
        axes: Along it, to its front, and outwards; unit. Shape (3, 3), an axis a row.
        length: Its length [m].
    """

    joint: int
    start: Array
    axes: Array
    length: float


@dataclass(frozen=True)
class Binding:
    """A skeleton in its binding pose: y up, facing +z.

    Attributes:
        positions: Of joints [m]. Shape (J, 3).
        rotations: Of joints. Shape (J, 4).
        segments: ``trunk``, ``head``, and ``left_upper_arm``, ``forearm``, ``hand``, ``thigh``, ``shank``, ``foot``,
            likewise on the right.
        size: Height of the body over ``HEIGHT``.
        shoulders: Distance of the shoulders from the middle over that of a usual body.
        hips: Likewise of the hips.
    """

    positions: Array
    rotations: Array
    segments: dict[str, Segment]
    size: float
    shoulders: float
    hips: float


def bind(skeleton: Skeleton, body: Body, poses: Array | None = None) -> Binding:
    """Return the binding pose of a skeleton.

    Args:
        skeleton: The skeleton [m].
        body: The body on it.
        poses: Local rotations of some poses, from which the axes of elbows and knees come, and how a skeleton stands
            whose rest pose is no pose of a body; elbows bend forwards and knees backwards when None. Shape (n, J, 4).

    Raises:
        MotionError: The rest pose is no upright body, and no pose is given that is.
    """
    roles, size = body.roles, body.height / HEIGHT
    stance = _upright(skeleton, body, poses)
    parents = np.asarray(skeleton.parents)

    def turn(joint: int, rotation: Array) -> None:
        below = np.zeros(len(parents), bool)
        below[joint] = True
        for child in range(joint + 1, len(parents)):
            below[child] = below[parents[child]]
        stance.rotations[below] = quaternion.multiply(rotation, stance.rotations[below])
        pivot = stance.positions[joint]
        stance.positions[below] = pivot + quaternion.rotate(rotation, stance.positions[below] - pivot)

    def way(start: str, end: str) -> Array:
        return _unit(stance.positions[roles[end]] - stance.positions[roles[start]])

    segments: dict[str, Segment] = {}
    for sign, side in zip((1.0, -1.0), SIDES, strict=True):
        shoulder, elbow, hand = (f"{side}_{role}" for role in ("shoulder", "elbow", "hand"))
        hip, knee, foot = (f"{side}_{role}" for role in ("hip", "knee", "foot"))
        lowered = _unit([sign * np.cos(_LOWERED), -np.sin(_LOWERED), _AHEAD])
        turn(roles[shoulder], quaternion.between(way(shoulder, elbow), lowered))
        turn(
            roles[hip], quaternion.between(way(hip, knee), _unit([sign * np.sin(_APART), -np.cos(_HIP), np.sin(_HIP)]))
        )
        for upper, middle, end, bent, usual, names in (
            (shoulder, elbow, hand, _ELBOW, [0.0, 0.0, 1.0], ("upper_arm", "forearm")),
            (hip, knee, foot, _KNEE, [0.0, 0.0, -1.0], ("thigh", "shank")),
        ):
            along = way(upper, middle)
            local = None if poses is None else _flexion(skeleton, poses, roles[upper], roles[middle], roles[end])
            folds = np.array(usual) if local is None else quaternion.rotate(stance.rotations[roles[upper]], local)
            folds = _unit(folds - along * (folds @ along))
            turn(roles[middle], quaternion.between(way(middle, end), np.cos(bent) * along + np.sin(bent) * folds))
            front = folds if upper == shoulder else -folds
            outwards = _unit(np.cross(front, along)) * sign
            for name, start, stop in ((names[0], upper, middle), (names[1], middle, end)):
                segments[f"{side}_{name}"] = _segment(stance.positions, roles[start], roles[stop], front, outwards)
        heel, ball = body.sole_offsets[SIDES.index(side)]
        ahead = _unit(ball - heel)
        up = _unit(ahead * (heel @ ahead) - heel)
        own = np.stack([ahead, up, np.cross(ahead, up)])
        level = _unit([0.06 * sign, 0.0, 1.0])
        aim = np.stack([level, [0.0, 1.0, 0.0], np.cross(level, [0.0, 1.0, 0.0])])
        now = quaternion.rotate(stance.rotations[roles[foot]], own)
        turn(roles[foot], _of_matrix(aim.T @ now))
        start = stance.positions[roles[foot]] + quaternion.rotate(stance.rotations[roles[foot]], heel)
        segments[f"{side}_foot"] = Segment(
            roles[foot], start, np.stack([level, [0.0, 1.0, 0.0], _unit([sign, 0.0, 0.0])]), _length(ball - heel)
        )
        fist = quaternion.rotate(stance.rotations[roles[hand]], body.fist_offsets[SIDES.index(side)])
        arm = segments[f"{side}_forearm"]
        along = _unit(fist)
        front = _unit(arm.axes[1] - along * (arm.axes[1] @ along))
        out = np.cross(front, along) * sign
        segments[f"{side}_hand"] = Segment(
            roles[hand], stance.positions[roles[hand]], np.stack([along, front, out]), _length(fist)
        )
    places = stance.positions
    pelvis = 0.5 * (places[roles["left_hip"]] + places[roles["right_hip"]])
    trunk = places[roles["neck"]] - pelvis
    upright = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    lean = np.stack([trunk / _length(trunk), upright[1], upright[2]])
    segments["trunk"] = Segment(roles["pelvis"], pelvis, lean, _length(trunk))
    head = places[roles["head"]] + quaternion.rotate(stance.rotations[roles["head"]], body.head_offset)
    segments["head"] = Segment(roles["head"], head, upright, body.head_radius)
    shoulders = _length(places[roles["left_shoulder"]] - places[roles["right_shoulder"]]) / (0.37 * size)
    hips = _length(places[roles["left_hip"]] - places[roles["right_hip"]]) / (0.18 * size)
    return Binding(stance.positions, stance.rotations, segments, size, shoulders, hips)


def _upright(skeleton: Skeleton, body: Body, poses: Array | None) -> SimpleNamespace:
    """Positions and rotations of an upright pose that faces +z: the rest pose, or the straightest of some poses."""
    roles, least = body.roles, 0.75 * body.height
    rotations = np.zeros((1, skeleton.joint_count, 4), np.float32)
    rotations[..., 0] = 1.0
    if poses is not None:
        rotations = np.concatenate([rotations, np.asarray(poses, np.float32)])
    posed = forward_kinematics(skeleton, np.zeros((len(rotations), 3), np.float32), rotations)
    positions, turned = (np.asarray(values, float) for values in posed)
    tall = positions[:, roles["head"], 1] - positions[:, [roles["left_foot"], roles["right_foot"]], 1].max(axis=1)
    best = 0 if tall[0] > least else int(np.argmax(tall))
    if tall[best] < 0.6 * body.height:
        raise MotionError("the rest pose of the skeleton is no upright body; a skin needs poses to be bound in")
    left = positions[best, roles["left_hip"]] - positions[best, roles["right_hip"]]
    facing = quaternion.about_y(np.arctan2(left[2], left[0]))
    return SimpleNamespace(
        positions=quaternion.rotate(facing, positions[best]), rotations=quaternion.multiply(facing, turned[best])
    )


def _flexion(skeleton: Skeleton, poses: Array, upper: int, middle: int, end: int) -> Array | None:
    """Direction to which the end of a limb moves where it bends, in the frame of its upper joint; None for straight."""
    chosen = np.asarray(poses, np.float32).copy()
    chosen[:, upper] = [1.0, 0.0, 0.0, 0.0]
    positions, rotations = forward_kinematics(skeleton, np.zeros((len(chosen), 3), np.float32), chosen)
    own = quaternion.conjugate(rotations[:, upper]).astype(float)
    along = quaternion.rotate(own, (positions[:, middle] - positions[:, upper]).astype(float))
    beyond = quaternion.rotate(own, (positions[:, end] - positions[:, middle]).astype(float))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    folds = np.mean(beyond - along * np.sum(beyond * along, axis=1, keepdims=True), axis=0)
    return _unit(folds) if _length(folds) > 0.1 * float(np.linalg.norm(beyond[0])) else None


def _segment(positions: Array, start: int, stop: int, front: Array, outwards: Array) -> Segment:
    way = positions[stop] - positions[start]
    along = _unit(way)
    front = _unit(front - along * (front @ along))
    outwards = outwards - along * (outwards @ along)
    return Segment(start, positions[start], np.stack([along, front, _unit(outwards - front * (outwards @ front))]),
                   _length(way))  # fmt: skip


def _length(v: Array) -> float:
    return float(np.linalg.norm(v))


def _unit(v: object) -> Array:
    vector = np.asarray(v, float)
    return vector / _length(vector)


def _of_matrix(matrix: Array) -> Array:
    """The quaternion of a rotation matrix."""
    whole = np.zeros((4, 4))
    whole[0, 0] = np.trace(matrix)
    whole[0, 1:] = whole[1:, 0] = [
        matrix[2, 1] - matrix[1, 2],
        matrix[0, 2] - matrix[2, 0],
        matrix[1, 0] - matrix[0, 1],
    ]
    whole[1:, 1:] = matrix + matrix.T - np.trace(matrix) * np.eye(3)
    _, vectors = np.linalg.eigh(whole)
    best = vectors[:, -1]
    return best if best[0] >= 0 else -best

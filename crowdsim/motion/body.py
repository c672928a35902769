"""What a skeleton is as a human body: roles of joints, sizes, and the capsules around its bones."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.strikers import build_strikers

ROLES = (
    "pelvis", "spine", "chest", "neck", "head",
    "left_shoulder", "left_elbow", "left_hand", "right_shoulder", "right_elbow", "right_hand",
    "left_hip", "left_knee", "left_foot", "left_toe", "right_hip", "right_knee", "right_foot", "right_toe",
)  # fmt: skip

PARTS = ("skin", "head", "glove", "shirt", "trunks", "shoe")

HEIGHT = 1.75
"""Standing height [m] of the body for which sizes are stated; they scale with a body's own height."""
HEAD_RADIUS, TORSO_RADIUS = 0.105, 0.15
_FIST, _SHOE, _SOLE = 0.06, 0.036, 0.02
"""Radius of a glove and of a shoe, and thickness of the sole under the joint at the ball of the foot [m]."""


@dataclass(frozen=True)
class Body:
    """A human body on a skeleton; every position is in the named joint's own frame.

    Attributes:
        roles: Joint of each role of ``ROLES`` that the skeleton has; the toes may be missing.
        height: Standing height, sole to crown [m].
        fist_offsets: Middle of the closed fist in the frame of the hand joint, left and right [m]. Shape (2, 3).
        head_offset: Centre of the head in the frame of the head joint [m]. Shape (3,).
        sole_offsets: Heel and ball of each foot's sole in the frame of the foot joint [m]. Shape (2, 2, 3): left and
            right, then heel and ball.
        head_radius: Radius of the head's sphere [m].
        torso_radius: Radius of the torso's capsule, which reaches from the pelvis joint to the neck joint [m].
        capsule_joints: Joint that each capsule rides on. Shape (K,), int32.
        capsule_starts: One end of each capsule's axis in that joint's frame [m]. Shape (K, 3).
        capsule_ends: The other end [m]. Shape (K, 3).
        capsule_radii: Radius at both ends [m]. Shape (K, 2).
        capsule_parts: Index into ``PARTS`` of each capsule, which colours follow. Shape (K,), uint8.
        props: What its hands hold that strikes, one for each hand at the most: ``joint``, ``side`` (0 left, 1 right),
            ``offset`` of the point that strikes in the joint's frame [m], and ``radius`` [m].
    """

    roles: Mapping[str, int]
    height: float
    fist_offsets: Array
    head_offset: Array
    sole_offsets: Array
    head_radius: float
    torso_radius: float
    capsule_joints: Array
    capsule_starts: Array
    capsule_ends: Array
    capsule_radii: Array
    capsule_parts: Array
    props: tuple[Mapping[str, Any], ...] = ()

    @property
    def foot_offsets(self) -> Array:
        """What each foot kicks with: the middle of the shoe over the ball, in the foot joint's frame [m]. (2, 3)."""
        return np.stack([sole[1] + _SHOE * self.height / HEIGHT * _upward(*sole) for sole in self.sole_offsets])

    @cached_property
    def strikers(self) -> Array:
        """What it can strike with, in the order of ``strikers.LIMBS``. Shape (11,), ``STRIKER``."""
        size = self.height / HEIGHT
        radii = _FIST * size, _SHOE * size, self.head_radius
        return build_strikers(
            self.roles, self.fist_offsets, self.foot_offsets, self.head_offset, radii, size, self.props
        )


def standing_height(skeleton: Skeleton, roles: Mapping[str, int], positions: Array | None = None) -> float:
    """Return the height of the standing body from its bones, in the unit of the offsets.

    Legs and trunk up to the base of the skull make 84 % of a human's height (after Winter's table of segments), and
    bone lengths, unlike poses, cannot lie.

    Args:
        skeleton: The skeleton.
        roles: Its joints by role.
        positions: Joint positions of any true pose, for the direction from the hips to the spine. Shape (J, 3); the
            rest pose when None.
    """
    tree = JointTree(skeleton, None)
    legs = [tree.path_length(roles[f"{side}_hip"], roles[f"{side}_foot"]) for side in ("left", "right")]
    positions = skeleton.rest_positions() if positions is None else positions
    # The trunk begins between the hips; the pelvis joint may lie above or below.
    hips = 0.5 * (positions[roles["left_hip"]] + positions[roles["right_hip"]])
    trunk = tree.path_length(roles["spine"], roles["head"]) + float(np.linalg.norm(positions[roles["spine"]] - hips))
    return (float(np.mean(legs)) + trunk) / 0.84


def build_body(
    skeleton: Skeleton, roles: Mapping[str, int] | None = None, pose: tuple[Array, Array] | None = None
) -> Body:
    """Measure a skeleton in metres as a human body.

    Args:
        skeleton: The skeleton [m].
        roles: Its joints by role; found by ``find_roles`` when None.
        pose: Positions (J, 3) and rotations (J, 4) in the world of an upright pose, for skeletons whose
            rest pose is no pose of a body, such as those whose bones all lie along one axis; the rest pose when None.

    Raises:
        MotionError: The skeleton is no human body.
    """
    roles = dict(find_roles(skeleton) if roles is None else roles)
    if not roles:
        raise MotionError(
            f"no human body found in the {skeleton.joint_count} joints {', '.join(skeleton.names[:8])} ...; "
            "expected a head, two hands and two feet on a trunk"
        )
    stance = _Stance(skeleton, roles, pose)
    height = standing_height(skeleton, roles, stance.positions)
    size = height / HEIGHT
    fists = np.stack([_fist(stance, side, height) for side in ("left", "right")])
    soles = np.stack([_sole(stance, side, size) for side in ("left", "right")])
    head = _head(stance, height)
    capsules = _Capsules(stance, size)
    _shape_trunk(capsules, head)
    for index, side in enumerate(("left", "right")):
        _shape_limbs(capsules, side, fists[index], soles[index])
    return Body(
        roles=roles,
        height=height,
        fist_offsets=fists,
        head_offset=head,
        sole_offsets=soles,
        head_radius=HEAD_RADIUS * size,
        torso_radius=TORSO_RADIUS * size,
        capsule_joints=np.array(capsules.joints, np.int32),
        capsule_starts=np.array(capsules.starts, float),
        capsule_ends=np.array(capsules.ends, float),
        capsule_radii=np.array(capsules.radii, float),
        capsule_parts=np.array(capsules.parts, np.uint8),
    )


class _Stance:
    """The pose in which a body is measured: positions of joints, and vectors between them in the joints' own frames."""

    def __init__(self, skeleton: Skeleton, roles: Mapping[str, int], pose: tuple[Array, Array] | None) -> None:
        self.skeleton, self.roles, self.posed = skeleton, roles, pose is not None
        self.positions = skeleton.rest_positions() if pose is None else np.asarray(pose[0], float)
        self.rotations = None if pose is None else np.asarray(pose[1], float)

    def own(self, joint: int, vector: Array) -> Array:
        """A vector of the world in the frame of a joint."""
        if self.rotations is None:
            return vector
        return quaternion.rotate(quaternion.conjugate(self.rotations[joint]), vector)

    def between(self, joint: int, start: int, end: int) -> Array:
        """The vector from one joint to another in the frame of a third."""
        return self.own(joint, self.positions[end] - self.positions[start])

    def at(self, role: str) -> int:
        """The joint of a role."""
        return self.roles[role]

    def ends(self, joint: int) -> Array:
        """Positions of the end sites that hang on a joint, in its frame. Shape (n, 3)."""
        return self.skeleton.end_offsets[self.skeleton.end_parents == joint]


def _unit(v: Array) -> Array:
    length = float(np.linalg.norm(v))
    return v / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])


def _fist(stance: _Stance, side: str, height: float) -> Array:
    """Middle of the fist: the knuckles where there are fingers, else a little beyond the wrist."""
    hand = stance.at(f"{side}_hand")
    ahead = _unit(stance.between(hand, stance.at(f"{side}_elbow"), hand))
    positions = [stance.skeleton.offsets[child] for child in stance.skeleton.children(hand)]
    positions = [
        place for place in positions if 0.02 * height < np.dot(place, ahead) and np.linalg.norm(place) < 0.1 * height
    ]
    if positions:
        # Bones of the palm begin at the wrist, and a thumb alone lies aside: the fist is no nearer and no further.
        middle = np.mean(positions, axis=0)
        reach = float(np.clip(np.linalg.norm(middle), 0.04 * height, 0.055 * height))
        ahead = _unit(_unit(middle) + (ahead if len(positions) == 1 else 0.0))
        return np.asarray(ahead * reach)
    return np.asarray(ahead * 0.045 * height)


def _head(stance: _Stance, height: float) -> Array:
    """Centre of the head above the joint at the base of the skull."""
    head, neck = stance.at("head"), stance.at("neck")
    up = stance.between(head, neck if neck != head else stance.at("chest"), head)
    ends = stance.ends(head)
    if len(ends) and 0.05 * height < np.linalg.norm(ends[0]) < 0.2 * height:
        up = ends[0]
    return _unit(up) * 0.05 * height


def _sole(stance: _Stance, side: str, size: float) -> Array:
    """Heel and ball on the sole, from the joint or the end site at the front of the foot."""
    foot = stance.at(f"{side}_foot")
    if stance.posed:
        down = stance.own(foot, np.array([0.0, -1.0, 0.0]))
    else:
        down = _unit(stance.between(foot, stance.at(f"{side}_knee"), foot))
        if np.abs(down).max() > 0.9:
            axis = int(np.argmax(np.abs(down)))
            down = np.eye(3)[axis] * np.sign(down[axis])
    toe = stance.roles.get(f"{side}_toe")
    ends = stance.ends(foot)
    ends = ends[np.linalg.norm(ends, axis=1) > 0.02 * size] if len(ends) else ends
    across = stance.between(foot, stance.at("right_hip"), stance.at("left_hip"))
    forward = _unit(np.cross(across, -down))
    if toe is not None:
        ball = stance.between(foot, foot, toe)
    elif len(ends) and np.linalg.norm(np.cross(ends, down), axis=1).max() > 0.04 * size:
        ball = ends[int(np.argmax(np.linalg.norm(ends, axis=1)))]
    else:
        ends = ends[:0]
        ball = size * (0.07 * down + 0.13 * forward)
    drop = float(np.dot(ball, down))
    level = ball - drop * down
    # A toe right under the ankle, or none at all, does not determine the direction of the foot.
    ahead = _unit(level) if np.linalg.norm(level) > 0.03 * size else forward
    length = float(np.clip(np.dot(ball, ahead), 0.06 * size, 0.17 * size if toe is not None else 0.24 * size))
    if toe is None and len(ends):
        length *= 0.72
    sole = max(drop + _SOLE * size, 0.03 * size) if toe is not None else max(drop, 0.03 * size)
    return np.stack([down * sole - ahead * 0.05 * size, down * sole + ahead * length])


class _Capsules:
    """Collects capsules; radii are given for a body of ``HEIGHT``."""

    def __init__(self, stance: _Stance, size: float) -> None:
        self.stance, self.size = stance, size
        self.joints: list[int] = []
        self.starts: list[Array] = []
        self.ends: list[Array] = []
        self.radii: list[tuple[float, float]] = []
        self.parts: list[int] = []

    def add(self, joint: int, start: Array, end: Array, radii: tuple[float, float], part: str) -> None:
        """Add a capsule in the frame of ``joint``."""
        self.joints.append(joint)
        self.starts.append(np.asarray(start, float))
        self.ends.append(np.asarray(end, float))
        self.radii.append((radii[0] * self.size, radii[1] * self.size))
        self.parts.append(PARTS.index(part))

    def bone(
        self, start: int, end: int, radii: tuple[float, float], part: str, span: tuple[float, float] = (0.0, 1.0)
    ) -> None:
        """Add a capsule along the bone between two joints, or along a span of it."""
        bone = self.stance.between(start, start, end)
        self.add(start, bone * span[0], bone * span[1], radii, part)


def _shape_trunk(capsules: _Capsules, head: Array) -> None:
    stance = capsules.stance
    roles, parents = stance.roles, stance.skeleton.parents
    pelvis, neck, chest = roles["pelvis"], roles["neck"], roles["chest"]
    inward = 0.75
    hips = [stance.between(pelvis, pelvis, roles[f"{side}_hip"]) for side in ("left", "right")]
    capsules.add(pelvis, hips[0] * inward, hips[1] * inward, (0.1, 0.1), "trunks")
    chain = [neck]
    while chain[-1] not in (pelvis, roles["spine"]) and parents[chain[-1]] >= 0:
        chain.append(int(parents[chain[-1]]))
    if chain[-1] != pelvis:
        chain.append(pelvis)
    for start, end in itertools.pairwise(chain[::-1]):
        capsules.bone(start, end, (0.115, 0.115) if end != neck else (0.12, 0.075), "shirt")
    shoulders = [stance.between(chest, chest, roles[f"{side}_shoulder"]) for side in ("left", "right")]
    middle = 0.5 * (shoulders[0] + shoulders[1])
    ends = [middle + 0.8 * (shoulder - middle) for shoulder in shoulders]
    capsules.add(chest, ends[0], ends[1], (0.07, 0.07), "shirt")
    if neck != roles["head"]:
        capsules.bone(neck, roles["head"], (0.052, 0.052), "skin")
    capsules.add(roles["head"], head, head, (HEAD_RADIUS, HEAD_RADIUS), "head")


def _shape_limbs(capsules: _Capsules, side: str, fist: Array, sole: Array) -> None:
    roles = capsules.stance.roles
    shoulder, elbow, hand = (roles[f"{side}_{role}"] for role in ("shoulder", "elbow", "hand"))
    hip, knee, foot = (roles[f"{side}_{role}"] for role in ("hip", "knee", "foot"))
    capsules.bone(shoulder, elbow, (0.056, 0.043), "skin")
    capsules.bone(elbow, hand, (0.043, 0.034), "skin")
    capsules.add(hand, fist * 0.35, fist, (0.045, _FIST), "glove")
    capsules.bone(hip, knee, (0.09, 0.075), "trunks", (0.0, 0.55))
    capsules.bone(hip, knee, (0.068, 0.052), "skin", (0.55, 1.0))
    capsules.bone(knee, foot, (0.053, 0.037), "skin")
    heel, ball = sole
    ahead, up, radius = _unit(ball - heel), _upward(heel, ball), _SHOE * capsules.size
    toes = ball + up * radius + ahead * 0.03 * capsules.size
    capsules.add(foot, heel + (up + ahead) * radius, toes, (_SHOE,) * 2, "shoe")


def _upward(heel: Array, ball: Array) -> Array:
    """The direction from a sole to the foot joint over it."""
    ahead = _unit(ball - heel)
    return _unit(ahead * np.dot(heel, ahead) - heel)

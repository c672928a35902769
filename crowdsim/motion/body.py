"""What a skeleton is as a human body: roles of joints, sizes, and the capsules around its bones."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import MotionError
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Skeleton

Array = NDArray[Any]

ROLES = (
    "pelvis", "spine", "chest", "neck", "head",
    "left_shoulder", "left_elbow", "left_hand", "right_shoulder", "right_elbow", "right_hand",
    "left_hip", "left_knee", "left_foot", "left_toe", "right_hip", "right_knee", "right_foot", "right_toe",
)  # fmt: skip

PARTS = ("skin", "head", "glove", "shirt", "trunks", "shoe")

HEIGHT = 1.75
"""Standing height [m] of the body for which sizes are stated; they scale with a body's own height."""
HEAD_RADIUS, TORSO_RADIUS = 0.105, 0.15
_SOLE = 0.02
"""Thickness of the sole under the joint at the ball of the foot [m]."""


@dataclass(frozen=True)
class Body:
    """A human body on a skeleton; every place is in the named joint's own frame.

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


def standing_height(skeleton: Skeleton, roles: Mapping[str, int]) -> float:
    """Return the height of the standing body from its bones, in the unit of the offsets.

    Legs and trunk up to the base of the skull make 84 % of a human's height (after Winter's table of segments), and
    bone lengths, unlike poses, cannot lie.
    """
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    legs = [_along(skeleton, lengths, roles[f"{side}_hip"], roles[f"{side}_foot"]) for side in ("left", "right")]
    trunk = _along(skeleton, lengths, roles["pelvis"], roles["head"])
    rest = skeleton.rest_positions()
    hips = 0.5 * (rest[roles["left_hip"]] + rest[roles["right_hip"]])
    trunk += float(
        np.linalg.norm(rest[roles["spine"]] - hips) - np.linalg.norm(rest[roles["spine"]] - rest[roles["pelvis"]])
    )
    return (float(np.mean(legs)) + trunk) / 0.84


def _along(skeleton: Skeleton, lengths: Array, start: int, end: int) -> float:
    """Length of the bones from ``start`` to ``end``; zero where they do not lie on one chain."""
    total = 0.0
    while end != start and end >= 0:
        total += float(lengths[end])
        end = int(skeleton.parents[end])
    return total if end == start else 0.0


def build_body(skeleton: Skeleton, roles: Mapping[str, int] | None = None) -> Body:
    """Measure a skeleton in metres as a human body.

    Args:
        skeleton: The skeleton [m].
        roles: Its joints by role; found by ``find_roles`` when None.

    Raises:
        MotionError: The skeleton is no human body.
    """
    roles = dict(find_roles(skeleton) if roles is None else roles)
    if not roles:
        raise MotionError(
            f"no human body found in the {skeleton.joint_count} joints {', '.join(skeleton.names[:8])} ...; "
            "expected a head, two hands and two feet on a trunk"
        )
    height = standing_height(skeleton, roles)
    size = height / HEIGHT
    rest = skeleton.rest_positions()
    fists = np.stack([_fist(skeleton, roles, rest, side, height) for side in ("left", "right")])
    soles = np.stack([_sole(skeleton, roles, rest, side, size) for side in ("left", "right")])
    head = _head(skeleton, roles, rest, height)
    capsules = _Capsules(rest, size)
    _shape_trunk(capsules, skeleton, roles, head)
    for index, side in enumerate(("left", "right")):
        _shape_limbs(capsules, roles, side, fists[index], soles[index])
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


def _unit(v: Array) -> Array:
    length = float(np.linalg.norm(v))
    return v / length if length > 1e-9 else np.array([0.0, 1.0, 0.0])


def _ends(skeleton: Skeleton, joint: int) -> Array:
    """Places of the end sites that hang on a joint, in its frame. Shape (n, 3)."""
    return skeleton.end_offsets[skeleton.end_parents == joint]


def _fist(skeleton: Skeleton, roles: Mapping[str, int], rest: Array, side: str, height: float) -> Array:
    """Middle of the fist: the knuckles where there are fingers, else a little beyond the wrist."""
    hand = roles[f"{side}_hand"]
    ahead = _unit(rest[hand] - rest[roles[f"{side}_elbow"]])
    places = [skeleton.offsets[child] for child in skeleton.children(hand)]
    places = [place for place in places if np.dot(place, ahead) > 0.02 * height]
    if places:
        return np.asarray(np.mean(places, axis=0))
    return np.asarray(ahead * 0.045 * height)


def _head(skeleton: Skeleton, roles: Mapping[str, int], rest: Array, height: float) -> Array:
    """Centre of the head above the joint at the base of the skull."""
    up = rest[roles["head"]] - rest[roles["neck"]] if roles["neck"] != roles["head"] else np.zeros(3)
    ends = _ends(skeleton, roles["head"])
    if len(ends) and 0.05 * height < np.linalg.norm(ends[0]) < 0.2 * height:
        up = ends[0]
    return _unit(up) * 0.05 * height


def _sole(skeleton: Skeleton, roles: Mapping[str, int], rest: Array, side: str, size: float) -> Array:
    """Heel and ball on the sole, from the joint or the end site at the front of the foot."""
    foot = roles[f"{side}_foot"]
    down = _unit(rest[foot] - rest[roles[f"{side}_knee"]])
    if np.abs(down).max() > 0.9:
        axis = int(np.argmax(np.abs(down)))
        down = np.eye(3)[axis] * np.sign(down[axis])
    toe = roles.get(f"{side}_toe")
    ends = _ends(skeleton, foot)
    if toe is not None:
        ball = rest[toe] - rest[foot]
    elif len(ends):
        ball = ends[int(np.argmax(np.linalg.norm(ends, axis=1)))]
    else:
        hips = rest[roles["left_hip"]] - rest[roles["right_hip"]]
        ball = 0.05 * size * down + 0.12 * size * _unit(np.cross(hips, -down))
    drop = float(np.dot(ball, down))
    ahead = _unit(ball - drop * down)
    length = float(np.dot(ball, ahead))
    if toe is None and len(ends):
        length *= 0.72
    sole = max(drop + _SOLE * size, 0.03 * size) if toe is not None else max(drop, 0.03 * size)
    return np.stack([down * sole - ahead * 0.05 * size, down * sole + ahead * length])


class _Capsules:
    """Collects capsules; radii are given for a body of ``HEIGHT``."""

    def __init__(self, rest: Array, size: float) -> None:
        self.rest, self.size = rest, size
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
        bone = self.rest[end] - self.rest[start]
        self.add(start, bone * span[0], bone * span[1], radii, part)


def _shape_trunk(capsules: _Capsules, skeleton: Skeleton, roles: Mapping[str, int], head: Array) -> None:
    rest = capsules.rest
    pelvis, neck = roles["pelvis"], roles["neck"]
    inward = 0.75
    hips = [rest[roles[f"{side}_hip"]] - rest[pelvis] for side in ("left", "right")]
    capsules.add(pelvis, hips[0] * inward, hips[1] * inward, (0.1, 0.1), "trunks")
    chain = [neck]
    while chain[-1] != pelvis and skeleton.parents[chain[-1]] >= 0:
        chain.append(int(skeleton.parents[chain[-1]]))
    chain = chain[::-1]
    for start, end in itertools.pairwise(chain):
        capsules.bone(start, end, (0.115, 0.115) if end != neck else (0.12, 0.075), "shirt")
    chest = roles["chest"]
    shoulders = [rest[roles[f"{side}_shoulder"]] - rest[chest] for side in ("left", "right")]
    middle = 0.5 * (shoulders[0] + shoulders[1])
    ends = [middle + 0.8 * (shoulder - middle) for shoulder in shoulders]
    capsules.add(chest, ends[0], ends[1], (0.07, 0.07), "shirt")
    if neck != roles["head"]:
        capsules.bone(neck, roles["head"], (0.052, 0.052), "skin")
    capsules.add(roles["head"], head, head, (HEAD_RADIUS, HEAD_RADIUS), "head")


def _shape_limbs(capsules: _Capsules, roles: Mapping[str, int], side: str, fist: Array, sole: Array) -> None:
    shoulder, elbow, hand = (roles[f"{side}_{role}"] for role in ("shoulder", "elbow", "hand"))
    hip, knee, foot = (roles[f"{side}_{role}"] for role in ("hip", "knee", "foot"))
    capsules.bone(shoulder, elbow, (0.056, 0.043), "skin")
    capsules.bone(elbow, hand, (0.043, 0.034), "skin")
    capsules.add(hand, fist * 0.35, fist, (0.045, 0.06), "glove")
    capsules.bone(hip, knee, (0.09, 0.075), "trunks", (0.0, 0.55))
    capsules.bone(hip, knee, (0.068, 0.052), "skin", (0.55, 1.0))
    capsules.bone(knee, foot, (0.053, 0.037), "skin")
    heel, ball = sole
    ahead = _unit(ball - heel)
    up = _unit(ahead * np.dot(heel, ahead) - heel)
    radius = 0.036 * capsules.size
    capsules.add(
        foot, heel + (up + ahead) * radius, ball + up * radius + ahead * 0.03 * capsules.size, (0.036,) * 2, "shoe"
    )

"""What a skeleton is as a human body: roles of joints, sizes, and the capsules around its bones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
HEAD_RADIUS, TORSO_RADIUS = 0.11, 0.15


@dataclass(frozen=True)
class Body:
    """A human body on a skeleton; every place is in the named joint's own frame.

    Attributes:
        roles: Joint of each role of ``ROLES`` that the skeleton has; the toes may be missing.
        height: Standing height, sole to crown [m].
        fist_offsets: Middle of the closed fist in the frame of the hand joint, left and right [m]. Shape (2, 3).
        head_offset: Centre of the head in the frame of the head joint [m]. Shape (3,).
        sole_offsets: Ankle, heel and ball of each foot's sole in the frame of the foot joint [m]. Shape (2, 2, 3):
            foot, then heel and ball.
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

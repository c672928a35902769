"""The embedded boxer's skeleton: 22 joints of a man of 1.75 m, with joint names that other tools recognise."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.skeleton import Skeleton

# Lengths in metres, after Winter's table of segments for a standing height of 1.75 m.
HIP_HALF = 0.09
HIP_DROP = 0.045
THIGH, SHANK = 0.425, 0.41
ANKLE_HEIGHT = 0.085
BALL_HEIGHT = 0.02
BALL_AHEAD = 0.13
UPPER_ARM, FOREARM = 0.30, 0.262
FIST_AHEAD = 0.079
"""Middle of the closed fist ahead of the wrist."""
PELVIS_HEIGHT = ANKLE_HEIGHT + SHANK + THIGH + HIP_DROP
HEAD_CENTRE = 0.0875
"""Middle of the head over the joint at the base of the skull."""

HIPS, SPINE, SPINE1, SPINE2, NECK, HEAD = range(6)
SHOULDERS, ARMS, FOREARMS, HANDS = (6, 10), (7, 11), (8, 12), (9, 13)
UP_LEGS, LEGS, FEET, TOES = (14, 18), (15, 19), (16, 20), (17, 21)

_JOINTS = (
    ("Hips", -1, (0.0, PELVIS_HEIGHT, 0.0)),
    ("Spine", HIPS, (0.0, 0.095, -0.01)),
    ("Spine1", SPINE, (0.0, 0.12, -0.005)),
    ("Spine2", SPINE1, (0.0, 0.12, 0.0)),
    ("Neck", SPINE2, (0.0, 0.165, 0.0)),
    ("Head", NECK, (0.0, 0.09, 0.015)),
    ("LeftShoulder", SPINE2, (0.03, 0.115, 0.01)),
    ("LeftArm", SHOULDERS[0], (0.155, 0.0, -0.015)),
    ("LeftForeArm", ARMS[0], (UPPER_ARM, 0.0, 0.0)),
    ("LeftHand", FOREARMS[0], (FOREARM, 0.0, 0.0)),
    ("RightShoulder", SPINE2, (-0.03, 0.115, 0.01)),
    ("RightArm", SHOULDERS[1], (-0.155, 0.0, -0.015)),
    ("RightForeArm", ARMS[1], (-UPPER_ARM, 0.0, 0.0)),
    ("RightHand", FOREARMS[1], (-FOREARM, 0.0, 0.0)),
    ("LeftUpLeg", HIPS, (HIP_HALF, -HIP_DROP, 0.0)),
    ("LeftLeg", UP_LEGS[0], (0.0, -THIGH, 0.0)),
    ("LeftFoot", LEGS[0], (0.0, -SHANK, 0.0)),
    ("LeftToe", FEET[0], (0.0, BALL_HEIGHT - ANKLE_HEIGHT, BALL_AHEAD)),
    ("RightUpLeg", HIPS, (-HIP_HALF, -HIP_DROP, 0.0)),
    ("RightLeg", UP_LEGS[1], (0.0, -THIGH, 0.0)),
    ("RightFoot", LEGS[1], (0.0, -SHANK, 0.0)),
    ("RightToe", FEET[1], (0.0, BALL_HEIGHT - ANKLE_HEIGHT, BALL_AHEAD)),
)
_END_SITES = (
    (HEAD, (0.0, 0.195, 0.0)),
    (HANDS[0], (0.105, 0.0, 0.0)),
    (HANDS[1], (-0.105, 0.0, 0.0)),
    (TOES[0], (0.0, -0.005, 0.065)),
    (TOES[1], (0.0, -0.005, 0.065)),
)


def build_skeleton() -> Skeleton:
    """Return the boxer in a T-pose: facing +z, arms along x, soles on y = 0, 1.75 m tall."""
    names, parents, offsets = zip(*_JOINTS, strict=True)
    end_parents, end_offsets = zip(*_END_SITES, strict=True)
    return Skeleton(
        names, np.array(parents, np.int32), np.array(offsets), np.array(end_parents, np.int32), np.array(end_offsets)
    )


def mirror_joints() -> Array:
    """Return, for each joint, the joint on the other side. Shape (22,), int32."""
    order = np.arange(22, dtype=np.int32)
    order[6:10], order[10:14] = np.arange(10, 14), np.arange(6, 10)
    order[14:18], order[18:22] = np.arange(18, 22), np.arange(14, 18)
    return order

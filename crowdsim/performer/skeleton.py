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

_TRUNK = (
    ("Hips", -1, (0.0, PELVIS_HEIGHT, 0.0)),
    ("Spine", HIPS, (0.0, 0.095, -0.01)),
    ("Spine1", SPINE, (0.0, 0.12, -0.005)),
    ("Spine2", SPINE1, (0.0, 0.12, 0.0)),
    ("Neck", SPINE2, (0.0, 0.165, 0.0)),
    ("Head", NECK, (0.0, 0.09, 0.015)),
)


def _side(name: str, sign: float) -> list[tuple[str, str, tuple[float, float, float]]]:
    return [
        (f"{name}Shoulder", "Spine2", (0.03 * sign, 0.115, 0.01)),
        (f"{name}Arm", f"{name}Shoulder", (0.155 * sign, 0.0, -0.015)),
        (f"{name}ForeArm", f"{name}Arm", (UPPER_ARM * sign, 0.0, 0.0)),
        (f"{name}Hand", f"{name}ForeArm", (FOREARM * sign, 0.0, 0.0)),
    ]


def _leg(name: str, sign: float) -> list[tuple[str, str, tuple[float, float, float]]]:
    return [
        (f"{name}UpLeg", "Hips", (HIP_HALF * sign, -HIP_DROP, 0.0)),
        (f"{name}Leg", f"{name}UpLeg", (0.0, -THIGH, 0.0)),
        (f"{name}Foot", f"{name}Leg", (0.0, -SHANK, 0.0)),
        (f"{name}Toe", f"{name}Foot", (0.0, BALL_HEIGHT - ANKLE_HEIGHT, BALL_AHEAD)),
    ]


def build_skeleton() -> Skeleton:
    """Return the boxer in a T-pose: facing +z, arms along x, soles on y = 0, 1.75 m tall."""
    names = [name for name, _, _ in _TRUNK]
    parents = [parent for _, parent, _ in _TRUNK]
    offsets = [offset for _, _, offset in _TRUNK]
    limbs = [*_side("Left", 1.0), *_side("Right", -1.0), *_leg("Left", 1.0), *_leg("Right", -1.0)]
    for name, parent_name, offset in limbs:
        parents.append(names.index(parent_name))
        names.append(name)
        offsets.append(offset)
    ends = [
        (HEAD, (0.0, 0.195, 0.0)),
        (HANDS[0], (0.105, 0.0, 0.0)),
        (HANDS[1], (-0.105, 0.0, 0.0)),
        (TOES[0], (0.0, -0.005, 0.065)),
        (TOES[1], (0.0, -0.005, 0.065)),
    ]
    return Skeleton(
        names=tuple(names),
        parents=np.array(parents, np.int32),
        offsets=np.array(offsets, float),
        end_parents=np.array([joint for joint, _ in ends], np.int32),
        end_offsets=np.array([offset for _, offset in ends], float),
    )


def mirror_joints() -> Array:
    """Return, for each joint, the joint on the other side. Shape (22,), int32."""
    order = np.arange(22, dtype=np.int32)
    order[6:10], order[10:14] = np.arange(10, 14), np.arange(6, 10)
    order[14:18], order[18:22] = np.arange(18, 22), np.arange(14, 18)
    return order

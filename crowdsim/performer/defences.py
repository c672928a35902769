"""The defences: knees and spine take the head off the line, or arms take the blow.

Phase 0 is when a defence begins, 1 when it is at its height, 2 when the guard stands again.
"""

from __future__ import annotations

from crowdsim.performer.moves import Guarding, Part
from crowdsim.performer.score import Channel as C

DUCK = Guarding(
    parts=(
        Part(C.HEIGHT, -0.235, 0.00, 0.95, 1.00, 2.0),
        Part(C.PELVIS_TILT, 0.18, 0.00, 0.95, 1.00, 2.0),
        Part(C.FLEX, 0.34, 0.05, 1.00, 1.00, 1.9),
        Part(C.SHIFT_Z, -0.03, 0.00, 0.90, 1.00, 2.0),
        Part(C.REAR_HEEL, 0.42, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_HEEL, 0.10, 0.10, 0.95, 1.00, 2.0),
        Part(C.HEAD_NOD, -0.06, 0.10, 0.90, 1.00, 2.0),
        Part(C.LEAD_HAND_Y, 0.05, 0.00, 0.80, 1.00, 2.0),
        Part(C.LEAD_HAND_Z, -0.10, 0.00, 0.80, 1.00, 2.0),
        Part(C.REAR_HAND_Y, 0.03, 0.00, 0.80, 1.00, 2.0),
        Part(C.LEAD_RAISE, 0.12, 0.00, 0.80, 1.00, 2.0),
        Part(C.REAR_RAISE, 0.12, 0.00, 0.80, 1.00, 2.0),
    ),
    seconds=(0.38, 0.10, 0.46),
)

SLIP_LEFT = Guarding(
    parts=(
        Part(C.HEIGHT, -0.075, -0.10, 0.90, 1.00, 2.0),
        Part(C.SHIFT_X, 0.06, -0.10, 0.95, 1.00, 2.0),
        Part(C.SHIFT_Z, 0.04, -0.10, 0.95, 1.00, 2.0),
        Part(C.PELVIS_TURN, 0.20, -0.10, 0.90, 1.00, 2.0),
        Part(C.PELVIS_BEND, 0.06, 0.00, 0.90, 1.00, 2.0),
        Part(C.REAR_HEEL, 0.20, 0.00, 0.90, 1.00, 2.0),
        Part(C.REAR_YAW, 0.20, 0.00, 0.95, 1.05, 2.1),
        Part(C.TWIST, 0.26, 0.00, 1.00, 1.00, 2.0),
        Part(C.BEND, 0.42, 0.00, 1.00, 1.00, 1.95),
        Part(C.FLEX, 0.15, 0.00, 1.00, 1.00, 2.0),
        Part(C.HEAD_BEND, 0.06, 0.10, 1.00, 1.00, 2.0),
        Part(C.LEAD_HAND_Z, -0.07, 0.00, 0.90, 1.00, 2.0),
        Part(C.LEAD_HAND_Y, 0.03, 0.00, 0.90, 1.00, 2.0),
    ),
    seconds=(0.24, 0.06, 0.30),
)

SLIP_RIGHT = Guarding(
    parts=(
        Part(C.HEIGHT, -0.075, -0.10, 0.90, 1.00, 2.0),
        Part(C.SHIFT_X, -0.06, -0.10, 0.95, 1.00, 2.0),
        Part(C.SHIFT_Z, -0.02, -0.10, 0.95, 1.00, 2.0),
        Part(C.PELVIS_TURN, -0.14, -0.10, 0.90, 1.00, 2.0),
        Part(C.PELVIS_BEND, -0.06, 0.00, 0.90, 1.00, 2.0),
        Part(C.LEAD_HEEL, 0.12, 0.00, 0.90, 1.00, 2.0),
        Part(C.LEAD_YAW, -0.12, 0.00, 0.95, 1.05, 2.1),
        Part(C.TWIST, -0.22, 0.00, 1.00, 1.00, 2.0),
        Part(C.BEND, -0.44, 0.00, 1.00, 1.00, 1.95),
        Part(C.FLEX, 0.16, 0.00, 1.00, 1.00, 2.0),
        Part(C.HEAD_BEND, -0.06, 0.10, 1.00, 1.00, 2.0),
        Part(C.REAR_HAND_Y, 0.03, 0.00, 0.90, 1.00, 2.0),
        Part(C.LEAD_HAND_Z, -0.05, 0.00, 0.90, 1.00, 2.0),
    ),
    seconds=(0.24, 0.06, 0.30),
)

LEAN_BACK = Guarding(
    parts=(
        Part(C.SHIFT_Z, -0.12, -0.10, 0.90, 1.00, 2.1),
        Part(C.SHIFT_X, -0.03, -0.10, 0.90, 1.00, 2.1),
        Part(C.HEIGHT, -0.045, -0.05, 0.90, 1.00, 2.0),
        Part(C.REAR_HEEL, -0.22, -0.05, 0.80, 1.05, 2.1),
        Part(C.PELVIS_TILT, -0.16, 0.00, 0.90, 1.00, 2.0),
        Part(C.PELVIS_TURN, -0.12, 0.00, 0.90, 1.00, 2.0),
        Part(C.FLEX, -0.50, 0.05, 1.00, 1.00, 1.95),
        Part(C.TWIST, -0.08, 0.05, 1.00, 1.00, 1.95),
        Part(C.HEAD_NOD, 0.12, 0.10, 1.00, 1.00, 2.0),
        Part(C.LEAD_HAND_Z, -0.06, 0.00, 0.90, 1.00, 2.0),
        Part(C.REAR_HAND_Z, -0.02, 0.00, 0.90, 1.00, 2.0),
    ),
    seconds=(0.28, 0.08, 0.34),
)

BLOCK_HIGH_LEAD = Guarding(
    parts=(
        Part(C.LEAD_HAND_X, 0.07, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_HAND_Y, 0.11, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_HAND_Z, -0.20, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_RAISE, 0.30, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_ELBOW, 0.25, 0.00, 0.95, 1.00, 2.0),
        Part(C.TWIST, 0.10, 0.00, 0.95, 1.00, 2.0),
        Part(C.BEND, -0.07, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEIGHT, -0.03, 0.00, 0.95, 1.00, 2.0),
        Part(C.SHIFT_X, -0.03, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEAD_NOD, 0.12, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEAD_BEND, -0.06, 0.00, 0.95, 1.00, 2.0),
    ),
    seconds=(0.20, 0.14, 0.28),
)

BLOCK_HIGH_REAR = Guarding(
    parts=(
        Part(C.REAR_HAND_X, -0.06, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_HAND_Y, 0.11, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_HAND_Z, -0.09, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_RAISE, 0.30, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_ELBOW, 0.25, 0.00, 0.95, 1.00, 2.0),
        Part(C.TWIST, -0.10, 0.00, 0.95, 1.00, 2.0),
        Part(C.BEND, 0.07, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEIGHT, -0.03, 0.00, 0.95, 1.00, 2.0),
        Part(C.SHIFT_X, 0.03, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEAD_NOD, 0.12, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEAD_BEND, 0.06, 0.00, 0.95, 1.00, 2.0),
    ),
    seconds=(0.20, 0.14, 0.28),
)

BLOCK_LOW_LEAD = Guarding(
    parts=(
        Part(C.LEAD_HAND_X, 0.02, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_HAND_Y, -0.17, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_HAND_Z, -0.17, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_RAISE, -0.06, 0.00, 0.95, 1.00, 2.0),
        Part(C.BEND, 0.20, 0.00, 0.95, 1.00, 2.0),
        Part(C.FLEX, 0.16, 0.00, 0.95, 1.00, 2.0),
        Part(C.TWIST, -0.08, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEIGHT, -0.07, -0.05, 0.90, 1.00, 2.0),
        Part(C.REAR_HEEL, 0.10, 0.00, 0.90, 1.00, 2.0),
    ),
    seconds=(0.22, 0.12, 0.30),
)

BLOCK_LOW_REAR = Guarding(
    parts=(
        Part(C.REAR_HAND_X, -0.03, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_HAND_Y, -0.18, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_HAND_Z, -0.04, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_RAISE, -0.06, 0.00, 0.95, 1.00, 2.0),
        Part(C.BEND, -0.20, 0.00, 0.95, 1.00, 2.0),
        Part(C.FLEX, 0.16, 0.00, 0.95, 1.00, 2.0),
        Part(C.TWIST, 0.10, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEIGHT, -0.07, -0.05, 0.90, 1.00, 2.0),
        Part(C.REAR_HEEL, 0.08, 0.00, 0.90, 1.00, 2.0),
    ),
    seconds=(0.22, 0.12, 0.30),
)

COVER = Guarding(
    parts=(
        Part(C.HEIGHT, -0.09, -0.05, 0.90, 1.00, 2.0),
        Part(C.FLEX, 0.24, 0.00, 1.00, 1.00, 2.0),
        Part(C.PELVIS_TURN, 0.15, 0.00, 0.90, 1.00, 2.0),
        Part(C.REAR_HEEL, 0.10, 0.00, 0.90, 1.00, 2.0),
        Part(C.LEAD_HAND_X, -0.02, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_HAND_Y, 0.08, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_HAND_Z, -0.13, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_HAND_Y, 0.09, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_RAISE, 0.28, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_RAISE, 0.28, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_FORTH, 0.20, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_FORTH, 0.20, 0.00, 0.95, 1.00, 2.0),
        Part(C.LEAD_ELBOW, -0.25, 0.00, 0.95, 1.00, 2.0),
        Part(C.REAR_ELBOW, -0.25, 0.00, 0.95, 1.00, 2.0),
        Part(C.HEAD_NOD, 0.22, 0.00, 0.95, 1.00, 2.0),
    ),
    seconds=(0.24, 0.35, 0.34),
)

WEAVE = Guarding(
    parts=(
        Part(C.BEND, 0.22, -0.10, 0.50, 0.55, 1.2),
        Part(C.SHIFT_X, 0.05, -0.10, 0.50, 0.55, 1.2),
        Part(C.TWIST, 0.12, -0.10, 0.50, 0.55, 1.2),
        Part(C.HEIGHT, -0.22, 0.00, 1.00, 1.00, 2.0),
        Part(C.PELVIS_TILT, 0.14, 0.00, 1.00, 1.00, 2.0),
        Part(C.FLEX, 0.30, 0.05, 1.00, 1.00, 1.95),
        Part(C.REAR_HEEL, 0.36, 0.00, 1.00, 1.00, 2.0),
        Part(C.LEAD_HEEL, 0.08, 0.10, 1.00, 1.00, 2.0),
        Part(C.BEND, -0.26, 0.80, 1.45, 1.50, 2.1),
        Part(C.SHIFT_X, -0.06, 0.80, 1.45, 1.50, 2.1),
        Part(C.TWIST, -0.14, 0.80, 1.45, 1.50, 2.1),
        Part(C.LEAD_HAND_Y, 0.04, 0.00, 0.80, 1.20, 2.0),
        Part(C.LEAD_HAND_Z, -0.09, 0.00, 0.80, 1.20, 2.0),
        Part(C.REAR_HAND_Y, 0.03, 0.00, 0.80, 1.20, 2.0),
        Part(C.LEAD_RAISE, 0.12, 0.00, 0.80, 1.20, 2.0),
        Part(C.REAR_RAISE, 0.12, 0.00, 0.80, 1.20, 2.0),
    ),
    seconds=(0.42, 0.0, 0.50),
)

DEFENCES = {
    "duck": DUCK,
    "slip_left": SLIP_LEFT,
    "slip_right": SLIP_RIGHT,
    "lean_back": LEAN_BACK,
    "block_high_lead": BLOCK_HIGH_LEAD,
    "block_high_rear": BLOCK_HIGH_REAR,
    "block_low_lead": BLOCK_LOW_LEAD,
    "block_low_rear": BLOCK_LOW_REAR,
    "cover": COVER,
    "weave": WEAVE,
}

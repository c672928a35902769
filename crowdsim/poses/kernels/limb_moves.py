"""Compiled bounds of how far the middle and the end of a limb go: bones keep their lengths, and feet do not go down."""

import math

from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import LOWER, MIDDLE, UPPER

MOVED = 2
"""How many points of each limb move, its middle and its end."""
JOINT, END = 0, 1
"""Which of these points: elbow or knee, and wrist or ankle."""
_MOST = 0.25
"""Furthest that a point of a limb moves [m]."""


@kernel
def keep_bones(joints, moves):
    """Bring the middle and the end of an arm back to the lengths of its bones."""
    upper, middle, end = joints[UPPER], joints[MIDDLE], joints[LOWER]
    a = b = c = d = 0.0
    for k in range(3):
        a += (middle[k] - upper[k]) ** 2
        b += (end[k] - middle[k]) ** 2
        c += (middle[k] + moves[JOINT, k] - upper[k]) ** 2
    if a < 1e-9 or b < 1e-9 or c < 1e-9:
        return
    size = math.sqrt(a / c)
    for k in range(3):
        moves[JOINT, k] = upper[k] + (middle[k] + moves[JOINT, k] - upper[k]) * size - middle[k]
        d += (end[k] + moves[END, k] - middle[k] - moves[JOINT, k]) ** 2
    size = math.sqrt(b / max(d, 1e-9))
    for k in range(3):
        start = middle[k] + moves[JOINT, k]
        moves[END, k] = start + (end[k] + moves[END, k] - start) * size - end[k]


@kernel
def keep_leg(joints, moves):
    """Let a knee go where its leg swivels about the line from hip to ankle, and a foot anywhere but down."""
    upper, middle, end = joints[UPPER], joints[MIDDLE], joints[LOWER]
    ux, uy, uz = end[0] - upper[0], end[1] - upper[1], end[2] - upper[2]
    vx, vy, vz = middle[0] - upper[0], middle[1] - upper[1], middle[2] - upper[2]
    # As long as the line from hip to ankle, times how far the knee is from it.
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size, length = math.sqrt(x * x + y * y + z * z), math.sqrt(ux * ux + uy * uy + uz * uz)
    knee, along = moves[JOINT], 0.0
    if size > 1e-6 and length > 1e-6:
        most = size / length
        along = most * math.tanh((knee[0] * x + knee[1] * y + knee[2] * z) / size / most) / size
    knee[0], knee[1], knee[2] = along * x, along * y, along * z
    moves[END, 1] = max(moves[END, 1], 0.0)


@kernel
def limit(moves):
    """Keep a move within ``_MOST``, smoothly."""
    far = math.sqrt(moves[0] ** 2 + moves[1] ** 2 + moves[2] ** 2)
    if far > 1e-9:
        kept = (1.0 + (far / _MOST) ** 4) ** -0.25
        for k in range(3):
            moves[k] *= kept

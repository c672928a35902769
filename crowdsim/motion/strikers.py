"""What a body can strike with: a table of points on joints, whose strikes are found, trained, landed and exported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any

import numpy as np

from crowdsim.core.types import Array

STRIKER = np.dtype(
    [("joint", np.int32), ("offset", np.float64, 3), ("radius", np.float64), ("side", np.uint8), ("kind", np.uint8)]
)
"""Something that strikes: the joint that it is on, -1 where the body has none such; the point that strikes, in the
frame of that joint [m]; its radius [m]; its side, 0 left, 1 right, 2 neither; and its ``Kind``."""


class Kind(IntEnum):
    """Kinds of strikers."""

    HAND = 0
    FOOT = 1
    ELBOW = 2
    KNEE = 3
    PROP = 4
    HEAD = 5


LIMBS = (
    "left_hand", "right_hand", "left_foot", "right_foot", "left_elbow", "right_elbow", "left_knee", "right_knee",
    "left_prop", "right_prop", "head",
)  # fmt: skip
"""Names of the rows of a table of strikers. Left ones have even numbers; the mirror image of one is the next one or the
one before."""
HANDS, FEET, HEAD = (0, 1), (2, 3), 10
HANDS_AND_FEET = (*HANDS, *FEET)
LEGS = (*FEET, 6, 7)
"""Numbers of ``LIMBS``."""
SIDES = ("left", "right")
"""Sides of the body, by the number of a limb modulo two."""
GROUPS = {"hands": HANDS, "feet": FEET, "elbows": (4, 5), "knees": (6, 7), "props": (8, 9), "head": (HEAD,)}
"""Numbers of ``LIMBS`` of each kind, in the order of ``Kind`` but for the last two."""
CARRIERS = np.array([0, 1, 2, 3, 0, 1, 2, 3, 0, 1, -1], np.int64)
"""Arm (0, 1) or leg (2, 3) that carries each striker; -1 for the head, which the trunk carries."""
_ELBOW, _KNEE = 0.043, 0.052
"""Radius of elbows and knees of a body of 1.75 m [m]."""
_ROLES = ("hand", "foot", "elbow", "knee")


def mirror_limb(limb: int) -> int:
    """Return the number of the striker on the other side; the head's own."""
    return limb if limb == HEAD else limb ^ 1


def build_strikers(
    roles: Mapping[str, int],
    fists: Array,
    feet: Array,
    head: Array,
    radii: Sequence[float],
    size: float,
    props: Sequence[Mapping[str, Any]] = (),
) -> Array:
    """Return the strikers of a body, in the order of ``LIMBS``.

    Args:
        roles: Its joints by role.
        fists: Middles of both fists in the frames of the hands [m]. Shape (2, 3).
        feet: Points that kick, in the frames of the feet [m]. Shape (2, 3).
        head: Centre of the head in its frame [m]. Shape (3,).
        radii: Radius of a fist, of a shoe and of the head [m].
        size: Height of the body over 1.75 m.
        props: What its hands hold that strikes, see ``Body.props``.
    """
    table = np.zeros(len(LIMBS), STRIKER)
    for kind, role in enumerate(_ROLES):
        for side, name in enumerate(SIDES):
            table[2 * kind + side] = (roles.get(f"{name}_{role}", -1), (0.0, 0.0, 0.0), 0.0, side, kind)
    table["offset"][list(HANDS)], table["offset"][list(FEET)] = fists, feet
    table["radius"][:8] = np.repeat([radii[0], radii[1], _ELBOW * size, _KNEE * size], 2)
    for side in range(2):
        table[8 + side] = (-1, (0.0, 0.0, 0.0), 0.0, side, Kind.PROP)
    for prop in props:
        side = int(prop["side"])
        table[8 + side] = (int(prop["joint"]), tuple(prop["offset"]), float(prop["radius"]), side, Kind.PROP)
    table[HEAD] = (roles.get("head", -1), tuple(head), radii[2], 2, Kind.HEAD)
    return table

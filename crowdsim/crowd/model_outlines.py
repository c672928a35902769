"""Points of bodies that obstacles confine: heads, trunks, fists and soles in each frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.confinement import CLEARANCE
from crowdsim.crowd.kernels.layout import LEFT_FIST, LIMB_ROOM, RIGHT_FIST, TRUNK_ROOM
from crowdsim.crowd.model_arms import arm_rows
from crowdsim.crowd.model_falls import soles_of

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

DIRECTIONS = np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)], float)
"""Directions along which ``Model.spans`` says how far actions reach, the diagonal ones have a length of sqrt(2)."""
_SPARE = 1e-3
"""More than what rounding to single precision changes [m]."""


def outline_rows(policies: Sequence[Policy], actions: Array, ground: Array, strides: Array) -> dict[str, Array]:
    """Return ``Model.outlines``, ``Model.extents`` and ``Model.spans`` of policies.

    Args:
        policies: The policies.
        actions: ``Model.actions``. Shape (A + 1,).
        ground: ``Model.ground``. Shape (L,).
        strides: Playback frames in a control frame of each action. Shape (A + 1,).
    """
    points = []
    for policy in policies:
        database = policy.database
        trunk = np.stack([database.heads, database.necks, database.pelvises], axis=1)
        fists = arm_rows(database)[:, LEFT_FIST : RIGHT_FIST + 1]
        points.append(np.concatenate([trunk, fists, soles_of(policy).reshape(-1, 4, 3)], axis=1))
    outlines = np.concatenate(points).astype(np.float32)
    rooms = np.array([TRUNK_ROOM] * 3 + [LIMB_ROOM] * 6)
    extents = (np.hypot(outlines[..., 0], outlines[..., 2]) + rooms).max(axis=1)
    spans = _spans_of(outlines[..., 0::2], rooms, actions, ground, strides)
    return {"outlines": outlines, "extents": extents.astype(np.float32), "spans": spans}


def no_outlines() -> dict[str, Array]:
    """Return those of a crowd without obstacles: none."""
    outlines, extents = np.zeros((0, 9, 3), np.float32), np.zeros(0, np.float32)
    return {"outlines": outlines, "extents": extents, "spans": np.zeros((0, 9), np.float32)}


def _spans_of(points: Array, rooms: Array, actions: Array, ground: Array, strides: Array) -> Array:
    """Return an octagon around each action: all points (L, 9, 2) with their rooms, and the position. (A + 1, 9)."""
    points = np.concatenate([points, np.zeros((len(points), 1, 2))], axis=1)
    rooms, lengths = np.append(rooms, CLEARANCE), np.linalg.norm(DIRECTIONS, axis=1)
    cos, sin = np.cos(ground["heading"])[:, None], np.sin(ground["heading"])[:, None]
    x = ground["x"][:, None] + points[..., 0] * cos + points[..., 1] * sin
    z = ground["z"][:, None] - points[..., 0] * sin + points[..., 1] * cos
    ways = zip(DIRECTIONS, lengths, strict=True)
    reaches = np.stack([(dx * x + dz * z + length * rooms).max(axis=1) for (dx, dz), length in ways], axis=1)
    # Between two frames a body is interpolated.
    steps = np.hypot(np.diff(ground["x"]), np.diff(ground["z"]))
    steps = np.append(steps + np.abs(np.diff(ground["heading"])) * np.linalg.norm(points, axis=2).max(axis=1)[:-1], 0.0)
    counts = actions["length"] * strides + 1
    firsts = np.cumsum(counts) - counts
    frames = np.arange(counts.sum()) + np.repeat(actions["origin"] - firsts, counts)
    steps = steps[frames]
    steps[firsts + counts - 1] = 0.0
    spare = np.maximum.reduceat(steps, firsts) + _SPARE
    spans = np.maximum.reduceat(reaches[frames], firsts) + spare[:, None] * lengths
    middles = (spans[:, [0, 2]] - spans[:, [1, 3]]) / 2
    # A regular octagon around the middle has corners as far away as these at least.
    away = ((spans - middles @ DIRECTIONS.T) / lengths).max(axis=1) / math.cos(math.pi / 8)
    return np.column_stack([spans, away]).astype(np.float32)

"""Points of bodies that obstacles confine: heads, trunks, fists and soles in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.confinement import CLEARANCE
from crowdsim.crowd.kernels.layout import LEFT_FIST, LIMB_ROOM, RIGHT_FIST, TRUNK_ROOM
from crowdsim.crowd.kernels.records import SPAN
from crowdsim.crowd.model_arms import arm_rows
from crowdsim.crowd.model_falls import soles_of

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

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
    return {"outlines": outlines, "extents": extents, "spans": np.zeros(0, SPAN)}


def _spans_of(points: Array, rooms: Array, actions: Array, ground: Array, strides: Array) -> Array:
    """Return a circle around each action: all points (L, 9, 2) with their rooms, and the position. Shape (A + 1,)."""
    points = np.concatenate([points, np.zeros((len(points), 1, 2))], axis=1)
    rooms = np.append(rooms, CLEARANCE)[:, None]
    middles = ((points - rooms).min(axis=1) + (points + rooms).max(axis=1)) / 2
    radii = (np.linalg.norm(points - middles[:, None], axis=2) + rooms[:, 0]).max(axis=1)
    cos, sin = np.cos(ground["heading"]), np.sin(ground["heading"])
    x = ground["x"] + middles[:, 0] * cos + middles[:, 1] * sin
    z = ground["z"] - middles[:, 0] * sin + middles[:, 1] * cos
    # Between two frames a body is interpolated.
    steps = np.hypot(np.diff(ground["x"]), np.diff(ground["z"]))
    steps = np.append(steps + np.abs(np.diff(ground["heading"])) * np.linalg.norm(points, axis=2).max(axis=1)[:-1], 0.0)
    counts = actions["length"] * strides + 1
    firsts = np.cumsum(counts) - counts
    frames = np.arange(counts.sum()) + np.repeat(actions["origin"] - firsts, counts)
    x, z, radii, steps = x[frames], z[frames], radii[frames], steps[frames]
    steps[firsts + counts - 1] = 0.0

    def middle(at: Array) -> Array:
        return (np.minimum.reduceat(at - radii, firsts) + np.maximum.reduceat(at + radii, firsts)) / 2

    spans = np.empty(len(actions), SPAN)
    spans["x"], spans["z"] = middle(x), middle(z)
    away = np.hypot(x - np.repeat(spans["x"], counts), z - np.repeat(spans["z"], counts))
    spans["radius"] = np.maximum.reduceat(away + radii, firsts) + np.maximum.reduceat(steps, firsts) + _SPARE
    return spans

"""Obstacles as the player shows them: frames along their edges, which hide nobody behind them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.places.kernels.records import DISC, ROPES
from crowdsim.places.mesh import OBSTACLE_PAINTS

_EDGE, _ROPE, _POST = 0.025, 0.02, 0.05
"""Radius of edges, of ropes and of the posts between ropes [m]."""
_ROPES, _CORNERS = 3, 12
"""Ropes above one another, and corners of discs."""


def obstacle_frames(parts: Array) -> list[dict[str, Any]]:
    """Return obstacles as plain data for the player.

    Args:
        parts: Parts of obstacles, whose doors open by seconds (``places.arrays.pack_parts``). Shape (n,), ``PART``.

    Returns:
        For each part ``edges``, flat, of each both ends and the radius [m]; ``paint``, red, green, blue and gloss; and
        for a door between which times it is open [s], ``opens`` and ``closes``, None for never.
    """
    found = []
    for part in parts:
        times = (float(part["opens"]), float(part["closes"]))
        opens, closes = (round(time, 4) if math.isfinite(time) else None for time in times)
        edges = [round(float(value), 4) for value in _edges(part).ravel()]
        paint = [round(float(value), 4) for value in OBSTACLE_PAINTS[int(part["kind"])]]
        found.append({"edges": edges, "paint": paint, "opens": opens, "closes": closes})
    return found


def _edges(part: Array) -> Array:
    """Return the edges of a part: both ends and the radius. Shape (m, 7)."""
    along = np.array([part["ux"], part["uz"]])
    across = np.array([-part["uz"], part["ux"]])
    middle = np.array([part["x"], part["z"]])
    height, radius = float(part["height"]), float(part["radius"])
    if int(part["kind"]) == ROPES:
        ends = middle - part["half_along"] * along, middle + part["half_along"] * along
        levels = [height * (level + 1) / _ROPES for level in range(_ROPES)]
        lines = [_edge(*ends, level, level, _ROPE) for level in levels]
        return np.array([*lines, *(_edge(end, end, 0.0, height, _POST) for end in ends)])
    if int(part["kind"]) == DISC:
        turns = 2.0 * math.pi * np.arange(_CORNERS) / _CORNERS
        corners = middle + radius * np.stack([np.sin(turns), np.cos(turns)], axis=-1)
    else:
        signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
        reach = np.array([part["half_along"] + radius, part["half_across"] + radius])
        corners = middle + (signs * reach) @ np.array([along, across])
    after = np.roll(corners, -1, axis=0)
    posts = corners[:: max(1, len(corners) // 4)]
    rings = [_edge(a, b, level, level, _EDGE) for level in (0.0, height) for a, b in zip(corners, after, strict=True)]
    return np.array([*rings, *(_edge(corner, corner, 0.0, height, _EDGE) for corner in posts)])


def _edge(start: Array, end: Array, low: float, high: float, radius: float) -> Array:
    return np.array([start[0], low, start[1], end[0], high, end[1], radius])

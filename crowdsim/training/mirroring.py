"""Mirrored motion is solved once for both sides: for the captured states, whose mirror images are worth the same.

With s* the mirror image of the state s, and the environment mirrored at the plane straight ahead,

    V(s*, distance, -bearing, height) = V(s, distance, bearing, height)

since the graph is its own mirror image and rewards do not know left from right.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.environment import Axis, Grid
from crowdsim.training.ranges import resolve_grid
from crowdsim.training.recipe import BehaviourSpec, ValueIterationSpec

if TYPE_CHECKING:
    from crowdsim.graph.states import MotionGraph
    from crowdsim.motion.database import MotionDatabase


def solved_states(database: MotionDatabase, graph: MotionGraph, specs: Iterable[BehaviourSpec]) -> int:
    """Return how many states behaviours are solved for: the captured ones, or all.

    All are, where the motion is not mirrored, the graph is not its own mirror image or a grid is not, or Q-values are
    learned.
    """
    for spec in specs:
        over_v = isinstance(spec.solver, ValueIterationSpec) and spec.backup == "interpolation_of_max"
        if not over_v or mirrored_points(resolve_grid(spec, database)) is None:
            return graph.state_count
    return graph.captured_states(database.captured_frames)


def values_with_images(values: Array, grid: Grid) -> Array:
    """Return values of the captured states (S, C) and, after them, those of their mirror images. Shape (2 S, C)."""
    points = mirrored_points(grid)
    assert points is not None
    names = [axis.name for axis in grid.axes]
    if "bearing" not in names:
        return np.concatenate([values, values])
    table = values.reshape(len(values), *grid.shape)
    images = table.take(points, axis=1 + names.index("bearing"))
    return np.concatenate([values, images.reshape(values.shape)])


def mirrored_points(grid: Grid) -> Array | None:
    """Return the mirror image of each point of a grid's bearing, as a number; None where some have none."""
    axis = next((one for one in grid.axes if one.name == "bearing"), Axis("bearing", 0.0, 0.0, 1))
    gaps = axis.points + axis.points[:, None]
    if axis.wraps:
        gaps -= 2.0 * np.pi * np.round(gaps / (2.0 * np.pi))
    return np.abs(gaps).argmin(axis=1) if np.abs(gaps).min(axis=1).max() < 1e-6 else None

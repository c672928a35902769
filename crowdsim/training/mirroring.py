"""Mirrored motion is solved once for both sides: for the captured states, whose mirror images are worth the same.

With s* the mirror image of the state s, and the environment mirrored at the plane straight ahead,

    V(s*, distance, -bearing, height, -heading) = V(s, distance, bearing, height, heading)

since the graph is its own mirror image and rewards do not know left from right.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.axes.axis import Target
from crowdsim.policy.environment import UNSEEN, Axis, Grid
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
        if not over_v or not is_mirrored(resolve_grid(spec, database)):
            return graph.state_count
    return graph.captured_states(database.captured_frames)


def values_with_images(values: Array, grid: Grid) -> Array:
    """Return values of the captured states (S, C) and, after them, those of their mirror images. Shape (2 S, C)."""
    images = values.reshape(len(values), *grid.shape)
    for place, axis in enumerate(grid.axes, start=1):
        points = mirrored_points(axis)
        assert points is not None
        if not np.array_equal(points, np.arange(axis.count)):
            images = images.take(points, axis=place)
    return np.concatenate([values, images.reshape(values.shape)])


def is_mirrored(grid: Grid) -> bool:
    """Return whether a grid is its own mirror image."""
    return all(mirrored_points(axis) is not None for axis in grid.axes)


def mirrored_points(axis: Axis) -> Array | None:
    """Return the mirror image of each point of an axis, as a number; None where some have none."""
    here = axis.kind.place(Target(*(np.full(axis.count, number) for number in UNSEEN)), axis.points)
    seen = np.array([axis.kind.value(Target(*one)) for one in zip(*here.mirrored(), strict=True)])
    gaps = seen[:, None] - axis.points
    if axis.wraps:
        gaps -= axis.kind.period * np.round(gaps / axis.kind.period)
    return np.abs(gaps).argmin(axis=1) if np.abs(gaps).min(axis=1).max() < 1e-6 else None

"""Finer and coarser grids of the same environment, and values carried from one to another.

Values are found from coarse to fine: what a coarse grid has learned is where sweeps on the next one start (nested
iteration; Chow and Tsitsiklis, "An optimal one-way multigrid algorithm for discrete-time stochastic control", 1991).
And a table holds more when it is not read off at its grid points but fitted, by least squares, to values on a finer
grid: between the points the values of strikes have edges, and the fit spreads what it must get wrong evenly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.core.workers import share
from crowdsim.policy.environment import Axis, Grid, build_grid
from crowdsim.training.model import Model
from crowdsim.training.solution import Solution
from crowdsim.training.value_iteration import value_iteration

COARSEST = 10
"""Grids are coarsened while every axis over the ground keeps as many points."""

NEGLIGIBLE = 1e-6
"""Weights of a fit up to this are taken for 0."""

ROUGH = 10.0
"""How much further from settled values may be on grids that only lead to a finer one."""


def solve_by_levels(
    model_on: Callable[[Grid], Model],
    grid: Grid,
    finer: int = 1,
    tolerance: float = 1e-3,
    max_sweeps: int = 2000,
    progress: Progress | None = None,
) -> Solution:
    """Return the values of a behaviour on a grid, by value iteration from coarse grids to fine ones.

    Args:
        model_on: Builds the behaviour's model on a grid.
        grid: The grid of the table.
        finer: The last sweeps are done on a grid this many times finer over the ground, and the table is fitted to its
            values.
        tolerance: The sweeps on the finest grid end when no value changes by more than this.
        max_sweeps: Most sweeps on each grid.
        progress: Called with (stage, done, total).

    Returns:
        The solution; its residuals are those of all grids, one after the other. What was fitted is no longer a fixed
        point of the table's own sweep, so the last residual is that of the finest grid.
    """
    grids = coarser_grids(grid)
    if finer > 1:
        grids.append(refine(grid, finer))
    values: Array | None = None
    parts: list[Solution] = []
    for level, one in enumerate(grids):
        last = level == len(grids) - 1
        start = None if values is None else interpolate(values, grids[level - 1], one)
        goal = tolerance if last else tolerance * ROUGH
        parts.append(
            value_iteration(model_on(one), tolerance=goal, max_sweeps=max_sweeps, progress=progress, start=start)
        )
        values = parts[-1].values
    assert values is not None
    return replace(
        parts[-1],
        values=values if finer == 1 else fit(values, grids[-1], grid),
        sweeps=sum(part.sweeps for part in parts),
        updates=sum(part.updates for part in parts),
        residuals=tuple(residual for part in parts for residual in part.residuals),
        seconds=sum(part.seconds for part in parts),
    )


def refine(grid: Grid, times: int) -> Grid:
    """Return a grid with ``times`` as many steps over the ground; all points of the given one are in it."""
    moving = [_with_steps(axis, times * _steps(axis)) for axis in grid.ground_axes]
    return build_grid([*moving, *grid.axes[len(moving) :]])


def coarser_grids(grid: Grid) -> list[Grid]:
    """Return grids of half the steps over the ground, a quarter and so on, from the coarsest to the given one."""
    grids = [grid]
    while all(_steps(axis) // 2 >= COARSEST for axis in grids[0].ground_axes):
        moving = [_with_steps(axis, _steps(axis) // 2) for axis in grids[0].ground_axes]
        grids.insert(0, build_grid([*moving, *grid.axes[len(moving) :]]))
    return grids


def interpolate(values: Array, grid: Grid, other: Grid) -> Array:
    """Return values (S, cells) of a grid at the points of another one. Shape (S, cells of the other), float32."""
    return _along_axes(values, grid, [_weights(one, two) for one, two in zip(grid.axes, other.axes, strict=True)])


def fit(values: Array, finer: Grid, grid: Grid) -> Array:
    """Return the table on ``grid`` whose interpolation is nearest to values (S, cells) on a finer one.

    Least squares over the finer grid's points, axis by axis, which is the fit over all of them at once since weights
    are products over the axes. Shape (S, cells of ``grid``), float32.
    """
    operators = []
    for one, two in zip(grid.axes, finer.axes, strict=True):
        weights = _weights(one, two)
        operators.append(np.linalg.solve(weights.T @ weights, weights.T))
    return _along_axes(values, finer, operators)


def _steps(axis: Axis) -> int:
    return axis.count if axis.wraps else axis.count - 1


def _with_steps(axis: Axis, steps: int) -> Axis:
    """Return the axis over the same range in so many steps; one that has a single point stays."""
    if axis.count == 1:
        return axis
    return replace(axis, count=steps if axis.wraps else steps + 1)


def _weights(axis: Axis, other: Axis) -> Array:
    """Return the weight of each point of ``axis`` at each point of another one. Shape (other count, count)."""
    result = np.zeros((other.count, axis.count))
    rows = np.arange(other.count)
    place = axis.places(other.points)
    lower = np.clip(np.floor(place + 1e-9).astype(int), 0, axis.count - 1)
    upper = (lower + 1) % axis.count if axis.wraps else np.minimum(lower + 1, axis.count - 1)
    share = np.clip(place - lower, 0.0, 1.0)
    np.add.at(result, (rows, lower), 1.0 - share)
    np.add.at(result, (rows, upper), share)
    return result


def _along_axes(values: Array, grid: Grid, operators: list[Array]) -> Array:
    """Return values with a matrix applied along each axis of the grid."""
    from crowdsim.training.kernels.refinement import apply_along_axis

    shape = list(grid.shape)
    result = np.ascontiguousarray(values, dtype=np.float32).reshape(len(values), -1)
    for d, operator in enumerate(operators):
        if operator.shape[0] == operator.shape[1] and np.array_equal(operator, np.eye(len(operator))):
            continue
        before, after = int(np.prod(shape[:d])), int(np.prod(shape[d + 1 :]))
        out = np.empty((len(values), before, operator.shape[0], after), np.float32)
        rows, columns = np.nonzero(np.abs(operator) > NEGLIGIBLE)
        offsets = np.searchsorted(rows, np.arange(len(operator) + 1))
        weights = operator[rows, columns].astype(np.float32)
        rows_before = result.reshape(len(values), before, shape[d], after)
        share(len(values), apply_along_axis, offsets, columns, weights, rows_before, out)
        shape[d] = operator.shape[0]
        result = out.reshape(len(values), -1)
    return result

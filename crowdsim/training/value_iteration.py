"""Value iteration: sweeps of Bellman backups over the whole model until the values settle.

The backup ``interpolation_of_max`` works on V alone, ``max_of_interpolated`` on Q. A sweep over V goes through the
states in groups and keeps what it finds at once (Gauss-Seidel), from later states of the motion to earlier ones, since
values travel backwards. Over Q it is modified policy iteration: a sweep that looks for the best action is followed by
sweeps that only back up the best one, which are cheaper.
"""

from __future__ import annotations

import time

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.core.workers import share
from crowdsim.training.kernels.improvement import improve
from crowdsim.training.kernels.q_tables import improve_best_q, improve_q, put, values_from_q
from crowdsim.training.model import BACKUPS, Model
from crowdsim.training.solution import PUT, Solution, sweep_model, value_spread

GROUPS = 16
"""Groups of states that a sweep over V goes through: each reads the values of those before it."""

MOST_SHIFTS = 10
"""How often all values may be moved at once; a few times help, and at last plain sweeps must settle them."""


def value_iteration(
    model: Model,
    backup: str = "interpolation_of_max",
    tolerance: float = 1e-3,
    max_sweeps: int = 2000,
    evaluations: int = 10,
    progress: Progress | None = None,
    start: Array | None = None,
) -> Solution:
    """Return the values of a model, found by value iteration.

    Args:
        model: The model.
        backup: One of ``model.BACKUPS``.
        tolerance: The sweeps end when no value changes by more than this share of the spread of values.
        max_sweeps: They also end after this many.
        evaluations: Sweeps of policy evaluation after each sweep, with the backup ``max_of_interpolated``.
        progress: Called with ("value iteration", sweeps done, sweeps expected).
        start: Values to start from, for the backup ``interpolation_of_max``; by default 0; they are
            overwritten. Shape (S, C).

    Raises:
        ValueError: The backup has another name.
    """
    if backup not in BACKUPS:
        raise ValueError(f"backup is {backup!r}, expected one of {', '.join(BACKUPS)}")
    started = time.perf_counter()
    residuals: list[float] = []
    if backup == "interpolation_of_max":
        size = model.state_count * model.grid.cells
        first = np.zeros(size, np.float32) if start is None else np.ascontiguousarray(start, np.float32).ravel()
        values, updates = _iterate_v(model, tolerance, max_sweeps, first, residuals, progress)
        q = None
    else:
        values, q, updates = _iterate_q(model, tolerance, max_sweeps, evaluations, residuals, progress)
    return Solution(
        values=values.reshape(model.state_count, model.grid.cells),
        q=q,
        solver="value_iteration",
        backup=backup,
        sweeps=len(residuals),
        updates=updates,
        residuals=tuple(residuals),
        seconds=time.perf_counter() - started,
        converged=bool(residuals and residuals[-1] <= tolerance),
    )


def _report(progress: Progress | None, residuals: list[float], tolerance: float, limit: int) -> None:
    """Tell how far the sweeps are, judged by how fast the residual falls."""
    if progress is None:
        return
    expected = limit
    if len(residuals) > 2 and 0.0 < residuals[-1] < residuals[0]:
        rate = np.log(residuals[0] / residuals[-1]) / (len(residuals) - 1)
        expected = len(residuals) + max(0, int(np.log(max(residuals[-1] / tolerance, 1.0)) / rate))
    progress("value iteration", len(residuals), max(len(residuals), min(expected, limit)))


def _iterate_v(
    model: Model, tolerance: float, max_sweeps: int, values: Array, residuals: list[float], progress: Progress | None
) -> tuple[Array, int]:
    packed, layers, states = sweep_model(model), model.grid.layers, model.state_count
    groups = min(GROUPS, states)
    table = values.reshape(states, -1)
    found = np.empty((-(-states // groups), table.shape[1]), np.float32)
    changes = np.empty(states, np.float32)
    gains: list[float] = []
    some = values[:: max(1, len(values) // 1_000_000)]
    before, shifts = float(np.mean(some, dtype=np.float64)), 0
    while len(residuals) < max_sweeps:
        for first in reversed(range(groups)):
            rows = len(range(first, states, groups))
            share(rows, improve, packed, layers, values, first, groups, found, changes)
            table[first::groups] = found[:rows]
        residuals.append(float(changes.max()) / value_spread(values))
        _report(progress, residuals, tolerance, max_sweeps)
        if residuals[-1] <= tolerance:
            break
        mean = float(np.mean(some, dtype=np.float64))
        gains.append(mean - before)
        shift = _shift(gains) if shifts < MOST_SHIFTS else 0.0
        if shift:
            shifts += 1
            values += np.float32(shift)
            gains.clear()
        before = mean + shift
    return values, len(residuals) * model.action_count * model.grid.cells


def _shift(gains: list[float]) -> float:
    """Return by how much all values will still rise, judged by the last gains of their mean; 0 when that is not clear.

    What is slowest to settle is the part that all values share, because every state is reached from every other. Once
    its gains fall by a steady factor, their sum is known. The residual decides all the same.
    """
    if len(gains) < 3 or not gains[-2] or not gains[-3]:
        return 0.0
    factor, factor_before = gains[-1] / gains[-2], gains[-2] / gains[-3]
    steady = 0.0 < factor < 0.98 and abs(factor - factor_before) < 0.3 * (1.0 - factor)
    return gains[-1] * factor / (1.0 - factor) if steady else 0.0


def _iterate_q(
    model: Model, tolerance: float, max_sweeps: int, evaluations: int, residuals: list[float], progress: Progress | None
) -> tuple[Array, Array, int]:
    cells, layers = model.grid.cells, model.grid.layers
    packed = sweep_model(model)
    q, other = (np.zeros(model.action_count * cells, np.float32) for _ in range(2))
    changes = np.empty(model.state_count)
    entries = np.empty(model.state_count * cells, np.int64)
    values = np.empty(model.state_count * cells, np.float32)
    updates = 0
    while len(residuals) < max_sweeps:
        share(model.state_count, improve_q, packed, layers, q, other, changes)
        q, other = other, q
        residuals.append(float(changes.max()) / value_spread(q))
        updates += len(q)
        _report(progress, residuals, tolerance, max_sweeps)
        if residuals[-1] <= tolerance:
            break
        for _ in range(evaluations):
            share(model.state_count, improve_best_q, packed, layers, q, entries, values)
            share(len(values), put, q, entries, values, least=PUT)
            updates += len(values)
    share(model.state_count, values_from_q, model.offsets, cells, q, values)
    return values, q, updates

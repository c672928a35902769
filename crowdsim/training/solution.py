"""What a solver returns, and what both solvers take."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.training.model import Model


@dataclass(frozen=True)
class Solution:
    """Values that a solver has found.

    Attributes:
        values: V(s, c), what the best action of each state is worth in each cell. Shape (S, C).
        q: Q(a, c) flat as a Q-table lies (``policy.Behaviour``), where the solver worked with one, else None.
        solver: ``value_iteration`` or ``q_learning``.
        backup: One of ``model.BACKUPS``.
        sweeps: Times that every action of every state was backed up or tried in every cell.
        updates: Single backups or trials, those of policy evaluation included.
        residuals: By how much the values changed, a number for each sweep. Value iteration: the greatest change over
            ``value_spread``; its last is the Bellman residual. Q-learning: the mean size of the temporal-difference
            error.
        seconds: Time that the solver took [s], compilation left out as far as it lies in a cache.
        converged: Whether the last residual is within the tolerance.
    """

    values: Array
    q: Array | None
    solver: str
    backup: str
    sweeps: int
    updates: int
    residuals: tuple[float, ...]
    seconds: float
    converged: bool


def value_spread(values: Array) -> float:
    """Return the spread of values, from their 5th to their 95th percentile; a thousandth of their size at least."""
    some = values.ravel()[:: max(1, values.size // 100_000)]
    low, high = np.percentile(some, [5.0, 95.0])
    return max(float(high - low), 1e-3 * float(np.abs(some).max())) or 1.0


PUT = 4096
"""Entries of a Q-table that a thread writes at least."""


_ARRAYS = [field.name for field in fields(Model) if field.name not in ("grid", "discount")]
SweepModel = namedtuple("SweepModel", _ARRAYS)  # type: ignore[misc]
"""The arrays of a model, for compiled code."""


def sweep_model(model: Model) -> Any:
    """Return the model's arrays for compiled code."""
    return SweepModel(*(getattr(model, name) for name in _ARRAYS))


def q_table(model: Model, values: Array) -> Array:
    """Return Q(a, c) by one more backup of interpolated V, flat as a Q-table lies, in the type of ``values``."""
    from crowdsim.training.kernels.following import q_from_values

    q = np.empty(model.action_count * model.grid.cells, values.dtype)
    packed, flat = sweep_model(model), np.ascontiguousarray(values).ravel()
    share(model.state_count, q_from_values, packed, model.grid.layers, flat, q)
    return q

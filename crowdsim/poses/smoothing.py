"""Filters along the first axis of arrays; ends stand for what is beyond them."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array


def smooth(values: Array, weights: Array) -> Array:
    """Return weighted sums of rows (T, ...) and those around each, of the dtype of the rows.

    Args:
        values: The rows.
        weights: Weights of a row and of those before and after it, symmetric. Shape (2 k + 1,).
    """
    away, count = len(weights) // 2, len(values)
    padded = _padded(values, away).astype(float)
    found = padded[away : away + count] * weights[away]
    for k in range(away):
        found += (padded[k : k + count] + padded[2 * away - k : 2 * away - k + count]) * weights[k]
    return np.asarray(found.astype(values.dtype))


def highest(values: Array, away: int) -> Array:
    """Return the greatest of each row (T, ...) and of those up to so many before and after it."""
    padded, found = _padded(values, away), values
    for k in range(2 * away + 1):
        found = np.maximum(found, padded[k : k + len(values)])
    return np.asarray(found)


def widen(cells: Array, away: int) -> Array:
    """Return which cells (n, m) are no further than ``away`` rows and columns from one that is set."""
    found = cells
    for axis in (0, 1):
        wide = found.copy()
        for k in range(1, min(away, found.shape[axis] - 1) + 1):
            for one, other in ((slice(k, None), slice(None, -k)), (slice(None, -k), slice(k, None))):
                to, of = (tuple(part if own == axis else slice(None) for own in (0, 1)) for part in (one, other))
                wide[to] |= found[of]
        found = wide
    return found


def _padded(values: Array, away: int) -> Array:
    return np.concatenate([np.repeat(values[:1], away, axis=0), values, np.repeat(values[-1:], away, axis=0)])

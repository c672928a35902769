"""Moments that are alike in how the captured motion behind them moves.

Control prefers transitions where bodies move in certain ways, slowly say, so that motion alone tells transitions from
other decisions. Moments of both kinds that are matched by motion differ by the transition alone.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from crowdsim.core.types import Array

KEPT = 0.5
"""Share of the pairs that is kept, those most alike."""
_STILL = 0.05
"""Added to speeds before logarithms are taken [m/s]."""


def speeds_around(before: Array, after: Array, rate: float) -> Array:
    """Return how fast joints move before and after moments, as logarithms.

    Args:
        before: Positions of joints in the capture that moments leave, up to these [m]. Shape (n, T, J, 3).
        after: Those in the capture that they go on from, from there on. Shape (n, T, J, 3).
        rate: Frames a second.

    Returns:
        Shape (n, 2 J).
    """
    means = [np.linalg.norm(np.diff(side, axis=1), axis=-1).mean(axis=1) * rate for side in (before, after)]
    return np.log(np.concatenate(means, axis=1) + _STILL)


def match_moments(one: Array, other: Array) -> tuple[Array, Array]:
    """Return pairs of moments, each in at most one pair, that are most alike together; of these the better half.

    Args:
        one: Describes moments of one kind. Shape (n, D).
        other: Those of the other kind. Shape (m, D).

    Returns:
        Row of each pair in either. Shape (k,) each.
    """
    if min(len(one), len(other)) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    spread = np.maximum(other.std(axis=0), 1e-9)
    costs = cdist(one / spread, other / spread)
    rows, columns = linear_sum_assignment(costs)
    kept = np.sort(np.argsort(costs[rows, columns], kind="stable")[: int(np.ceil(KEPT * len(rows)))])
    return rows[kept], columns[kept]

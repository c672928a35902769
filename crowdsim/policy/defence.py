"""Defence: how many hits follow each action, by what its avatar sees coming at it.

A table, learned in fights (``sparring``), for strikes that an avatar cannot see yet; what is seen control evaluates
exactly (``crowd.kernels.defence``). The axes of its grid: when a strike in progress reaches furthest, whether above
the neck or below, and on which side; where none can be seen, how far away whoever may strike is.
"""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array

NAME = "defend"
"""What scenarios and recipes call this behaviour in their weights."""
SOON = (3.0, 6.0)
"""Where its axis of time is divided [control frames]."""
ASIDE = 0.06
"""How far to a side a strike ends that comes from there, on a body of scale 1 [m]."""
DISTANCES = (0.75, 0.95, 1.2)
"""Where its axis of distance is divided, on a body of scale 1 [m]."""
SIDES, HEIGHTS = 3, 2
SEEN_CELLS = (len(SOON) + 1) * HEIGHTS * SIDES
"""Cells of strikes in progress: by time, then height, then side (right, ahead, left)."""
CELLS = SEEN_CELLS + len(DISTANCES) + 1
"""All cells; behind those of strikes there is one for each distance."""


def join_defences(defences: list[Array | None], counts: list[int]) -> Array:
    """Return tables one after another, zeros for a policy without one; none at all where no policy has one.

    Args:
        defences: The table of each policy. Shapes (up to A, CELLS).
        counts: Actions of each policy, A.

    Returns:
        Shape (sum of A, CELLS) or (0, CELLS), float32.
    """
    if all(table is None for table in defences):
        return np.zeros((0, CELLS), np.float32)
    rows = np.zeros((sum(counts), CELLS), np.float32)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    for start, table in zip(starts, defences, strict=False):
        if table is not None:
            rows[start : start + len(table)] = table
    return rows

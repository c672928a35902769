"""Defence: how many hits follow each action where its avatar sees no strike coming yet.

A table, learned in fights (``self_play``), by the distance of attackers (``core.threats``). What is seen control
evaluates exactly (``crowd.kernels.terms.defence``).
"""

from __future__ import annotations

import numpy as np

from crowdsim.core.threats import CELLS
from crowdsim.core.types import Array

NAME = "defend"
"""What scenarios and recipes call this behaviour in their weights."""


def join_defences(defences: list[Array | None], counts: list[int]) -> Array:
    """Return tables (up to A, CELLS) one after another, zeros for a policy without one; none where no policy has one.

    ``counts`` are the actions of each policy, A. Shape (sum of A, CELLS) or (0, CELLS), float32.
    """
    if all(table is None for table in defences):
        return np.zeros((0, CELLS), np.float32)
    rows = np.zeros((sum(counts), CELLS), np.float32)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    for start, table in zip(starts, defences, strict=False):
        if table is not None:
            rows[start : start + len(table)] = table
    return rows

"""The Q-table of values V."""

import numpy as np
from numba import prange

from crowdsim.jit import kernel
from crowdsim.training.kernels.backup import back_up_action
from crowdsim.training.kernels.successors import empty_successors


@kernel(parallel=True)
def q_from_values(model, layers, values, out):
    """Write Q(a, c) of every action by interpolated V, in the layout of a Q-table."""
    cells = len(model.xs) * layers
    for i in prange(len(model.offsets) - 1):
        s = np.int64(i)
        row, found = np.empty(cells, np.float32), empty_successors(len(model.xs))
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for k in range(n):
            back_up_action(model, layers, values, np.int64(first + k), found, row)
            for c in range(cells):
                out[first * cells + c * n + k] = row[c]

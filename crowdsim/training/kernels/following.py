"""The Q-table of values V."""

import numpy as np

from crowdsim.jit import kernel
from crowdsim.training.kernels.backup import back_up_action
from crowdsim.training.kernels.successors import empty_successors


@kernel(allocates=True)
def q_from_values(low, high, model, layers, values, out):
    """Write Q(a, c) of every action of states ``low`` to ``high`` by interpolated V, in the layout of a Q-table."""
    cells = len(model.xs) * layers
    row, turned, found = np.empty(cells, np.float32), np.empty(cells, np.float32), empty_successors(len(model.xs))
    for s in range(low, high):
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for k in range(n):
            back_up_action(model, layers, values, first + k, found, turned, row)
            for c in range(cells):
                out[first * cells + c * n + k] = row[c]

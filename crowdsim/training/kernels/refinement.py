"""Values along one axis of a grid at the points of another."""

import numpy as np
from numba import prange

from crowdsim.jit import kernel


@kernel(parallel=True)
def apply_along_axis(operator, values, out):
    """Write a matrix (n, m) times values (S, before, m, after), along their third axis, to ``out``."""
    for s in prange(len(values)):
        row = np.empty(values.shape[3])
        for b in range(values.shape[1]):
            for i in range(operator.shape[0]):
                row[:] = 0.0
                for j in range(operator.shape[1]):
                    weight = operator[i, j]
                    if abs(weight) > 1e-6:
                        for h in range(len(row)):
                            row[h] += weight * values[s, b, j, h]
                for h in range(len(row)):
                    out[s, b, i, h] = row[h]

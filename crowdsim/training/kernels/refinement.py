"""Values along one axis of a grid at the points of another."""

import numpy as np

from crowdsim.jit import kernel


@kernel
def apply_along_axis(low, high, offsets, columns, weights, values, out):
    """Write a sparse matrix (n, m) times values (S, before, m, after), along their third axis, to ``out``.

    Args:
        low: First row of ``values``.
        high: One past the last.
        offsets: CSR: entries of row i are ``offsets[i]:offsets[i + 1]``. Shape (n + 1,).
        columns: Column of each entry.
        weights: The entries, float32.
        values: What is multiplied, float32.
        out: Written: the product. Shape (S, before, n, after), float32.
    """
    for s in range(low, high):
        for b in range(values.shape[1]):
            for i in range(out.shape[2]):
                to = out[s, b, i]
                to[:] = np.float32(0.0)
                for entry in range(offsets[i], offsets[i + 1]):
                    weight, row = weights[entry], values[s, b, columns[entry]]
                    for h in range(len(to)):
                        to[h] += weight * row[h]

"""Compiled smooth interpolation of what is known at control frames."""

import math

from crowdsim.jit import kernel


@kernel(allocates=False)
def spline_at(values, rows, time, n):
    """Return the two numbers of an avatar at a time: a cubic B-spline over control frames, whose ends repeat.

    Args:
        values: Two numbers for each of the rows and avatars. Shape (R, n, 2).
        rows: The control frames, a ``Rows``.
        time: The time [s].
        n: Column of the avatar.
    """
    clock = time * rows.rate - rows.first
    before, last = math.floor(clock), values.shape[0] - 1
    u = clock - before
    v = 1.0 - u
    first, second, fourth = v * v * v / 6.0, (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0, u * u * u / 6.0
    weights = first, second, 1.0 - first - second - fourth, fourth
    x = z = 0.0
    for k in range(4):
        row = min(max(before - 1 + k, 0), last)
        x += weights[k] * values[row, n, 0]
        z += weights[k] * values[row, n, 1]
    return x, z

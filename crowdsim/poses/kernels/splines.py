"""Compiled smooth interpolation of what is known at control frames."""

import math

from crowdsim.jit import kernel


@kernel
def spline_weights(u):
    """Return the weights of four values in a cubic B-spline, at a share of the way from the second to the third."""
    v = 1.0 - u
    first, second, fourth = v * v * v / 6.0, (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0, u * u * u / 6.0
    return first, second, 1.0 - first - second - fourth, fourth


@kernel
def spline_of(offsets, time, n):
    """Return the number of an avatar at a time: a cubic B-spline over frames, whose ends repeat.

    Args:
        offsets: ``Offsets`` with values of shape (R, n).
        time: The time [s].
        n: Column of the avatar.
    """
    clock = time * offsets.rate - offsets.first
    before, last = math.floor(clock), offsets.values.shape[0] - 1
    weights = spline_weights(clock - before)
    value = 0.0
    for k in range(4):
        value += weights[k] * offsets.values[min(max(before - 1 + k, 0), last), n]
    return value


@kernel
def spline_at(offsets, time, n):
    """Return two numbers of an avatar at a time, of values (R, n, 2); see ``spline_of``."""
    clock = time * offsets.rate - offsets.first
    before, last = math.floor(clock), offsets.values.shape[0] - 1
    weights = spline_weights(clock - before)
    x = z = 0.0
    for k in range(4):
        row = min(max(before - 1 + k, 0), last)
        x += weights[k] * offsets.values[row, n, 0]
        z += weights[k] * offsets.values[row, n, 1]
    return x, z

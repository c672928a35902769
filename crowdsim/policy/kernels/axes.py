"""Compiled axes of a grid: what they measure of a target, its cells and their weights, and the fade (``Grid.pack``)."""

import math
from typing import Any, NamedTuple

from crowdsim.core.tables import locate_on_axis, split_weights
from crowdsim.jit import kernel

# Columns of the axes.
KIND, FIRST, STEP, POINTS, WRAPS, STRIDE, FADE, MINIMUM, RATE = range(9)
DISTANCE, BEARING = range(2)  # kinds; any other is the height


class Corners(NamedTuple):
    """Scratch space for the cells around a target.

    Attributes:
        cells: Cells. Shape (2^D,) for the largest number of axes D, int64.
        weights: Their weights. The same shape, float64.
    """

    cells: Any
    weights: Any


@kernel(allocates=False)
def measure(kind, x, y, z):
    """Return what an axis of this kind measures of a target (``environment.measure``).

    ``environment.COMPILED`` lists the axes that have a branch here.
    """
    if kind == DISTANCE:
        return math.sqrt(x * x + z * z)
    if kind == BEARING:
        return math.atan2(x, z)
    return y


@kernel(allocates=False)
def find_on_axis(axes, row, x, y, z):
    """Return the grid point below a target on one axis, the one above, the share of the latter, and the fade."""
    first, step, points = axes[row, FIRST], axes[row, STEP], int(axes[row, POINTS])
    value = measure(int(axes[row, KIND]), x, y, z)
    position = (value / (1.0 + axes[row, RATE] * value) - first) / step
    if axes[row, WRAPS] != 0.0:
        lower, upper, share = locate_on_axis(position, points, True)
        return lower, upper, share, 1.0
    fade = 1.0
    if axes[row, FADE] > 0.0:
        last = first + (points - 1.0) * step
        beyond = max(axes[row, MINIMUM] - value, value - last / (1.0 - axes[row, RATE] * last), 0.0)
        fade = max(0.0, 1.0 - beyond / axes[row, FADE])
    lower, upper, share = locate_on_axis(position, points, False)
    return lower, upper, share, fade


@kernel(allocates=False)
def find_corners(axes, first, end, x, y, z, corners):
    """Write the cells around a target on the axes ``first`` to ``end`` and their weights; return how many there are."""
    cells, weights = corners.cells, corners.weights
    count = 1
    cells[0] = 0
    weights[0] = 1.0
    for row in range(first, end):
        lower, upper, share, _ = find_on_axis(axes, row, x, y, z)
        stride = int(axes[row, STRIDE])
        for corner in range(count):
            cells[count + corner] = cells[corner] + upper * stride
            cells[corner] += lower * stride
        split_weights(weights, count, share, 1.0 - share)
        count *= 2
    return count


@kernel(allocates=False)
def fade_on_axes(axes, first, end, x, y, z):
    """Return how much a behaviour counts for a target (``environment.fade_factor``)."""
    fade = 1.0
    for row in range(first, end):
        fade *= find_on_axis(axes, row, x, y, z)[3]
    return fade

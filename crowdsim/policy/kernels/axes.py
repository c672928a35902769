"""Compiled axes of a grid: what they measure of a target, its cells and their weights, and the fade (``Grid.pack``).

``axes`` are records (``records.AXIS``), ``target`` is a ``Target``.
"""

from typing import Any, NamedTuple

from crowdsim.core.tables import locate_on_axis, split_weights
from crowdsim.jit import kernel
from crowdsim.policy.axes.registry import measure


class Corners(NamedTuple):
    """Scratch space for the cells around a target.

    Attributes:
        cells: Cells. Shape (2^D,) for the largest number of axes D, int64.
        weights: Their weights. The same shape, float64.
    """

    cells: Any
    weights: Any


@kernel(allocates=False)
def find_corners(axes, first, end, target, corners):
    """Write the cells around a target on the axes ``first`` to ``end`` and their weights; return how many there are."""
    cells, weights = corners.cells, corners.weights
    count = 1
    cells[0] = 0
    weights[0] = 1.0
    for row in range(first, end):
        axis = axes[row]
        value = measure(axis.kind, target)
        position = (value / (1.0 + axis.rate * value) - axis.first) / axis.step
        lower, upper, share = locate_on_axis(position, axis.count, axis.wraps)
        for corner in range(count):
            cells[count + corner] = cells[corner] + upper * axis.stride
            cells[corner] += lower * axis.stride
        split_weights(weights, count, share, 1.0 - share)
        count *= 2
    return count


@kernel(allocates=False)
def fade_on_axes(axes, first, end, target):
    """Return how much a behaviour counts for a target (``environment.fade_factor``)."""
    fade = 1.0
    for row in range(first, end):
        axis = axes[row]
        if axis.fade > 0.0 and not axis.wraps:
            value = measure(axis.kind, target)
            beyond = max(axis.minimum - value, value - axis.maximum, 0.0)
            fade *= max(0.0, 1.0 - beyond / axis.fade)
    return fade

"""Compiled axes of a grid: what they measure of a target, its cells and their weights, and the fade (``Grid.pack``).

``axes`` are records (``records.AXIS``), ``target`` is a ``Target``.
"""

from typing import Any, NamedTuple

from crowdsim.core.tables import locate_on_axis, split_weights
from crowdsim.jit import kernel
from crowdsim.policy.axes.registry import GROUND, after, measure


class Corners(NamedTuple):
    """Scratch space for the cells around a target.

    Attributes:
        cells: Cells. Shape (2^D,) for the largest number of axes D, int64.
        weights: Their weights. The same shape, float64.
    """

    cells: Any
    weights: Any


@kernel
def find_corners(axes, first, end, target, corners):
    """Write the cells around a target on the axes ``first`` to ``end`` and their weights; return how many there are."""
    count = _begin(corners)
    for row in range(first, end):
        count = _add_axis(axes[row], measure(axes[row].kind, target), corners, count)
    return count


@kernel
def find_corners_after(axes, first, end, before, later, action_end, corners):
    """Do what ``find_corners`` does for a target as it is seen after an action.

    Args:
        axes: Records (``records.AXIS``).
        first: The first of them.
        end: One past the last.
        before: The target as it is seen before the action.
        later: Where it is seen afterwards.
        action_end: What changes meanwhile (``axis.End``).
        corners: Written.
    """
    count = _begin(corners)
    for row in range(first, end):
        kind = axes[row].kind
        value = measure(kind, later) if kind < GROUND else after(kind, measure(kind, before), action_end)
        count = _add_axis(axes[row], value, corners, count)
    return count


@kernel
def find_layers_after(axes, values, action_end, corners):
    """Write the layers of a grid around what its axes measure after an action; return how many there are.

    ``values`` (D,) is what they measure before; none of the axes is over the ground.
    """
    count = _begin(corners)
    for row in range(len(axes)):
        count = _add_axis(axes[row], after(axes[row].kind, values[row], action_end), corners, count)
    return count


@kernel(inline=True)
def _begin(corners):
    """Begin with one cell, the first one of a grid without axes."""
    corners.cells[0] = 0
    corners.weights[0] = 1.0
    return 1


@kernel(inline=True)
def _add_axis(axis, value, corners, count):
    """Split each of ``count`` cells among its neighbours along one more axis; return how many there are then."""
    cells = corners.cells
    position = (value / (1.0 + axis.rate * value) - axis.first) / axis.step
    lower, upper, share = locate_on_axis(position, axis.count, axis.wraps)
    for corner in range(count):
        cells[count + corner] = cells[corner] + upper * axis.stride
        cells[corner] += lower * axis.stride
    split_weights(corners.weights, count, share, 1.0 - share)
    return 2 * count


@kernel
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

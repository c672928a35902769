"""Cells of a table: where a value lies on an axis, the weights of the cells around it, and interpolation."""

import math

from crowdsim.jit import kernel


@kernel(inline=True)
def locate_on_axis(position, points, wraps):
    """Return the grid point below a position, the one above it, and the share of the latter.

    Args:
        position: Position in grid points from the first one; clamped to the axis, or wrapped.
        points: Number of grid points, an integer; 2 or more where the axis wraps.
        wraps: Whether the first point follows the last.
    """
    if wraps:
        position -= points * math.floor(position / points)
        lower = min(int(position), points - 1)
        upper = lower + 1 if lower + 1 < points else 0
    else:
        position = min(max(position, 0.0), points - 1.0)
        lower = max(min(int(position), points - 2), 0)
        upper = min(lower + 1, points - 1)
    return lower, upper, position - lower


@kernel(inline=True)
def split_weights(weights, count, share, rest):
    """Divide the weights of ``count`` corners between those below and those above a position on a further axis.

    Args:
        weights: The corners below keep their entries; those above get the next ``count``.
        count: Number of corners so far.
        share: Share of the corners above.
        rest: 1 less the share, in the type of the weights.
    """
    for corner in range(count):
        weights[count + corner] = weights[corner] * share
        weights[corner] *= rest


@kernel(inline=True)
def interpolate(table, first, cells, weights, count):
    """Return the weighted sum of ``count`` entries of a table; ``cells`` count from the entry ``first``."""
    value = 0.0
    for corner in range(count):
        value += weights[corner] * table[first + cells[corner]]
    return value

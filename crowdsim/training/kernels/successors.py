"""Where a target is seen after an action (``model.Model``): found where it is used, which costs less than keeping it.

Single precision throughout, in loops without calls or branches, which vectorise.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel

# Rows and columns of ``Model.axes``.
DISTANCE, BEARING = range(2)
FIRST, PER_STEP, COUNT, RATE, WRAPS, STRIDE = range(6)
# Columns of ``Model.ends``.
LEFT, AHEAD, COS, SIN, SIDE = range(5)


class Successors(NamedTuple):
    """Where the targets of M moving cells are seen after an action; scratch space.

    Attributes:
        lowers: Cell of a table at the lower corner on both axes. Shape (M,), int32.
        steps: Cells from there to the corner with the next bearing. Shape (M,), int32.
        far: Share of the next distance. Shape (M,), float32.
        around: Share of the next bearing. Shape (M,), float32.
    """

    lowers: Any
    steps: Any
    far: Any
    around: Any


@kernel
def empty_successors(count):
    """Return scratch space for some moving cells."""
    return Successors(
        np.empty(count, np.int32), np.empty(count, np.int32), np.empty(count, np.float32), np.empty(count, np.float32)
    )


@kernel(inline=True)
def bearing_of(x, z):
    """Return atan2(x, z), with an error below 3e-6 (Hastings, "Approximations for digital computers", 1955)."""
    aside, along = abs(x), abs(z)
    ratio = min(aside, along) / max(max(aside, along), np.float32(1e-30))
    square = ratio * ratio
    angle = np.float32(-0.01172120) * square + np.float32(0.05265332)
    angle = angle * square + np.float32(-0.11643287)
    angle = angle * square + np.float32(0.19354346)
    angle = angle * square + np.float32(-0.33262347)
    angle = (angle * square + np.float32(0.99997726)) * ratio
    angle = np.float32(math.pi / 2) - angle if aside > along else angle
    angle = np.float32(math.pi) - angle if z < np.float32(0.0) else angle
    return -angle if x < np.float32(0.0) else angle


@kernel(allocates=False)
def find_successors(axes, end, xs, zs, found):
    """Write where targets over (xs, zs) are seen from the end of an action to ``found`` (``Successors``).

    Args:
        axes: ``Model.axes``.
        end: The action's row of ``Model.ends``.
        xs: Where the targets are, to the left [m]. Shape (M,), float32.
        zs: Ahead.
        found: Written.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    left, ahead, cos, sin, side = end[LEFT], end[AHEAD], end[COS], end[SIN], end[SIDE]
    nearest, rate, rings = axes[DISTANCE, FIRST], axes[DISTANCE, RATE], axes[DISTANCE, PER_STEP]
    farthest = axes[DISTANCE, COUNT] - one
    least, sectors, count = axes[BEARING, FIRST], axes[BEARING, PER_STEP], axes[BEARING, COUNT]
    across, along = axes[DISTANCE, STRIDE], axes[BEARING, STRIDE]
    wraps = axes[BEARING, WRAPS] != zero
    last = count - one
    period, limit = (count, count) if wraps else (zero, last)
    below, before = max(farthest - one, zero), last if wraps else max(last - one, zero)
    for i in range(len(xs)):
        m = np.uint64(i)
        dx, dz = xs[m] + left, zs[m] + ahead
        x, z = side * (dx * cos - dz * sin), dx * sin + dz * cos
        distance = np.float32(math.sqrt(x * x + z * z))
        place = min(max((distance / (one + rate * distance) - nearest) * rings, zero), farthest)
        ring = np.float32(np.int32(min(place, below)))
        found.far[m] = place - ring
        place = (bearing_of(x, z) - least) * sectors
        place = place + period if place < zero else place
        place = place - period if place > limit else place
        place = min(max(place, zero), limit)
        sector = np.float32(np.int32(min(place, before)))
        found.around[m] = place - sector
        found.lowers[m] = np.int32(ring * across + sector * along)
        found.steps[m] = np.int32(along if sector < last else along - along * count)


@kernel(inline=True)
def corners_of(found, m, across):
    """Return the four cells around a successor: with the lower or upper distance, for the lower, then upper bearing."""
    lower = np.int64(found.lowers[m])
    upper = lower + np.int64(found.steps[m])
    return np.uint64(lower), np.uint64(lower + across), np.uint64(upper), np.uint64(upper + across)


@kernel(inline=True)
def weights_of(found, m, total):
    """Return the weights of the corners (``corners_of``), which add up to ``total``."""
    far, around = total * found.far[m], total * found.around[m]
    both = far * found.around[m]
    return total - far - around + both, far - both, around - both, both


@kernel(allocates=False)
def find_successor(model, outcome, action, m, found):
    """Write where the target of one moving cell is seen after an action as the only entry of ``found``."""
    find_successors(model.axes, model.ends[outcome, action], model.xs[m : m + 1], model.zs[m : m + 1], found)


@kernel
def list_corners(axes, ends, xs, zs, cells, weights):
    """Write the corners around the successors of targets over (xs, zs), and their weights.

    Args:
        axes: ``Model.axes``.
        ends: ``Model.ends``. Shape (O, A, 5).
        xs: Where the targets are, to the left [m]. Shape (M,), float32.
        zs: Ahead.
        cells: Written: cells of a table, in its first layer. Shape (O, A, M, 4).
        weights: Written: their weights, which add up to 1. Shape (O, A, M, 4).
    """
    across, one, found = np.int64(axes[DISTANCE, STRIDE]), np.float32(1.0), empty_successors(len(xs))
    for outcome in range(ends.shape[0]):
        for action in range(ends.shape[1]):
            find_successors(axes, ends[outcome, action], xs, zs, found)
            for m in range(len(xs)):
                row, shares = cells[outcome, action, m], weights[outcome, action, m]
                row[0], row[1], row[2], row[3] = corners_of(found, m, across)
                shares[0], shares[1], shares[2], shares[3] = weights_of(found, m, one)

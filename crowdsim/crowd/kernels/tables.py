"""Cells of a behaviour's grid, and what its table holds between them."""

import math
from typing import NamedTuple

import numpy as np

from crowdsim.core.mathematics import whole_below
from crowdsim.crowd.kernels.layout import BEARING, DISTANCE, LANES, WORK_BEARING, WORK_DISTANCE
from crowdsim.jit import kernel


class Cell(NamedTuple):
    """An entry of a table, steps from there to the next along distance, bearing and height, and their shares."""

    at: int
    near: int
    aside: int
    above: int
    near_share: float
    aside_share: float
    above_share: float


@kernel(inline=True)
def whole_lanes(count):
    """Return a number rounded up to a multiple of ``LANES``, so that vector loops have no scalar remainder."""
    return (count + LANES - 1) // LANES * LANES


@kernel(inline=True)
def fade(axis, value):
    """Return how much a behaviour counts for a value on an axis: 1 inside its range, falling to 0 beyond it."""
    beyond = max(axis.least - value, value - axis.greatest, 0.0)
    return max(0.0, 1.0 - beyond / axis.fade)


@kernel(inline=True)
def locate(axis, value):
    """Return the cell below a value on one axis of a grid, the step to the next one in a table, and its share."""
    place = (value / (1.0 + axis.rate * value) - axis.first) * axis.per_unit
    points, stride = axis.points, axis.apart
    step = stride if points > 1.0 else 0.0
    if axis.wraps != 0.0:
        place -= points * math.floor(place / points)
        lower = min(math.floor(place), points - 1.0)
        step = step if lower + 1.0 < points else stride * (1.0 - points)
    else:
        place = min(max(place, 0.0), points - 1.0)
        lower = min(math.floor(place), max(points - 2.0, 0.0))
    return int(lower * stride), int(step), place - lower


@kernel(inline=True)
def locate_ends(grids, b, cell_count, count, cells, steps, work, near_shares, aside_shares):
    """Locate each end on the grid of a behaviour, whose table begins at its state's first cell.

    ``work`` holds distances and bearings; ``cells`` are states and become entries; ``steps`` go to the next bearing.
    """
    distance, bearing = grids[b, DISTANCE], grids[b, BEARING]
    near_least, near_per, near_points = distance.first, distance.per_unit, distance.points
    aside_least, aside_per, aside_points = bearing.first, bearing.per_unit, bearing.points
    rate, near_apart, aside_apart = distance.rate, distance.apart, bearing.apart
    near_last, aside_last = max(near_points - 2.0, 0.0), max(aside_points - 2.0, 0.0)
    wraps = bearing.wraps != 0.0
    once = 1.0 / aside_points if wraps else 0.0
    step = aside_apart if aside_points > 1.0 else 0.0
    back = aside_apart - aside_apart * aside_points if wraps else step
    aside_last = aside_points - 1.0 if wraps else aside_last
    most = np.inf if wraps else aside_points - 1.0
    least = -np.inf if wraps else 0.0
    for k in range(count):
        place = (work[WORK_DISTANCE, k] / (1.0 + rate * work[WORK_DISTANCE, k]) - near_least) * near_per
        place = min(max(place, 0.0), near_points - 1.0)
        lower = min(whole_below(place), near_last)
        near_shares[k] = place - lower
        cell = cells[k] * cell_count + lower * near_apart
        place = min(max((work[WORK_BEARING, k] - aside_least) * aside_per, least), most)
        place -= aside_points * whole_below(place * once)
        lower = max(min(whole_below(place), aside_last), 0.0)
        aside_shares[k] = place - lower
        cells[k] = cell + lower * aside_apart
        steps[k] = step if lower + 1.0 < aside_points else back


@kernel(inline=True)
def interpolate(table, cell):
    """Return the entry of a table between the eight corners of a cell."""
    low = np.uint64(cell.at)
    high = np.uint64(cell.at + cell.near)
    left = np.uint64(cell.at + cell.aside)
    both = np.uint64(cell.at + cell.near + cell.aside)
    part, turned = cell.near_share, cell.aside_share
    value = (1.0 - part) * ((1.0 - turned) * table[low] + turned * table[left])
    value += part * ((1.0 - turned) * table[high] + turned * table[both])
    if cell.above == 0:
        return value
    up = np.uint64(cell.above)
    upper = (1.0 - part) * ((1.0 - turned) * table[low + up] + turned * table[left + up])
    upper += part * ((1.0 - turned) * table[high + up] + turned * table[both + up])
    return value + cell.above_share * (upper - value)


@kernel(inline=True)
def add_rows(table, cell, factor, n, out):
    """Add to ``out`` what lies between the eight rows of a cell, ``n`` entries each, times ``factor``."""
    part, turned, raised, above = cell.near_share, cell.aside_share, cell.above_share, cell.above
    c, d, e = factor * (1.0 - part), factor * part, 1.0 - turned
    f, g = 1.0 - raised, raised
    if above == 0:
        f, g = 1.0, 0.0
    w0, w1, w2, w3 = c * e * f, c * turned * f, d * e * f, d * turned * f
    w4, w5, w6, w7 = c * e * g, c * turned * g, d * e * g, d * turned * g
    last = table.shape[0] - LANES
    a0, a1, a2, a3 = cell.at, cell.at + cell.aside, cell.at + cell.near, cell.at + cell.near + cell.aside
    ends = max(max(a0, a1), max(a2, a3)) + above
    for begin in range(0, n, LANES):
        # Whole lanes are read, also beyond the last action, where there is more of the table.
        if ends + begin <= last:
            i0, i1, i2, i3 = np.uint64(a0 + begin), np.uint64(a1 + begin), np.uint64(a2 + begin), np.uint64(a3 + begin)
            up, o = np.uint64(above), np.uint64(begin)
            if above == 0:
                for k in range(np.uint64(LANES)):
                    out[o + k] += w0 * table[i0 + k] + w1 * table[i1 + k] + w2 * table[i2 + k] + w3 * table[i3 + k]
            else:
                i4, i5, i6, i7 = i0 + up, i1 + up, i2 + up, i3 + up
                for k in range(np.uint64(LANES)):
                    out[o + k] += (
                        w0 * table[i0 + k] + w1 * table[i1 + k] + w2 * table[i2 + k] + w3 * table[i3 + k]
                    ) + (w4 * table[i4 + k] + w5 * table[i5 + k] + w6 * table[i6 + k] + w7 * table[i7 + k])
        else:
            for k in range(begin, min(begin + LANES, n)):
                out[k] += (w0 * table[a0 + k] + w1 * table[a1 + k] + w2 * table[a2 + k] + w3 * table[a3 + k]) + (
                    w4 * table[a0 + above + k] + w5 * table[a1 + above + k] + w6 * table[a2 + above + k]
                    + w7 * table[a3 + above + k]
                )  # fmt: skip

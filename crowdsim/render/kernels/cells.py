"""Compiled sorting of thick flat segments into the cells of a grid, as CSR lists.

The same two kernels serve the tiles of the screen, the grid of shadows and the grid of contacts with the floor. A
segment runs from (ax, ay) to (bx, by) with radii ra and rb, all in cells; a negative ra leaves it out.
"""

import math

from crowdsim.jit import kernel

HALF_DIAGONAL = 0.7072


@kernel
def _span(segment, columns, rows):
    """Return the first and last column and row that a segment may touch; the last is below the first outside."""
    ax, ay, bx, by, ra, rb = segment.ax, segment.ay, segment.bx, segment.by, segment.a_radius, segment.b_radius
    left, right = min(ax - ra, bx - rb), max(ax + ra, bx + rb)
    top, bottom = min(ay - ra, by - rb), max(ay + ra, by + rb)
    if not (ra >= 0.0 and right >= 0.0 and bottom >= 0.0 and left < columns and top < rows):
        return 0, -1, 0, -1
    return (
        int(max(math.floor(left), 0.0)),
        int(min(math.floor(right), columns - 1.0)),
        int(max(math.floor(top), 0.0)),
        int(min(math.floor(bottom), rows - 1.0)),
    )


@kernel
def _touches(segment, column, row):
    """Whether a segment comes within half a cell's diagonal of its middle, so that it may touch the cell."""
    ax, ay, ra = segment.ax, segment.ay, segment.a_radius
    bx, by = segment.bx - ax, segment.by - ay
    px, py = column + 0.5 - ax, row + 0.5 - ay
    s = min(max((px * bx + py * by) / max(bx * bx + by * by, 1e-12), 0.0), 1.0)
    dx, dy = px - s * bx, py - s * by
    reach = max(ra, segment.b_radius) + HALF_DIAGONAL
    return dx * dx + dy * dy <= reach * reach


@kernel
def count_entries(segments, columns, rows, offsets):
    """Count the segments of each cell and write the CSR ``offsets``, shape (columns * rows + 1,), int32."""
    for cell in range(offsets.shape[0]):
        offsets[cell] = 0
    for index in range(segments.shape[0]):
        segment = segments[index]
        first, last, top, bottom = _span(segment, columns, rows)
        for row in range(top, bottom + 1):
            for column in range(first, last + 1):
                if _touches(segment, column, row):
                    offsets[row * columns + column + 1] += 1
    for cell in range(1, offsets.shape[0]):
        offsets[cell] += offsets[cell - 1]


@kernel
def fill_entries(segments, columns, rows, offsets, entries):
    """Write the segments of each cell, ascending, into ``entries``; ``offsets`` comes back as it was."""
    for index in range(segments.shape[0]):
        segment = segments[index]
        first, last, top, bottom = _span(segment, columns, rows)
        for row in range(top, bottom + 1):
            for column in range(first, last + 1):
                if _touches(segment, column, row):
                    cell = row * columns + column
                    entries[offsets[cell]] = index
                    offsets[cell] += 1
    for cell in range(offsets.shape[0] - 1, 0, -1):
        offsets[cell] = offsets[cell - 1]
    offsets[0] = 0

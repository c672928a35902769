"""The shortest way around obstacles: over corners, by a graph of those that see one another."""

import math

import numpy as np

from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import ANY_HEIGHT, is_way_free

CORNERS = 16  # most corners that a cell lists, the nearest ones that are seen from it
PASSING = 0.25  # room that ways keep from obstacles [m]
BODY = 0.2  # room that a body needs to walk straight to a point [m]
REACHED = 0.3  # how near a corner has been reached [m]


@kernel
def phase_of(places, frame):
    """Return which doors are open in a control frame: a row of the graph."""
    phase = 0
    for k in range(1, places.phases.shape[0]):
        phase += places.phases[k] <= frame
    return phase


@kernel(inline=True)
def _cell_near(grid, x, z):
    """Return the cell of a grid that is nearest to a point."""
    column = min(max(math.floor((x - grid.x) / grid.size), 0.0), grid.columns - 1.0)
    row = min(max(math.floor((z - grid.z) / grid.size), 0.0), grid.rows - 1.0)
    return int(row) * int(grid.columns) + int(column)


@kernel
def first_corner(places, frame, x, z, to_x, to_z):
    """Return the corner over which the shortest way from one point to another leads first, and that way's length [m].

    The corner is -1 where no way is known.
    """
    phase = phase_of(places, frame)
    corners, apart, seen = places.corners, places.apart[phase], places.seen[phase]
    here = seen[_cell_near(places.ways_grid, x, z)]
    there = seen[_cell_near(places.ways_grid, to_x, to_z)]
    # Corners that are seen from a cell need not be from a point in it: the best way is taken that holds.
    left_here, left_there = _all_of(here), _all_of(there)
    while True:
        m, n, best = -1, -1, math.inf
        for i in range(CORNERS):
            if left_here >> i & 1:
                first = _apart(corners, here[i], x, z)
                if first + _apart(corners, here[i], to_x, to_z) >= best:
                    continue
                for j in range(CORNERS):
                    if left_there >> j & 1 and first + apart[there[j], here[i]] < best:
                        length = first + apart[there[j], here[i]] + _apart(corners, there[j], to_x, to_z)
                        if length < best:
                            m, n, best = i, j, length
        if m < 0:
            return np.int64(-1), math.inf
        v, w = here[m], there[n]
        is_ahead = _apart(corners, v, x, z) >= REACHED
        if not (is_ahead and is_way_free(places, frame, x, z, corners[v, 0], corners[v, 1], BODY, ANY_HEIGHT)):
            left_here ^= 1 << m
        elif not is_way_free(places, frame, corners[w, 0], corners[w, 1], to_x, to_z, 0.0, ANY_HEIGHT):
            left_there ^= 1 << n
        else:
            return np.int64(v), best


@kernel(inline=True)
def _all_of(listed):
    """Return the corners that a cell lists as bits."""
    bits = 0
    for k in range(CORNERS):
        bits |= (listed[k] >= 0) << k
    return bits


@kernel(inline=True)
def _apart(corners, v, x, z):
    """Return how far a corner is from a point [m]."""
    dx, dz = corners[v, 0] - x, corners[v, 1] - z
    return math.sqrt(dx * dx + dz * dz)


@kernel
def link_corners(places, frame, out):
    """Write the distance of each two corners that see one another in a control frame, else infinity. Shape (V, V)."""
    corners = places.corners
    for v in range(corners.shape[0]):
        out[v, v] = 0.0
        for w in range(v):
            x, z, to_x, to_z = corners[v, 0], corners[v, 1], corners[w, 0], corners[w, 1]
            free = is_way_free(places, frame, x, z, to_x, to_z, PASSING, ANY_HEIGHT)
            dx, dz = to_x - x, to_z - z
            out[v, w] = out[w, v] = math.sqrt(dx * dx + dz * dz) if free else math.inf


@kernel
def list_seen(places, frame, near, out):
    """Write for each cell the nearest corners that are seen from somewhere in it, -1 behind the last.

    ``near`` (cells, most) lists the corners near each, the nearest first. Shape (cells, ``CORNERS``).
    """
    grid, corners = places.ways_grid, places.corners
    for cell in range(out.shape[0]):
        x = grid.x + (cell % int(grid.columns) + 0.5) * grid.size
        z = grid.z + (cell // int(grid.columns) + 0.5) * grid.size
        held = 0
        for k in range(near.shape[1]):
            v, is_seen = near[cell, k], False
            for point in range(5):
                px = x + (0.0 if point == 0 else 0.35 * grid.size * (1.0 if point & 1 else -1.0))
                pz = z + (0.0 if point == 0 else 0.35 * grid.size * (1.0 if point & 2 else -1.0))
                if not is_seen:
                    is_seen = is_way_free(places, frame, px, pz, corners[v, 0], corners[v, 1], 0.0, ANY_HEIGHT)
            if is_seen and held < CORNERS:
                out[cell, held] = v
                held += 1
        for m in range(held, CORNERS):
            out[cell, m] = -1

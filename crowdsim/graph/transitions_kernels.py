"""Compiled search for local minima of the distance between frames."""

from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel

_DEPTH = 12


class Frames(NamedTuple):
    """What decides beside the distance whether there is a transition between frames.

    Attributes:
        clips: Clip of each frame (F,).
        contacts: Planted feet of each frame as one number (F,); they agree where the numbers are equal.
        near: Frames of one clip less than this apart are skipped.
    """

    clips: Any
    contacts: Any
    near: int


class Minima(NamedTuple):
    """Local minima of a block of rows.

    Attributes:
        columns: Frames k of each row, ascending (rows, F).
        squares: Their squared distances (rows, F).
        counts: How many there are in each row (rows,).
    """

    columns: Any
    squares: Any
    counts: Any


@kernel(allocates=True, fastmath={"contract"})
def square_distances(low, high, features, tiles, start, limit, out):
    """Write squared distances of frames to themselves and all later frames, for pairs of rows ``low`` to ``high``.

    Two rows go through a tile of columns at a time, four features at a time, so that every number loaded is used often.

    Args:
        low: First pair of rows; pair p is of rows 2 p and 2 p + 1.
        high: One past the last pair.
        features: Features of each frame; D is a multiple of 4, F a multiple of the tile's width W (F, D).
        tiles: The same by tiles of W frames, a tile's frames last (F / W, D, W).
        start: Frame of row 0.
        limit: Where all partial sums of a tile exceed it they are left at that, so an entry above it is only a lower
            bound.
        out: Row r belongs to frame ``start + r``; what lies before its own column is undefined (rows, F).
    """
    count, depth, width = tiles.shape
    sums, below_sums = np.empty(width, np.float32), np.empty(width, np.float32)
    for pair in range(low, high):
        r = 2 * pair
        i = start + r
        for t in range(i // width, count):
            tile = tiles[t]
            for c in range(width):
                sums[c] = np.float32(0.0)
                below_sums[c] = np.float32(0.0)
            for top in range(0, depth, _DEPTH):
                for d in range(top, min(depth, top + _DEPTH), 4):
                    a_0, a_1, a_2, a_3 = features[i, d], features[i, d + 1], features[i, d + 2], features[i, d + 3]
                    b_0, b_1 = features[i + 1, d], features[i + 1, d + 1]
                    b_2, b_3 = features[i + 1, d + 2], features[i + 1, d + 3]
                    there_0, there_1, there_2, there_3 = tile[d], tile[d + 1], tile[d + 2], tile[d + 3]
                    for c in range(width):
                        x_0, x_1, x_2, x_3 = there_0[c], there_1[c], there_2[c], there_3[c]
                        g_0, g_1, g_2, g_3 = x_0 - a_0, x_1 - a_1, x_2 - a_2, x_3 - a_3
                        sums[c] += (g_0 * g_0 + g_1 * g_1) + (g_2 * g_2 + g_3 * g_3)
                        g_0, g_1, g_2, g_3 = x_0 - b_0, x_1 - b_1, x_2 - b_2, x_3 - b_3
                        below_sums[c] += (g_0 * g_0 + g_1 * g_1) + (g_2 * g_2 + g_3 * g_3)
                near = 0
                for c in range(width):
                    near += (sums[c] <= limit) | (below_sums[c] <= limit)
                if near == 0:
                    break
            upper = out[r, t * width : (t + 1) * width]
            lower = out[r + 1, t * width : (t + 1) * width]
            for c in range(width):
                upper[c] = sums[c]
                lower[c] = below_sums[c]


@kernel(inline=True)
def _tie_break(i, k):
    """Return a number that decides between equal costs, so that a plateau yields scattered minima and not all of it."""
    h = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(k) * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= h >> np.uint64(29)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(32)
    return h


@kernel
def _is_lowest(squares, row, i, k, clips):
    """Return whether (i, k), i < k, is lower than its eight neighbours, as far as they lie in the same two clips."""
    frames = clips.shape[0]
    here = squares[row, k]
    number = _tie_break(i, k)
    for di in range(-1, 2):
        m = i + di
        if m < 0 or m >= frames or clips[m] != clips[i]:
            continue
        for dk in range(-1, 2):
            n = k + dk
            # Below the diagonal is the same distance as above it, with the frames exchanged.
            if n >= frames or clips[n] != clips[k] or n < m:
                continue
            there = squares[row + di, n]
            if there < here or (there == here and _tie_break(m, n) < number):
                return False
    return True


@kernel
def local_minima(low, high, squares, first, start, frames, limit, minima):
    """Collect the local minima (i, k), i < k, of frames from ``start`` on that may be transitions.

    Args:
        low: First row of ``minima`` to write.
        high: One past the last.
        squares: Squared distances; row r belongs to frame ``first + r``; holds the rows before and after as well.
        first: Frame of the first row of ``squares``.
        start: Frame i of row 0 of ``minima``.
        frames: ``Frames``.
        limit: Largest squared distance.
        minima: Written: ``Minima``.
    """
    clips, contacts, near = frames.clips, frames.contacts, frames.near
    columns, found, counts = minima.columns, minima.squares, minima.counts
    last = clips.shape[0] - 1
    for r in range(low, high):
        i = start + r
        count = 0
        for k in range(i + 1, last + 1):
            here = squares[i - first, k]
            if not here <= limit or contacts[i] != contacts[k]:
                continue
            if clips[i] == clips[k] and k - i < near:
                continue
            # Most are no minima already in their own row, which costs least to see.
            if k < last and clips[k + 1] == clips[k] and squares[i - first, k + 1] < here:
                continue
            if clips[k - 1] == clips[k] and squares[i - first, k - 1] < here:
                continue
            if _is_lowest(squares, i - first, i, k, clips):
                columns[r, count] = k
                found[r, count] = here
                count += 1
        counts[r] = count


@kernel
def keep_cheapest(start, rows, minima, last, best_frames, best_squares):
    """Keep for every frame the pairs that cost least, the cheapest first and the earlier of equal ones.

    Called block after block of ``local_minima``, so that each frame meets its partners in ascending order.

    Args:
        start: Frame of the first row.
        rows: Number of rows.
        minima: ``Minima``.
        last: Whether each frame is the last of its clip (F,); no transition leads past it.
        best_frames: Partners kept of each frame (F, N), updated.
        best_squares: Their squared distances, infinite where there is none (F, N), updated.
    """
    most = best_frames.shape[1]
    for r in range(rows):
        i = start + r
        for c in range(minima.counts[r]):
            k, square = minima.columns[r, c], minima.squares[r, c]
            for side in range(2):
                source, partner = (i, k) if side == 0 else (k, i)
                if last[partner] or not square < best_squares[source, most - 1]:
                    continue
                place = most - 1
                while place > 0 and square < best_squares[source, place - 1]:
                    best_squares[source, place] = best_squares[source, place - 1]
                    best_frames[source, place] = best_frames[source, place - 1]
                    place -= 1
                best_squares[source, place] = square
                best_frames[source, place] = partner

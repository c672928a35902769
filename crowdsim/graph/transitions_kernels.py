"""Compiled search for local minima of the distance between frames."""

import numba as nb
import numpy as np

_TILE = 128
_DEPTH = 12


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def square_distances(features, columns, start, stop, limit, out):
    """Write squared distances of frames ``start``..``stop`` to themselves and all later frames.

    Args:
        features: Features of each frame (F, D), D a multiple of 4.
        columns: The same transposed (D, F).
        start: First frame.
        stop: One past the last frame.
        limit: Where all partial sums of a tile exceed it they are left at that, so an entry above it is only a lower
            bound.
        out: Row r belongs to frame ``start + r``; what lies before its own column is of no meaning (stop - start, F).
    """
    depth, frames = columns.shape
    for r in nb.prange(stop - start):
        i = start + r
        sums = np.empty(_TILE, np.float32)
        for left in range(i // _TILE * _TILE, frames, _TILE):
            width = min(_TILE, frames - left)
            sums[:] = np.float32(0.0)
            for top in range(0, depth, _DEPTH):
                for d in range(top, min(depth, top + _DEPTH), 4):
                    here_0, here_1, here_2, here_3 = (
                        features[i, d],
                        features[i, d + 1],
                        features[i, d + 2],
                        features[i, d + 3],
                    )
                    for c in range(width):
                        gap_0 = columns[d, left + c] - here_0
                        gap_1 = columns[d + 1, left + c] - here_1
                        gap_2 = columns[d + 2, left + c] - here_2
                        gap_3 = columns[d + 3, left + c] - here_3
                        sums[c] += (gap_0 * gap_0 + gap_1 * gap_1) + (gap_2 * gap_2 + gap_3 * gap_3)
                below = 0
                for c in range(width):
                    below += sums[c] <= limit
                if below == 0:
                    break
            for c in range(width):
                out[r, left + c] = sums[c]


@nb.njit(cache=True, inline="always")
def _lot(i, k):
    """Return a number that decides between equal costs, so that a plateau yields scattered minima and not all of it."""
    h = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(k) * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= h >> np.uint64(29)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(32)
    return h


@nb.njit(cache=True, error_model="numpy")
def _is_lowest(squares, row, i, k, clips):
    """Return whether (i, k), i < k, is lower than its eight neighbours, as far as they lie in the same two clips."""
    frames = clips.shape[0]
    here = squares[row, k]
    lot = _lot(i, k)
    for di in range(-1, 2):
        m = i + di
        if m < 0 or m >= frames or clips[m] != clips[i]:
            continue
        for dk in range(-1, 2):
            n = k + dk
            # Below the diagonal stands the same distance as above it, with the frames exchanged.
            if n >= frames or clips[n] != clips[k] or n < m:
                continue
            there = squares[row + di, n]
            if there < here or (there == here and _lot(m, n) < lot):
                return False
    return True


@nb.njit(cache=True, parallel=True, error_model="numpy")
def local_minima(squares, first, start, stop, clips, contacts, near, limit, out_columns, out_squares, out_counts):
    """Collect the local minima (i, k), i < k, of rows ``start``..``stop`` that may be transitions.

    Args:
        squares: Squared distances; row r belongs to frame ``first + r``; holds the rows beside ``start`` and ``stop``.
        first: Frame of the first row of ``squares``.
        start: First frame i.
        stop: One past the last frame i.
        clips: Clip of each frame (F,).
        contacts: Planted feet of each frame as one number (F,); they agree where the numbers are equal.
        near: Frames of one clip less than this apart are skipped.
        limit: Largest squared distance.
        out_columns: Frames k of each row, ascending (stop - start, F).
        out_squares: Their squared distances (stop - start, F).
        out_counts: How many there are in each row (stop - start,).
    """
    frames = clips.shape[0]
    for r in nb.prange(stop - start):
        i = start + r
        count = 0
        for k in range(i + 1, frames):
            here = squares[i - first, k]
            if not here <= limit or contacts[i] != contacts[k]:
                continue
            if clips[i] == clips[k] and k - i < near:
                continue
            if _is_lowest(squares, i - first, i, k, clips):
                out_columns[r, count] = k
                out_squares[r, count] = here
                count += 1
        out_counts[r] = count


@nb.njit(cache=True, error_model="numpy")
def keep_cheapest(start, rows, columns, squares, counts, last, best_frames, best_squares):
    """Keep for every frame the pairs that cost least, the cheapest first and the earlier of equal ones.

    Called block after block of ``local_minima``, so that each frame meets its partners in ascending order.

    Args:
        start: Frame of the first row.
        rows: Number of rows.
        columns: Partner frames of each row (rows, F).
        squares: Their squared distances (rows, F).
        counts: How many there are in each row (rows,).
        last: Whether each frame is the last of its clip (F,); no transition leads past it.
        best_frames: Partners kept of each frame (F, N), updated.
        best_squares: Their squared distances, infinite where there is none (F, N), updated.
    """
    most = best_frames.shape[1]
    for r in range(rows):
        i = start + r
        for c in range(counts[r]):
            k, square = columns[r, c], squares[r, c]
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

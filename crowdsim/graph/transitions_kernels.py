"""Compiled search for local minima of the distance between frames."""

import numba as nb
import numpy as np

_TILE = 128
_DEPTH = 12


@nb.njit(cache=True, inline="always")
def _order(i, k):
    """Return a number that decides between equal costs, so that a plateau yields scattered minima and not all of it."""
    h = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(k) * np.uint64(0xC2B2AE3D27D4EB4F)
    h ^= h >> np.uint64(29)
    h *= np.uint64(0xBF58476D1CE4E5B9)
    h ^= h >> np.uint64(32)
    return h


@nb.njit(cache=True, parallel=True, error_model="numpy")
def square_distances(features, columns, start, stop, limit, out):
    """Write squared distances of frames ``start``..``stop`` to all later frames.

    ``columns`` is ``features`` transposed. Row r of ``out`` belongs to frame ``start + r``; entries of earlier frames
    may be left alone. A tile all of whose partial sums exceed ``limit`` is left off there, so an entry
    above ``limit`` is only a lower bound.
    """
    depth, frames = columns.shape
    for r in nb.prange(stop - start):
        i = start + r
        sums = np.empty(_TILE, np.float32)
        for left in range(i // _TILE * _TILE, frames, _TILE):
            width = min(_TILE, frames - left)
            sums[:] = np.float32(0.0)
            for top in range(0, depth, _DEPTH):
                for d in range(top, min(depth, top + _DEPTH)):
                    here = features[i, d]
                    column = columns[d, left : left + width]
                    for c in range(width):
                        gap = column[c] - here
                        sums[c] += gap * gap
                below = 0
                for c in range(width):
                    below += sums[c] <= limit
                if below == 0:
                    break
            for c in range(width):
                out[r, left + c] = sums[c]


@nb.njit(cache=True, error_model="numpy")
def _is_lowest(squares, row, i, k, frames, clips, radius):
    """Return whether no entry of the same clips within ``radius`` rows and columns of (i, k) is lower."""
    here = squares[row, k]
    mine = _order(i, k)
    for di in range(-radius, radius + 1):
        m = i + di
        if m < 0 or m >= frames or clips[m] != clips[i]:
            continue
        for dk in range(-radius, radius + 1):
            n = k + dk
            # Below the diagonal stands the same distance as above it, with the frames exchanged.
            if n < 0 or n >= frames or clips[n] != clips[k] or n < m:
                continue
            there = squares[row + di, n]
            if there < here or (there == here and _order(m, n) < mine):
                return False
    return True


@nb.njit(cache=True, parallel=True, error_model="numpy")
def local_minima(
    squares, first, start, stop, clips, contacts, near, radius, limit, out_columns, out_squares, out_counts
):
    """Collect the local minima (i, k), i < k, of rows ``start``..``stop`` that may be transitions.

    Args:
        squares: Squared distances; row r belongs to frame ``first + r``; holds ``radius`` rows more at both ends.
        first: Frame of the first row of ``squares``.
        start: First frame i.
        stop: One past the last frame i.
        clips: Clip of each frame (F,).
        contacts: Planted feet of each frame as one number (F,); they agree where the numbers are equal.
        near: Frames of one clip less than this apart are skipped.
        radius: Frames up to which neighbours are compared in both directions.
        limit: Largest squared distance.
        out_columns: Frames k of each row (stop - start, F).
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
            if _is_lowest(squares, i - first, i, k, frames, clips, radius):
                out_columns[r, count] = k
                out_squares[r, count] = here
                count += 1
        out_counts[r] = count

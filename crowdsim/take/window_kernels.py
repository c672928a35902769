"""Compiled look-ups in a stretch of a take: where avatars are at any time, their cuts, and when their feet stand.

A window ``w`` is a ``window.Rows``, frames ``m`` are ``motion.Frames``. Nothing here depends on where the window begins
or ends, as long as the time that is asked for lies inside it.
"""

import math

import numba as nb
import numpy as np

SNAP = 1e-4


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _ground_at(m, frame):
    """Ground transform of a playback frame, between two if need be."""
    low = int(frame)
    part = frame - low
    if part <= 0.0:
        return m.ground[low, 0], m.ground[low, 1], m.ground[low, 2]
    rest = 1.0 - part
    return (
        m.ground[low, 0] * rest + m.ground[low + 1, 0] * part,
        m.ground[low, 1] * rest + m.ground[low + 1, 1] * part,
        m.ground[low, 2] * rest + m.ground[low + 1, 2] * part,
    )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _moved(m, x, z, heading, scale, start, end):
    """A ground transform after captured motion from one playback frame to another of its clip."""
    if start == end:
        return x, z, heading
    ax, az, ah = _ground_at(m, start)
    bx, bz, bh = _ground_at(m, end)
    turn = heading - ah
    cos, sin = math.cos(turn) * scale, math.sin(turn) * scale
    dx, dz = bx - ax, bz - az
    return x + dx * cos + dz * sin, z - dx * sin + dz * cos, turn + bh


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _place(w, m, time, n):
    """Playback frame, how far on to the next, ground transform, and the push that lies in it; frame -1 if absent."""
    clock = time * w.rate - w.first
    rows = w.phase.shape[0]
    before = min(max(math.floor(clock + 1e-9), 0), rows - 1)
    after = min(before + 1, rows - 1)
    if not w.present[before, n]:
        return -1, 0.0, 0.0, 0.0, 0.0
    part = min(max(clock - before, 0.0), 1.0)
    if part < 1e-9:
        part = 0.0
    speed, scale, stride = w.speeds[n], w.scales[n], m.stride
    cut = after > before and w.fresh[after, n] and w.present[after, n]
    began = 1.0 - w.phase[after, n] / speed if cut else 2.0
    old_start = w.origins[before, n] + w.phase[before, n] * stride
    old_end = float(w.origins[before, n] + w.lengths[before, n] * stride)
    new_start = float(w.origins[after, n])
    new_end = w.origins[after, n] + w.phase[after, n] * stride
    new = part >= began - 1e-9
    if new:
        moved = min(max((part - began) * speed, 0.0), w.lengths[after, n])
        frame = w.origins[after, n] + moved * stride
    else:
        frame = w.origins[before, n] + min(w.phase[before, n] + part * speed, w.lengths[before, n]) * stride
    whole = math.floor(frame + SNAP)
    fraction = frame - whole
    if fraction < SNAP:
        fraction = 0.0
    exact = whole + fraction
    x, z, h = w.ground[before, n, 0], w.ground[before, n, 1], w.ground[before, n, 2]
    if new:
        x, z, h = _moved(m, x, z, h, scale, old_start, old_end)
        x, z, h = _moved(m, x, z, h, scale, new_start, exact)
    else:
        x, z, h = _moved(m, x, z, h, scale, old_start, exact)
    if after > before and w.present[after, n] and part > 0.0:
        # Where the next control frame is not where motion leads, avatars have been pushed: one passes into the other.
        ax, az, ah = w.ground[after, n, 0], w.ground[after, n, 1], w.ground[after, n, 2]
        if cut and not new:
            ax, az, ah = _moved(m, ax, az, ah, scale, new_end, new_start)
            ax, az, ah = _moved(m, ax, az, ah, scale, old_end, exact)
        else:
            ax, az, ah = _moved(m, ax, az, ah, scale, new_end, exact)
        turn = ah - h
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        x, z, h = x + (ax - x) * part, z + (az - z) * part, h + turn * part
    return whole, fraction, x, z, h


@nb.njit(cache=True, nogil=True, error_model="numpy")
def place_avatars(w, m, first, stop, columns, times, out_frames, out_fractions, out_ground):
    """Find where avatars are.

    Args:
        w: The window.
        m: The frames.
        first: First place in ``columns``.
        stop: One past the last.
        columns: Whose place is asked for, a column of the window each. Shape (n,).
        times: Shape (T, n) or (T, 1) [s].
        out_frames: Playback frame; -1 while absent. Shape (T, n), int32.
        out_fractions: How far on to the next. Shape (T, n).
        out_ground: Ground transform. Shape (T, n, 3).
    """
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            frame, fraction, x, z, h = _place(w, m, times[t, 0 if shared else i], columns[i])
            out_frames[t, i], out_fractions[t, i] = frame, fraction
            out_ground[t, i, 0], out_ground[t, i, 1], out_ground[t, i, 2] = x, z, h


@nb.njit(cache=True, nogil=True, error_model="numpy")
def measure_cuts(w, m, first, stop, owners, times, before, after, signs, places, gaps):
    """Measure how motion jumps at cuts ``first`` to ``stop``; C cuts.

    Args:
        w: The window.
        m: The frames.
        first: First cut.
        stop: One past the last.
        owners: Column of each cut's avatar. Shape (C,).
        times: When [s]. Shape (C,).
        before: Playback frame that each cut leaves. Shape (C,).
        after: Playback frame that it goes on from. Shape (C,).
        signs: 1, or -1 where a joint's quaternion goes on with the other sign; in the last column whether any does.
            Shape (C, J + 1), int8.
        places: Ground transform. Shape (C, 3).
        gaps: How far the balls of the feet jump in the world, new less old. Shape (C, 2, 3).
    """
    joints = m.rotations.shape[1]
    for i in range(first, stop):
        n, old, new = owners[i], before[i], after[i]
        scale = w.scales[n]
        _, _, x, z, heading = _place(w, m, times[i], n)
        places[i, 0], places[i, 1], places[i, 2] = x, z, heading
        cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
        for f in range(2):
            dx = np.float64(m.balls[new, f, 0]) - m.balls[old, f, 0]
            dz = np.float64(m.balls[new, f, 2]) - m.balls[old, f, 2]
            gaps[i, f, 0] = dx * cos + dz * sin
            gaps[i, f, 1] = (np.float64(m.balls[new, f, 1]) - m.balls[old, f, 1]) * scale
            gaps[i, f, 2] = dz * cos - dx * sin
        signs[i, joints] = 0
        for j in range(joints):
            dot = np.float32(0.0)
            for k in range(4):
                dot += m.rotations[old, j, k] * m.rotations[new, j, k]
            signs[i, j] = -1 if dot < 0.0 else 1
            if dot < 0.0:
                signs[i, joints] = 1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def find_stands(w, m, first, stop, out_stands, out_counts):
    """Find when the feet of the avatars in columns ``first`` to ``stop`` are planted, through cuts.

    Args:
        w: The window, R rows.
        m: The frames.
        first: First column.
        stop: One past the last.
        out_stands: Beginning and end of each stand [s]. Shape (n, 2, most, 2).
        out_counts: How many there are. Shape (n, 2).
    """
    rows = w.phase.shape[0]
    most = out_stands.shape[2]
    for n in range(first, stop):
        speed = w.speeds[n]
        for f in range(2):
            count, standing = 0, False
            for r in range(rows - 1):
                if not w.present[r, n]:
                    standing = False
                    continue
                cut = w.fresh[r + 1, n] and w.present[r + 1, n]
                began = 1.0 - w.phase[r + 1, n] / speed if cut else 1.0
                for piece in range(2 if cut else 1):
                    if piece == 0:
                        origin, phase, low, high = w.origins[r, n], w.phase[r, n], 0.0, began
                    else:
                        origin, phase, low, high = w.origins[r + 1, n], 0.0, began, 1.0
                    begin = origin + phase * m.stride
                    end = origin + min(phase + (high - low) * speed, w.lengths[r + piece, n]) * m.stride
                    frame = math.floor(begin + SNAP)
                    while frame < end - SNAP:
                        planted = m.contacts[frame, f] and m.contacts[frame + 1, f]
                        if planted != standing:
                            share = low + max(frame - begin, 0.0) / (speed * m.stride)
                            time = (w.first + r + share) / w.rate
                            if planted and count < most:
                                out_stands[n, f, count, 0] = time
                                count += 1
                            standing = planted
                        if planted:
                            share = min(low + (min(frame + 1.0, end) - begin) / (speed * m.stride), high)
                            out_stands[n, f, count - 1, 1] = (w.first + r + share) / w.rate
                        frame += 1
            out_counts[n, f] = count

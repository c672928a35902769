"""Compiled look-up of where avatars are at any time in a stretch of a take.

Nothing here depends on where the stretch begins or ends, as long as the time that is asked for lies inside it.
"""

import math

from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import HEADING, X, Z

SNAP = 1e-4
"""Distance from a playback frame within which a time lies on it [playback frames]."""


@kernel
def _ground_at(motion, frame):
    """Return the ground transform at a playback frame, between two if need be."""
    low = int(frame)
    part = frame - low
    here = motion.ground[low]
    if part <= 0.0:
        return here[X], here[Z], here[HEADING]
    rest, there = 1.0 - part, motion.ground[low + 1]
    return (
        here[X] * rest + there[X] * part,
        here[Z] * rest + there[Z] * part,
        here[HEADING] * rest + there[HEADING] * part,
    )


@kernel
def _moved(motion, ground, scale, start, end):
    """Return a ground transform after captured motion from one playback frame to another of its clip."""
    if start == end:
        return ground
    x, z, heading = ground
    ax, az, ah = _ground_at(motion, start)
    bx, bz, bh = _ground_at(motion, end)
    turn = heading - ah
    cos, sin = math.cos(turn) * scale, math.sin(turn) * scale
    dx, dz = bx - ax, bz - az
    return x + dx * cos + dz * sin, z - dx * sin + dz * cos, turn + bh


@kernel
def _shifted(ground, scale, shift):
    """Return the ground transform that a shift leads to, by the size of its body."""
    x, z, heading = ground
    cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
    return (
        x + shift[X] * cos + shift[Z] * sin,
        z - shift[X] * sin + shift[Z] * cos,
        heading + shift[HEADING],
    )


@kernel
def _unshifted(ground, scale, shift):
    """Return the ground transform from which a shift leads to the given one."""
    x, z, heading = ground
    heading -= shift[HEADING]
    cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
    return x - shift[X] * cos - shift[Z] * sin, z + shift[X] * sin - shift[Z] * cos, heading


@kernel
def place_at(rows, motion, time, n):
    """Return playback frame, fraction to the next, and ground transform of an avatar; frame -1 if absent."""
    clock = time * rows.rate - rows.first
    count = rows.phase.shape[0]
    before = min(max(math.floor(clock + 1e-9), 0), count - 1)
    after = min(before + 1, count - 1)
    if not rows.present[before, n]:
        return -1, 0.0, (0.0, 0.0, 0.0)
    part = min(max(clock - before, 0.0), 1.0)
    if part < 1e-9:
        part = 0.0
    speed, scale, stride = rows.speeds[n], rows.scales[n], motion.stride
    starts = after > before and rows.fresh[after, n] and rows.present[after, n]
    began = 1.0 - rows.phase[after, n] / speed if starts else 2.0
    old_start = rows.origins[before, n] + rows.phase[before, n] * stride
    old_end = float(rows.origins[before, n] + rows.lengths[before, n] * stride)
    new_start = float(rows.origins[after, n])
    new = part >= began - 1e-9
    if new:
        moved = min(max((part - began) * speed, 0.0), rows.lengths[after, n])
        frame = rows.origins[after, n] + moved * stride
    else:
        length = rows.lengths[before, n]
        if after == before:
            # What comes after the last control frame is not known: motion goes on as captured.
            length = max(length, (motion.bounds[rows.origins[before, n], 1] - rows.origins[before, n]) / stride)
        frame = rows.origins[before, n] + min(rows.phase[before, n] + part * speed, length) * stride
    whole = math.floor(frame + SNAP)
    fraction = frame - whole
    if fraction < SNAP:
        fraction = 0.0
    exact = whole + fraction
    row = rows.ground[before, n]
    ground = row[X], row[Z], row[HEADING]
    if new:
        ground = _moved(motion, ground, scale, old_start, old_end)
        ground = _shifted(ground, scale, rows.shifts[after, n])
        ground = _moved(motion, ground, scale, new_start, exact)
    else:
        ground = _moved(motion, ground, scale, old_start, exact)
    if after > before and rows.present[after, n] and part > 0.0:
        split = starts and not new
        ground = _pushed(rows, motion, ground, n, before, part, exact, split)
    return whole, fraction, ground


@kernel(inline=True)
def _pushed(rows, motion, ground, n, before, part, exact, split):
    """Return a ground transform between what motion makes of this control frame and of the next.

    Where the next control frame is not where motion leads, avatars have been pushed: one passes into the other.
    ``split`` says that an action starts between here and there.
    """
    after, scale, stride = before + 1, rows.scales[n], motion.stride
    row = rows.ground[after, n]
    other = row[X], row[Z], row[HEADING]
    new_end = rows.origins[after, n] + rows.phase[after, n] * stride
    if split:
        old_end = float(rows.origins[before, n] + rows.lengths[before, n] * stride)
        other = _moved(motion, other, scale, new_end, float(rows.origins[after, n]))
        other = _unshifted(other, scale, rows.shifts[after, n])
        other = _moved(motion, other, scale, old_end, exact)
    else:
        other = _moved(motion, other, scale, new_end, exact)
    x, z, heading = ground
    turn = other[HEADING] - heading
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    return x + (other[X] - x) * part, z + (other[Z] - z) * part, heading + turn * part


@kernel
def find_playback(first, stop, rows, motion, moments, playback):
    """Find where avatars are.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        rows: The control frames, a ``Rows``.
        motion: The playback frames, a ``motion.Frames``.
        moments: Who and when, a ``Moments``.
        playback: Written, a ``Playback``.
    """
    times = moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            frame, fraction, ground = place_at(rows, motion, times[t, 0 if shared else i], moments.columns[i])
            playback.frames[t, i], playback.fractions[t, i] = frame, fraction
            out = playback.ground[t, i]
            out[X], out[Z], out[HEADING] = ground

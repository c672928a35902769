"""Compiled look-ups in a stretch of a take: where avatars are at any time, their cuts, and when their feet stand.

A window ``w`` is a ``window.Rows``, frames ``m`` are ``motion.Frames``. Nothing here depends on where the window begins
or ends, as long as the time that is asked for lies inside it.
"""

import math

import numpy as np

from crowdsim.jit import kernel

SNAP = 1e-4
HOP, SHORT = 0.15, 0.11
"""Least time of a hop, and time between two stands with a cut between them that is too short for a swing [s]."""


@kernel
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


@kernel
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


@kernel
def _shifted(x, z, heading, scale, shift):
    """A ground transform that lies on another as a shift says, by the size of its body."""
    cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
    return x + shift[0] * cos + shift[1] * sin, z - shift[0] * sin + shift[1] * cos, heading + shift[2]


@kernel
def _unshifted(x, z, heading, scale, shift):
    """The ground transform on which another lies as a shift says."""
    heading -= shift[2]
    cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
    return x - shift[0] * cos - shift[1] * sin, z + shift[0] * sin - shift[1] * cos, heading


@kernel
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
        x, z, h = _shifted(x, z, h, scale, w.shifts[after, n])
        x, z, h = _moved(m, x, z, h, scale, new_start, exact)
    else:
        x, z, h = _moved(m, x, z, h, scale, old_start, exact)
    if after > before and w.present[after, n] and part > 0.0:
        # Where the next control frame is not where motion leads, avatars have been pushed: one passes into the other.
        ax, az, ah = w.ground[after, n, 0], w.ground[after, n, 1], w.ground[after, n, 2]
        if cut and not new:
            ax, az, ah = _moved(m, ax, az, ah, scale, new_end, new_start)
            ax, az, ah = _unshifted(ax, az, ah, scale, w.shifts[after, n])
            ax, az, ah = _moved(m, ax, az, ah, scale, old_end, exact)
        else:
            ax, az, ah = _moved(m, ax, az, ah, scale, new_end, exact)
        turn = ah - h
        turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
        x, z, h = x + (ax - x) * part, z + (az - z) * part, h + turn * part
    return whole, fraction, x, z, h


@kernel
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


@kernel
def _turn_between(old, new, out):
    """Write the rotation vector that turns one quaternion into another."""
    a, b, c, d = np.float64(old[0]), np.float64(old[1]), np.float64(old[2]), np.float64(old[3])
    e, f, g, h = np.float64(new[0]), np.float64(new[1]), np.float64(new[2]), np.float64(new[3])
    w = e * a + f * b + g * c + h * d
    x = f * a - e * b - g * d + h * c
    y = g * a - e * c - h * b + f * d
    z = h * a - e * d - f * c + g * b
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    size = math.sqrt(x * x + y * y + z * z)
    share = 2.0 * math.atan2(size, w) / size if size > 1e-9 else 2.0
    out[0], out[1], out[2] = x * share, y * share, z * share


@kernel
def _about_y(heading, scale, vector):
    """Turn a vector about the upright axis, and scale it, in place."""
    cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
    x, z = vector[0], vector[2]
    vector[0], vector[1], vector[2] = x * cos + z * sin, vector[1] * scale, z * cos - x * sin


@kernel
def measure_cuts(w, m, toes, first, stop, owners, times, before, after, signs, shifts, places, looks, gaps):
    """Measure how motion jumps at cuts ``first`` to ``stop``; C cuts.

    Args:
        w: The window.
        m: The frames.
        toes: Joint of each foot's toes, -1 where there is none. Shape (2,).
        first: First cut.
        stop: One past the last.
        owners: Column of each cut's avatar. Shape (C,).
        times: When [s]. Shape (C,).
        before: Playback frame that each cut leaves. Shape (C,).
        after: Playback frame that it goes on from. Shape (C,).
        signs: 1, or -1 where a joint's quaternion goes on with the other sign; in the last column whether any does.
            Shape (C, J + 1), int8.
        shifts: Where the ground transform of the motion gone on with lies, as seen from that of the motion left. Shape
            (C, 3).
        places: Ground transform of the motion gone on with. Shape (C, 3).
        looks: Cosine and sine of the angle by which the clip of the motion left is turned in the world, and that of the
            motion gone on with. Shape (C, 2, 2).
        gaps: How far held points of the feet jump in the world [m], how far feet turn in the world, and toes on them,
            as rotation vectors, new less old. Shape (C, 2, 9).
    """
    joints = m.rotations.shape[1]
    turned = np.empty(4)
    for i in range(first, stop):
        n, old, new = owners[i], before[i], after[i]
        scale = w.scales[n]
        _, _, x, z, heading = _place(w, m, times[i], n)
        places[i, 0], places[i, 1], places[i, 2] = x, z, heading
        left, on = heading - shifts[i, 2] - m.ground[old, 2], heading - m.ground[new, 2]
        looks[i, 0, 0], looks[i, 0, 1] = math.cos(left), math.sin(left)
        looks[i, 1, 0], looks[i, 1, 1] = math.cos(on), math.sin(on)
        cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
        # What is left is seen from the ground transform of what is gone on with.
        away = shifts[i, 2]
        cos_away, sin_away = math.cos(away), math.sin(away)
        cos_half, sin_half = math.cos(0.5 * away), math.sin(-0.5 * away)
        for f in range(2):
            x, z = m.holds[old, f, 0] - shifts[i, 0], m.holds[old, f, 2] - shifts[i, 1]
            dx = m.holds[new, f, 0] - (x * cos_away - z * sin_away)
            dz = m.holds[new, f, 2] - (x * sin_away + z * cos_away)
            gaps[i, f, 0] = dx * cos + dz * sin
            gaps[i, f, 1] = (np.float64(m.holds[new, f, 1]) - m.holds[old, f, 1]) * scale
            gaps[i, f, 2] = dz * cos - dx * sin
            q = m.feet[old, f]
            turned[0], turned[1] = cos_half * q[0] - sin_half * q[2], cos_half * q[1] + sin_half * q[3]
            turned[2], turned[3] = cos_half * q[2] + sin_half * q[0], cos_half * q[3] - sin_half * q[1]
            _turn_between(turned, m.feet[new, f], gaps[i, f, 3:6])
            _about_y(heading, 1.0, gaps[i, f, 3:6])
            gaps[i, f, 6:9] = 0.0
            if toes[f] >= 0:
                _turn_between(m.rotations[old, toes[f]], m.rotations[new, toes[f]], gaps[i, f, 6:9])
        signs[i, joints] = 0
        for j in range(joints):
            dot = np.float32(0.0)
            for k in range(4):
                dot += m.rotations[old, j, k] * m.rotations[new, j, k]
            signs[i, j] = -1 if dot < 0.0 else 1
            if dot < 0.0:
                signs[i, joints] = 1


@kernel
def find_stands(w, m, first, stop, out_stands, out_counts):
    """Find when the feet of the avatars in columns ``first`` to ``stop`` are planted, through cuts.

    A foot that leaves the floor before a cut and is down again right after it stands all along.

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
            count, standing, last = 0, False, -math.inf
            for r in range(rows - 1):
                if not w.present[r, n]:
                    standing = False
                    continue
                cut = w.fresh[r + 1, n] and w.present[r + 1, n]
                began = 1.0 - w.phase[r + 1, n] / speed if cut else 1.0
                if cut:
                    last = (w.first + r + began) / w.rate
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
                            hops = count > 0 and last > out_stands[n, f, max(count - 1, 0), 1] - 1e-6
                            hops = hops and time - out_stands[n, f, max(count - 1, 0), 1] < SHORT
                            if planted and count < most and not hops:
                                out_stands[n, f, count, 0] = time
                                count += 1
                            standing = planted
                        if planted:
                            share = min(low + (min(frame + 1.0, end) - begin) / (speed * m.stride), high)
                            out_stands[n, f, count - 1, 1] = (w.first + r + share) / w.rate
                        frame += 1
            out_counts[n, f] = count


@kernel
def plan_falls(cuts, stands, m, scales, first, stop, how, gait, out_kinds, out_moves):
    """Settle what feet of avatars ``first`` to ``stop`` do about cuts.

    A foot that comes up soon after the cut stays where it is until then, one that came down shortly before it came down
    where it stays. Where it is not far, and the foot gets there no faster than planted feet slide in the capture, it is
    dragged. Others make a step as the capture has them, before the cut or after it. All of it depends on what lies near
    the cut, and on no other cut.

    Args:
        cuts: A ``window.Cuts``.
        stands: A ``window.Stands``.
        m: The frames.
        scales: Body size by column.
        first: First column.
        stop: One past the last.
        how: See ``window.FALLS``.
        gait: A ``gait.Gait``.
        out_kinds: 0 where a foot is in the air, 1 where it stays where it is all along, 2 where it makes a step. Shape
            (C, 2), int8.
        out_moves: Beginning and end of the time in which it moves [s], and how high it rises [m]. Shape (C, 2, 3).
    """
    after_cut, before_cut, early, shortest, longest, most, ahead, behind, near, speed, hardly = how
    # An eased way is fastest in its middle, 15 / 8 of the mean.
    near = max(min(near, gait.slide * (ahead + behind) / 1.875), hardly)
    lasts = np.empty(2)
    for n in range(first, stop):
        for cut in range(cuts.starts[n], cuts.starts[n + 1]):
            time, steps = cuts.times[cut], 0
            for f in range(2):
                out_kinds[cut, f], lasts[f] = 0, 0.0
                out_moves[cut, f, 0], out_moves[cut, f, 1], out_moves[cut, f, 2] = time - 1e-3, time, 0.0
                begin, end, air = 0.0, -1.0, HOP
                for k in range(stands.counts[n, f]):
                    if stands.spans[n, f, k, 0] < time < stands.spans[n, f, k, 1]:
                        begin, end = stands.spans[n, f, k, 0], stands.spans[n, f, k, 1]
                        if k > 0:
                            air = begin - stands.spans[n, f, k - 1, 1]
                        break
                if end < begin:
                    continue
                gap = cuts.gaps[cut, f]
                far = math.sqrt(gap[0] * gap[0] + gap[2] * gap[2])
                out_kinds[cut, f] = 1
                if not (m.contacts[cuts.before[cut], f] and m.contacts[cuts.after[cut], f]):
                    # It is in the air for a moment, and goes over in a hop as long as it needs.
                    out_kinds[cut, f] = 2
                    half = 0.5 * min(max(HOP, far / (scales[n] * speed)), 2.0 * HOP)
                    out_moves[cut, f, 0], out_moves[cut, f, 1] = time - half, time + half
                elif time - begin < before_cut and air > min(far / (scales[n] * speed), HOP) - 1e-6:
                    out_moves[cut, f, 0], out_moves[cut, f, 1] = time - 11.0, time - 10.0
                elif end - time < after_cut:
                    out_moves[cut, f, 0], out_moves[cut, f, 1] = time + 10.0, time + 11.0
                elif far < near * scales[n]:
                    out_moves[cut, f, 0], out_moves[cut, f, 1] = time - ahead, time + behind
                else:
                    steps += 1
                    out_kinds[cut, f] = 2
                    way = far / scales[n]
                    lasts[f] = min(max(gait.seconds + gait.seconds_each * way, shortest), longest)
                    high = min(gait.height + gait.height_each * way, most) * min(way / 0.04, 1.0)
                    out_moves[cut, f, 2] = high * scales[n]
            if steps == 0:
                continue
            # Feet wait as long as they can, for they may come up by themselves. Of two the one that leads the way steps
            # first.
            new, heading = m.holds[cuts.after[cut]], cuts.places[cut, 2]
            x, z = new[0, 0] - new[1, 0], new[0, 2] - new[1, 2]
            x, z = x * math.cos(heading) + z * math.sin(heading), z * math.cos(heading) - x * math.sin(heading)
            along = x * (cuts.gaps[cut, 0, 0] + cuts.gaps[cut, 1, 0])
            along += z * (cuts.gaps[cut, 0, 2] + cuts.gaps[cut, 1, 2])
            for f in range(2):
                if lasts[f] > 0.0:
                    leads = steps == 2 and (along > 0.0) == (f == 0)
                    out_moves[cut, f, 0] = time + (early if leads else after_cut)
                    out_moves[cut, f, 1] = out_moves[cut, f, 0] + lasts[f]

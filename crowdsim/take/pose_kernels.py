"""Compiled poses: database frames, and the blends that carry them over the cuts between actions.

A cut at time c leaves motion a for motion b, and W is a quintic step from 0 to 1 over a span around c. Both motions
play on in the capture, so with d = a - b, ``-W d`` is laid over a before the cut and ``(1 - W) d`` over b after it:
pose, velocity and acceleration go on through the cut, and a blend has an end. Where blends overlap they add up, each
with what later ones leave of it, so that a pose is always a mean of captured ones. Offsets are linear: differences of
quaternions, brought back to unit length at the end, of places, and of ground transforms.
"""

import math

import numpy as np

from crowdsim.jit import kernel


@kernel
def _between(m, start, steps):
    """A frame and how far on from it motion is that has gone ``steps`` playback frames from another.

    Beyond its clip motion goes on straight for a while, and comes to rest.
    """
    first, last = m.bounds[start, 0], m.bounds[start, 1]
    frame = start + steps
    low = min(max(math.floor(frame), first), last - 1)
    part = frame - low
    if part > 1.0:
        part = 1.0 + 6.0 * math.tanh((part - 1.0) / 6.0)
    elif part < 0.0:
        part = 6.0 * math.tanh(part / 6.0)
    return low, part


@kernel
def _ground_way(m, start, low, part, scale, look, out):
    """How far motion has gone from a frame on, in the world; its clip is turned by the angle of a cosine and a sine."""
    rest = 1.0 - part
    dx = m.ground[low, 0] * rest + m.ground[low + 1, 0] * part - m.ground[start, 0]
    dz = m.ground[low, 1] * rest + m.ground[low + 1, 1] * part - m.ground[start, 1]
    cos, sin = look[0] * scale, look[1] * scale
    out[0], out[1] = dx * cos + dz * sin, dz * cos - dx * sin
    out[2] = m.ground[low, 2] * rest + m.ground[low + 1, 2] * part - m.ground[start, 2]


@kernel
def _left(cuts, cut, time):
    """How much is left, at a time, of what a cut leaves: 1 before its span, 0 after it."""
    s = (time - cuts.times[cut] + cuts.spans[cut, 0]) / (cuts.spans[cut, 0] + cuts.spans[cut, 1])
    if s <= 0.0:
        return 1.0
    if s >= 1.0:
        return 0.0
    return 1.0 - s * s * s * (10.0 - s * (15.0 - 6.0 * s))


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _add_cut(cut, past, share, side, time, m, cuts, speed, scale, sums, shift, drift, way):
    """Add a share of what differs at a cut; ``side`` holds signs by which quaternions differ there."""
    apart = time - cuts.times[cut]
    if share == 0.0:
        return
    steps = apart * speed * m.rate
    old, on = _between(m, cuts.before[cut], steps)
    new, off = _between(m, cuts.after[cut], steps)
    for k in range(3):
        there = m.roots[old, k] + (m.roots[old + 1, k] - m.roots[old, k]) * on
        here = m.roots[new, k] + (m.roots[new + 1, k] - m.roots[new, k]) * off
        shift[k] += share * scale * (there - here)
    shift_by = cuts.shifts[cut]
    left = cuts.places[cut, 2] - shift_by[2]
    cos, sin = math.cos(left) * scale, math.sin(left) * scale
    drift[0] -= share * (shift_by[0] * cos + shift_by[1] * sin)
    drift[1] -= share * (shift_by[1] * cos - shift_by[0] * sin)
    drift[2] -= share * shift_by[2]
    _ground_way(m, cuts.before[cut], old, on, scale, cuts.looks[cut, 0], way)
    for k in range(3):
        drift[k] += share * way[k]
    _ground_way(m, cuts.after[cut], new, off, scale, cuts.looks[cut, 1], way)
    for k in range(3):
        drift[k] -= share * way[k]
    a, b = np.float32(share * (1.0 - on)), np.float32(share * on)
    c, d = np.float32(share * (1.0 - off)), np.float32(share * off)
    for j in range(sums.shape[0]):
        # The old motion's signs are those of ``side`` before the cut, the new one's those after it.
        one, other = side[j], side[j]
        if past:
            one *= np.float32(cuts.signs[cut, j])
        else:
            other *= np.float32(cuts.signs[cut, j])
        for k in range(4):
            sums[j, k] += one * (a * m.rotations[old, j, k] + b * m.rotations[old + 1, j, k]) - other * (
                c * m.rotations[new, j, k] + d * m.rotations[new + 1, j, k]
            )


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _write_pose(frame, fraction, rotations, blended, sums, out):
    """One pose: a database frame or one between two, with offsets laid over it."""
    joints = rotations.shape[1]
    part = np.float32(fraction)
    rest = np.float32(1.0) - part
    here, there = rotations[frame], rotations[frame + 1 if fraction > 0.0 else frame]
    for j in range(joints):
        w = here[j, 0] * rest + there[j, 0] * part
        x = here[j, 1] * rest + there[j, 1] * part
        y = here[j, 2] * rest + there[j, 2] * part
        z = here[j, 3] * rest + there[j, 3] * part
        if blended:
            w, x, y, z = w + sums[j, 0], x + sums[j, 1], y + sums[j, 2], z + sums[j, 3]
        norm = np.float32(1.0) / np.sqrt(w * w + x * x + y * y + z * z)
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = w * norm, x * norm, y * norm, z * norm


@kernel
def _unfold(bones, free, most, q):
    """Open an elbow or knee that blends have folded more than the body can, easing from one flexion to another."""
    o = bones[1]
    tx, ty, tz = (
        2.0 * (q[2] * o[2] - q[3] * o[1]),
        2.0 * (q[3] * o[0] - q[1] * o[2]),
        2.0 * (q[1] * o[1] - q[2] * o[0]),
    )
    vx = o[0] + q[0] * tx + q[2] * tz - q[3] * ty
    vy = o[1] + q[0] * ty + q[3] * tx - q[1] * tz
    vz = o[2] + q[0] * tz + q[1] * ty - q[2] * tx
    u = bones[0]
    nx, ny, nz = u[1] * vz - u[2] * vy, u[2] * vx - u[0] * vz, u[0] * vy - u[1] * vx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    flexion = math.atan2(size, u[0] * vx + u[1] * vy + u[2] * vz)
    if flexion <= free or size < 1e-9:
        return
    room = most - free
    half = 0.5 * (free + room * math.tanh((flexion - free) / room) - flexion)
    c, s = math.cos(half), math.sin(half) / size
    x, y, z = s * nx, s * ny, s * nz
    a, b, d, e = q[0], q[1], q[2], q[3]
    q[0] = c * a - x * b - y * d - z * e
    q[1] = c * b + x * a + y * e - z * d
    q[2] = c * d - x * e + y * a + z * b
    q[3] = c * e + x * d - y * b + z * a


@kernel
def blend_poses(
    first,
    stop,
    columns,
    times,
    frames,
    fractions,
    grounds,
    m,
    cuts,
    rate,
    reach,
    scales,
    speeds,
    hinges,
    out_roots,
    out_rotations,
):
    """Write the poses of avatars ``first`` to ``stop`` of ``columns`` at every time, in the world.

    Args:
        first: First place in ``columns``.
        stop: One past the last.
        columns: Column of each avatar in the window. Shape (n,).
        times: Shape (T, n) or (T, 1) [s].
        frames: Playback frame at each time; -1 while absent. Shape (T, n), int32.
        fractions: How far on to the next frame. Shape (T, n).
        grounds: Ground transform at each time. Shape (T, n, 3).
        m: The frames, a ``motion.Frames``.
        cuts: A ``window.Cuts``.
        rate: Control frames a second.
        reach: Longest time before and after a cut over which it is blended [s].
        scales: Body size by column.
        speeds: Motion frames in a control frame, by column.
        hinges: A ``motion.Hinges``.
        out_roots: Place of the root in the world [m]. Shape (T, n, 3).
        out_rotations: Local rotations, the root's in the world. Shape (T, n, J, 4).
    """
    joints = m.rotations.shape[1]
    shared = times.shape[1] == 1
    sums, side = np.empty((joints, 4), np.float32), np.empty(joints, np.float32)
    shift, drift, way, before = np.empty(3), np.empty(3), np.empty(3), np.empty(64)
    for i in range(first, stop):
        n = columns[i]
        scale, last = scales[n], cuts.starts[n + 1]
        low = cuts.starts[n]
        for t in range(frames.shape[0]):
            frame = frames[t, i]
            if frame < 0:
                out_roots[t, i] = np.nan
                out_rotations[t, i] = np.nan
                continue
            time = times[t, 0 if shared else i]
            while low < last and cuts.times[low] <= time - reach:
                low += 1
            blended = low < last and cuts.times[low] < time + reach
            shift[:] = 0.0
            drift[:] = 0.0
            if blended:
                sums[:] = 0.0
                # How much of the pose stems from before each cut.
                high = low
                while high < last and cuts.times[high] < time + reach and high - low < before.shape[0]:
                    high += 1
                part = 1.0
                for cut in range(high - 1, low - 1, -1):
                    part *= _left(cuts, cut, time)
                    before[cut - low] = part
                # The cuts that are past count from the latest back, those to come from the next on, so that signs are
                # handed from motion to motion.
                middle = low
                while middle < high and (cuts.times[middle] - time) * rate <= 1e-9:
                    middle += 1
                side[:] = 1.0
                for cut in range(middle - 1, low - 1, -1):
                    _add_cut(
                        cut, True, before[cut - low], side, time, m, cuts, speeds[n], scale, sums, shift, drift, way
                    )
                    if cuts.signs[cut, joints]:
                        for j in range(joints):
                            side[j] *= cuts.signs[cut, j]
                side[:] = 1.0
                for cut in range(middle, high):
                    _add_cut(
                        cut,
                        False,
                        before[cut - low] - 1.0,
                        side,
                        time,
                        m,
                        cuts,
                        speeds[n],
                        scale,
                        sums,
                        shift,
                        drift,
                        way,
                    )
                    if cuts.signs[cut, joints]:
                        for j in range(joints):
                            side[j] *= cuts.signs[cut, j]
            fraction = fractions[t, i]
            pose, root = out_rotations[t, i], out_roots[t, i]
            _write_pose(frame, fraction, m.rotations, blended, sums, pose)
            if blended:
                for k in range(hinges.joints.shape[0]):
                    _unfold(hinges.bones[k], hinges.limits[k, 0], hinges.limits[k, 1], pose[hinges.joints[k]])
            rest = 1.0 - fraction
            low_root, high_root = m.roots[frame], m.roots[frame + 1 if fraction > 0.0 else frame]
            x = (low_root[0] * rest + high_root[0] * fraction) * scale + shift[0]
            y = (low_root[1] * rest + high_root[1] * fraction) * scale + shift[1]
            z = (low_root[2] * rest + high_root[2] * fraction) * scale + shift[2]
            heading = grounds[t, i, 2] + drift[2]
            cos, sin = math.cos(heading), math.sin(heading)
            root[0] = grounds[t, i, 0] + drift[0] + x * cos + z * sin
            root[1] = y
            root[2] = grounds[t, i, 1] + drift[1] - x * sin + z * cos
            c, s = math.cos(0.5 * heading), math.sin(0.5 * heading)
            w, a, b, d = pose[0, 0], pose[0, 1], pose[0, 2], pose[0, 3]
            pose[0, 0] = c * w - s * b
            pose[0, 1] = c * a + s * d
            pose[0, 2] = c * b + s * w
            pose[0, 3] = c * d - s * a

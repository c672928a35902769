"""Compiled poses: database frames, and the blends that carry them over the cuts between actions.

A cut at time c leaves motion a for motion b. With D the offset of a's pose from b's there and V that of their
velocities, ``d(t) = +-D/2 q0(s) + V/2 h q1(s)`` with ``s = |t - c| / h`` is laid over both, plus after the cut and
minus before. q0 and q1 are quintics with q0(0) = 1, q1'(0) = 1 and every other value and derivative up to the second
zero at both ends, so that pose and velocity are continuous and a blend has an end. Offsets of rotations are differences of
quaternions, so that blends of cuts near one another add up without a jump at either; what comes out is brought back to
unit length.
"""

import math

import numba as nb
import numpy as np


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def _add_cut(cut, past, side, time, half, cuts, sums, shift, drift):
    """Add what one cut lays over the pose at a time; ``side`` holds signs by which rotations differ there."""
    s = abs(time - cuts.times[cut]) / half
    s2 = s * s
    s3 = s2 * s
    place = 0.5 * (1.0 - s3 * (10.0 - 15.0 * s + 6.0 * s2))
    if not past:
        place = -place
    pace = 0.5 * half * (s - s3 * (6.0 - 8.0 * s + 3.0 * s2))
    for k in range(3):
        shift[k] += place * cuts.moves[cut, 0, k] + pace * cuts.moves[cut, 1, k]
        drift[k] += pace * cuts.drifts[cut, k]
    a, b = np.float32(place), np.float32(pace)
    turns, rates = cuts.turns[cut], cuts.rates[cut]
    for j in range(turns.shape[0]):
        for k in range(4):
            sums[j, k] += side[j] * (a * turns[j, k] + b * rates[j, k])


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def blend_poses(
    first, stop, columns, times, frames, fractions, grounds, m, cuts, rate, half, scales, out_roots, out_rotations
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
        half: Half the length of a blend [s].
        scales: Body size by column.
        out_roots: Place of the root in the world [m]. Shape (T, n, 3).
        out_rotations: Local rotations, the root's in the world. Shape (T, n, J, 4).
    """
    joints = m.rotations.shape[1]
    shared = times.shape[1] == 1
    sums, side = np.empty((joints, 4), np.float32), np.empty(joints, np.float32)
    shift, drift = np.empty(3), np.empty(3)
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
            while low < last and cuts.times[low] <= time - half:
                low += 1
            blended = low < last and cuts.times[low] < time + half
            shift[:] = 0.0
            drift[:] = 0.0
            if blended:
                sums[:] = 0.0
                # The cuts that are past count from the latest back, those to come from the next on, so that signs are
                # handed from motion to motion.
                middle = low
                while middle < last and (cuts.times[middle] - time) * rate <= 1e-9:
                    middle += 1
                side[:] = 1.0
                for cut in range(middle - 1, low - 1, -1):
                    if cuts.signs[cut, joints]:
                        for j in range(joints):
                            side[j] *= cuts.signs[cut, j]
                    _add_cut(cut, True, side, time, half, cuts, sums, shift, drift)
                side[:] = 1.0
                cut = middle
                while cut < last and cuts.times[cut] < time + half:
                    _add_cut(cut, False, side, time, half, cuts, sums, shift, drift)
                    if cuts.signs[cut, joints]:
                        for j in range(joints):
                            side[j] *= cuts.signs[cut, j]
                    cut += 1
            fraction = fractions[t, i]
            pose, root = out_rotations[t, i], out_roots[t, i]
            _write_pose(frame, fraction, m.rotations, blended, sums, pose)
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

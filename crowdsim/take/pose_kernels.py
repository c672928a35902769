"""Compiled poses: database frames, and the blends that carry them over the cuts between actions.

A cut at time c leaves motion a for motion b. With D the offset of a's pose from b's there, as rotation vectors joint by
joint, and V that of their velocities, ``d(t) = +-D/2 q0(s) + V/2 h q1(s)`` with ``s = |t - c| / h`` is laid over both,
plus after the cut and minus before. q0 and q1 are quintics with q0(0) = 1, q1'(0) = 1 and every other value and
derivative up to the second zero at both ends, so that pose and velocity are continuous and a blend has an end.
"""

import math

import numba as nb
import numpy as np


@nb.njit(cache=True)
def _log_between(a, b, out):
    """Rotation vector that takes quaternion a to b, in a's own frame: ``log(a^-1 b)``."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    y = a[0] * b[2] + a[1] * b[3] - a[2] * b[0] - a[3] * b[1]
    z = a[0] * b[3] - a[1] * b[2] + a[2] * b[1] - a[3] * b[0]
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 if sine < 1e-9 else 2.0 * math.atan2(sine, w) / sine
    out[0], out[1], out[2] = x * factor, y * factor, z * factor


@nb.njit(cache=True)
def measure_cuts(
    before, after, speed, scale, rate, rotations, roots, first, last, out_turns, out_turn_rates, out_moves
):
    """Offsets of position and velocity at cuts, old motion less new.

    Args:
        before: Playback frame that each cut leaves.
        after: Playback frame that it goes on from.
        speed: Motion seconds in a second of each cut's avatar.
        scale: Body size of each cut's avatar.
        rate: Playback frames a second.
        rotations: Database rotations, the root's without the heading. Shape (P, J, 4).
        roots: Place of the root in the frame's ground frame. Shape (P, 3).
        first: First playback frame of the clip of each frame in ``before`` and ``after``. Shape (C, 2).
        last: Likewise the last one. Shape (C, 2).
        out_turns: Offsets as rotation vectors in the new motion's frames [rad]. Shape (C, J, 3).
        out_turn_rates: Offsets of angular velocity [rad/s]. Shape (C, J, 3).
        out_moves: Offset of the root's place and of its velocity. Shape (C, 2, 3).
    """
    a, b, c = np.empty(3), np.empty(3), np.empty(3)
    for i in range(before.shape[0]):
        old, new = before[i], after[i]
        old_from, new_to = max(old - 1, first[i, 0]), min(new + 1, last[i, 1])
        old_to, new_from = old, new
        if old_from == old_to:
            old_to = min(old + 1, last[i, 0])
        if new_from == new_to:
            new_from = max(new - 1, first[i, 1])
        pace = rate * speed[i]
        for j in range(rotations.shape[1]):
            _log_between(rotations[new, j], rotations[old, j], a)
            _log_between(rotations[old_from, j], rotations[old_to, j], b)
            _log_between(rotations[new_from, j], rotations[new_to, j], c)
            for k in range(3):
                out_turns[i, j, k] = a[k]
                out_turn_rates[i, j, k] = (b[k] - c[k]) * pace
        for k in range(3):
            out_moves[i, 0, k] = (roots[old, k] - roots[new, k]) * scale[i]
            step = roots[old_to, k] - roots[old_from, k] - roots[new_to, k] + roots[new_from, k]
            out_moves[i, 1, k] = step * pace * scale[i]


@nb.njit(cache=True, nogil=True)
def _blend(frame, fraction, rotations, roots, starts, ends, time, cut_times, turns, turn_rates, moves, half, scale,
           sums, out_root, out_rotations):  # fmt: skip
    """One pose: a database frame between two, and the blends of the cuts ``starts`` to ``ends``."""
    joints = rotations.shape[1]
    for j in range(joints):
        sums[j, 0] = sums[j, 1] = sums[j, 2] = 0.0
    shift_x = shift_y = shift_z = 0.0
    blended = False
    for cut in range(starts, ends):
        apart = time - cut_times[cut]
        s = abs(apart) / half
        if s >= 1.0:
            continue
        blended = True
        s2 = s * s
        s3 = s2 * s
        q0 = 1.0 - s3 * (10.0 - 15.0 * s + 6.0 * s2)
        q1 = s - s3 * (6.0 - 8.0 * s + 3.0 * s2)
        place = 0.5 * q0 if apart >= 0.0 else -0.5 * q0
        pace = 0.5 * half * q1
        for j in range(joints):
            for k in range(3):
                sums[j, k] += place * turns[cut, j, k] + pace * turn_rates[cut, j, k]
        shift_x += place * moves[cut, 0, 0] + pace * moves[cut, 1, 0]
        shift_y += place * moves[cut, 0, 1] + pace * moves[cut, 1, 1]
        shift_z += place * moves[cut, 0, 2] + pace * moves[cut, 1, 2]
    rest = 1.0 - fraction
    here, there = rotations[frame], rotations[frame + 1 if fraction > 0.0 else frame]
    low, high = roots[frame], roots[frame + 1 if fraction > 0.0 else frame]
    out_root[0] = (low[0] * rest + high[0] * fraction) * scale + shift_x
    out_root[1] = (low[1] * rest + high[1] * fraction) * scale + shift_y
    out_root[2] = (low[2] * rest + high[2] * fraction) * scale + shift_z
    for j in range(joints):
        w = here[j, 0] * rest + there[j, 0] * fraction
        x = here[j, 1] * rest + there[j, 1] * fraction
        y = here[j, 2] * rest + there[j, 2] * fraction
        z = here[j, 3] * rest + there[j, 3] * fraction
        if blended:
            vx, vy, vz = sums[j, 0], sums[j, 1], sums[j, 2]
            angle = math.sqrt(vx * vx + vy * vy + vz * vz)
            factor = 0.5 - angle * angle / 48.0 if angle < 1e-2 else math.sin(0.5 * angle) / angle
            c, vx, vy, vz = math.cos(0.5 * angle), vx * factor, vy * factor, vz * factor
            w, x, y, z = (
                w * c - x * vx - y * vy - z * vz,
                w * vx + x * c + y * vz - z * vy,
                w * vy - x * vz + y * c + z * vx,
                w * vz + x * vy - y * vx + z * c,
            )
        norm = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        out_rotations[j, 0] = w * norm
        out_rotations[j, 1] = x * norm
        out_rotations[j, 2] = y * norm
        out_rotations[j, 3] = z * norm


@nb.njit(cache=True, nogil=True)
def blend_poses(first, stop, frames, fractions, grounds, times, rotations, roots, cut_starts, cut_stops, cut_times,
                turns, turn_rates, moves, half, scales, out_roots, out_rotations):  # fmt: skip
    """Poses of avatars ``first`` to ``stop`` at every time, in the world.

    Args:
        first: First column.
        stop: One past the last.
        frames: Playback frame of each column's avatar at each time; -1 where it is absent. Shape (T, N), int32.
        fractions: How far on to the next frame. Shape (T, N).
        grounds: Ground transform of each avatar at each time. Shape (T, N, 3).
        times: Shape (T, N) or (T, 1) [s].
        rotations: Database rotations, the root's without the heading. Shape (P, J, 4).
        roots: Place of the root in the frame's ground frame. Shape (P, 3).
        cut_starts: First cut of each column's avatar; they are in order of time. Shape (N,).
        cut_stops: One past its last cut. Shape (N,).
        cut_times: Shape (C,) [s].
        turns: See ``measure_cuts``.
        turn_rates: Likewise.
        moves: Likewise.
        half: Half the length of a blend [s].
        scales: Body size of each avatar. Shape (N,).
        out_roots: Place of the root in the world [m]. Shape (T, N, 3).
        out_rotations: Local rotations, the root's in the world. Shape (T, N, J, 4).
    """
    joints = rotations.shape[1]
    shared = times.shape[1] == 1
    sums = np.empty((joints, 3))
    for n in range(first, stop):
        low = cut_starts[n]
        for t in range(frames.shape[0]):
            if frames[t, n] < 0:
                for k in range(3):
                    out_roots[t, n, k] = np.nan
                out_rotations[t, n] = np.nan
                continue
            time = times[t, 0 if shared else n]
            while low < cut_stops[n] and cut_times[low] <= time - half:
                low += 1
            high = low
            while high < cut_stops[n] and cut_times[high] < time + half:
                high += 1
            root, pose = out_roots[t, n], out_rotations[t, n]
            _blend(frames[t, n], fractions[t, n], rotations, roots, low, high, time, cut_times, turns, turn_rates,
                   moves, half, scales[n], sums, root, pose)  # fmt: skip
            cos, sin = math.cos(grounds[t, n, 2]), math.sin(grounds[t, n, 2])
            x, z = root[0], root[2]
            root[0] = grounds[t, n, 0] + x * cos + z * sin
            root[2] = grounds[t, n, 1] - x * sin + z * cos
            c, s = math.cos(0.5 * grounds[t, n, 2]), math.sin(0.5 * grounds[t, n, 2])
            w, a, y, b = pose[0, 0], pose[0, 1], pose[0, 2], pose[0, 3]
            pose[0, 0] = c * w - s * y
            pose[0, 1] = c * a + s * b
            pose[0, 2] = c * y + s * w
            pose[0, 3] = c * b - s * a

"""Compiled poses: playback frames, and the blends that carry them over the transitions between actions.

A transition at time c leaves motion a for motion b, and W is a quintic step from 0 to 1 over a span around c. Both
motions play on in the capture, so with d = a - b, ``-W d`` is added to a before c and ``(1 - W) d`` to b after it:
pose, velocity and acceleration are continuous through the transition, and a blend has an end. Where blends overlap they
add up, each with what later ones leave of it, so that a pose is always a mean of captured ones. Offsets are linear:
differences of quaternions, normalised at the end, of positions, and of ground transforms.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import multiply, rotate, rotate_about_y
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import AFTER, BEFORE, COS, HEADING, LEG, SIN, TRUNK, X, Z

BLEND = 0.8
"""Length of a blend, half before its transition and half after it where no strike is near [s]; no side is longer."""
_COAST = 6.0
"""Playback frames over which motion comes to rest beyond its clip."""
_OVERLAPPING = 64
"""Most blends that may overlap."""


class Offsets(NamedTuple):
    """What blends add to a pose.

    Attributes:
        rotations: Differences of quaternions. Shape (J, 4), float32.
        signs: Signs by which quaternions differ on the side of a transition that is next. Shape (J,), float32.
        root: Offset of the root in the ground frame [m]. Shape (3,).
        ground: Offset of the ground transform. Shape (3,).
        travel: Room for a ground transform. Shape (3,).
    """

    rotations: NDArray[np.float32]
    signs: NDArray[np.float32]
    root: NDArray[np.float64]
    ground: NDArray[np.float64]
    travel: NDArray[np.float64]


@kernel
def _between(motion, start, steps):
    """Return a frame and the fraction to the next of motion that has played ``steps`` frames since another.

    Beyond its clip motion goes on straight for a while, and comes to rest.
    """
    first, last = motion.bounds[start, 0], motion.bounds[start, 1]
    frame = start + steps
    low = min(max(math.floor(frame), first), last - 1)
    part = frame - low
    if part > 1.0:
        part = 1.0 + _COAST * math.tanh((part - 1.0) / _COAST)
    elif part < 0.0:
        part = _COAST * math.tanh(part / _COAST)
    return low, part


@kernel
def _travel(motion, start, low, part, scale, direction, out):
    """Write how far motion has gone since a frame, in the world; ``direction`` is that of its clip."""
    rest = 1.0 - part
    here, there, old = motion.ground[low], motion.ground[low + 1], motion.ground[start]
    dx = here[X] * rest + there[X] * part - old[X]
    dz = here[Z] * rest + there[Z] * part - old[Z]
    cos, sin = direction[COS] * scale, direction[SIN] * scale
    out[X], out[Z] = dx * cos + dz * sin, dz * cos - dx * sin
    out[HEADING] = here[HEADING] * rest + there[HEADING] * part - old[HEADING]


@kernel
def _remaining(transitions, k, time):
    """Return how much is left of the motion before a transition: 1 before the blend, 0 after it."""
    ahead, behind = transitions.spans[k, BEFORE], transitions.spans[k, AFTER]
    return 1.0 - minimum_jerk((time - transitions.times[k] + ahead) / (ahead + behind))


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _add_transition(k, past, share, time, motion, transitions, speed, sizes, offsets):
    """Add a share of what differs at a transition."""
    apart, scale, lift = time - transitions.times[k], sizes[TRUNK], sizes[LEG] - sizes[TRUNK]
    if share == 0.0:
        return
    steps = apart * speed * motion.rate
    old, on = _between(motion, transitions.before[k], steps)
    new, off = _between(motion, transitions.after[k], steps)
    root, ground, travel = offsets.root, offsets.ground, offsets.travel
    for c in range(3):
        there = motion.roots[old, c] + (motion.roots[old + 1, c] - motion.roots[old, c]) * on
        here = motion.roots[new, c] + (motion.roots[new + 1, c] - motion.roots[new, c]) * off
        root[c] += share * scale * (there - here)
    if lift != 0.0:
        there = motion.reaches[old] + (motion.reaches[old + 1] - motion.reaches[old]) * on
        here = motion.reaches[new] + (motion.reaches[new + 1] - motion.reaches[new]) * off
        root[1] += share * lift * (there - here)
    shift = transitions.shifts[k]
    left = transitions.ground[k, HEADING] - shift[HEADING]
    cos, sin = math.cos(left) * scale, math.sin(left) * scale
    ground[X] -= share * (shift[X] * cos + shift[Z] * sin)
    ground[Z] -= share * (shift[Z] * cos - shift[X] * sin)
    ground[HEADING] -= share * shift[HEADING]
    _travel(motion, transitions.before[k], old, on, scale, transitions.directions[k, BEFORE], travel)
    for c in range(3):
        ground[c] += share * travel[c]
    _travel(motion, transitions.after[k], new, off, scale, transitions.directions[k, AFTER], travel)
    for c in range(3):
        ground[c] -= share * travel[c]
    a, b = np.float32(share * (1.0 - on)), np.float32(share * on)
    c, d = np.float32(share * (1.0 - off)), np.float32(share * off)
    rotations, sums, signs = motion.rotations, offsets.rotations, offsets.signs
    for j in range(sums.shape[0]):
        # The old motion's signs are the given ones before the transition, the new one's those after it.
        one, other = signs[j], signs[j]
        if past:
            one *= np.float32(transitions.signs[k, j])
        else:
            other *= np.float32(transitions.signs[k, j])
        for i in range(4):
            sums[j, i] += one * (a * rotations[old, j, i] + b * rotations[old + 1, j, i]) - other * (
                c * rotations[new, j, i] + d * rotations[new + 1, j, i]
            )


@kernel(fastmath={"contract", "reassoc", "nsz"})
def _write_rotations(frame, fraction, rotations, blended, sums, out):
    """Write the rotations of a playback frame, or of one between two, with offsets added."""
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
    u, o = bones[0], bones[1]
    vx, vy, vz = rotate(q, o[0], o[1], o[2])
    nx, ny, nz = u[1] * vz - u[2] * vy, u[2] * vx - u[0] * vz, u[0] * vy - u[1] * vx
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    flexion = math.atan2(size, u[0] * vx + u[1] * vy + u[2] * vz)
    if flexion <= free or size < 1e-9:
        return
    room = most - free
    half = 0.5 * (free + room * math.tanh((flexion - free) / room) - flexion)
    c, s = math.cos(half), math.sin(half) / size
    q[0], q[1], q[2], q[3] = multiply((c, s * nx, s * ny, s * nz), q)


@kernel
def _flip_signs(signs, offsets):
    """Hand signs on to the motion on the other side of a transition."""
    joints = offsets.signs.shape[0]
    if signs[joints]:
        for j in range(joints):
            offsets.signs[j] *= signs[j]


@kernel(inline=True)
def _add_transitions(low, last, time, motion, transitions, rows, n, remaining, offsets):
    """Add what differs at all transitions from ``low`` on whose blends a time lies in."""
    offsets.rotations[:] = 0.0
    # How much of the pose stems from before each transition.
    high = low
    while high < last and transitions.times[high] < time + BLEND and high - low < remaining.shape[0]:
        high += 1
    part = 1.0
    for k in range(high - 1, low - 1, -1):
        part *= _remaining(transitions, k, time)
        remaining[k - low] = part
    # Past transitions count from the latest back, those to come from the next on, so that signs are handed from motion
    # to motion.
    middle = low
    while middle < high and (transitions.times[middle] - time) * rows.rate <= 1e-9:
        middle += 1
    speed, sizes = rows.speeds[n], rows.sizes[n]
    offsets.signs[:] = 1.0
    for k in range(middle - 1, low - 1, -1):
        _add_transition(k, True, remaining[k - low], time, motion, transitions, speed, sizes, offsets)
        _flip_signs(transitions.signs[k], offsets)
    offsets.signs[:] = 1.0
    for k in range(middle, high):
        _add_transition(k, False, remaining[k - low] - 1.0, time, motion, transitions, speed, sizes, offsets)
        _flip_signs(transitions.signs[k], offsets)


@kernel(inline=True)
def _write_root(motion, frame, fraction, sizes, ground, offsets, pose, root):
    """Write the position of the root in the world, and turn its rotation into the world.

    It is as much higher as the leg that the body rests on is longer than captured.
    """
    rest, scale, lift = 1.0 - fraction, sizes[TRUNK], sizes[LEG] - sizes[TRUNK]
    following = frame + 1 if fraction > 0.0 else frame
    low, high = motion.roots[frame], motion.roots[following]
    shift, drift = offsets.root, offsets.ground
    x = (low[0] * rest + high[0] * fraction) * scale + shift[0]
    y = (low[1] * rest + high[1] * fraction) * scale + shift[1]
    z = (low[2] * rest + high[2] * fraction) * scale + shift[2]
    if lift != 0.0:
        y += lift * (motion.reaches[frame] * rest + motion.reaches[following] * fraction)
    heading = ground[HEADING] + drift[HEADING]
    cos, sin = math.cos(heading), math.sin(heading)
    root[0] = ground[X] + drift[X] + x * cos + z * sin
    root[1] = y
    root[2] = ground[Z] + drift[Z] - x * sin + z * cos
    c, s = math.cos(0.5 * heading), math.sin(0.5 * heading)
    q = pose[0]
    q[0], q[1], q[2], q[3] = rotate_about_y(c, s, q)


@kernel(allocates=True)
def blend_poses(first, stop, moments, playback, rows, motion, transitions, hinges, poses):
    """Write poses in the world, blended over transitions.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        playback: Where they are then, a ``Playback``.
        rows: The control frames, a ``Rows``.
        motion: The playback frames, a ``motion.Frames``.
        transitions: A ``Transitions``.
        hinges: A ``motion.Hinges``.
        poses: Written, a ``Posed``; NaN while absent.
    """
    joints, times = motion.rotations.shape[1], moments.times
    shared = times.shape[1] == 1
    sums, signs = np.empty((joints, 4), np.float32), np.empty(joints, np.float32)
    offsets = Offsets(sums, signs, np.empty(3), np.empty(3), np.empty(3))
    remaining = np.empty(_OVERLAPPING)
    for i in range(first, stop):
        n = moments.columns[i]
        low, last = transitions.starts[n], transitions.starts[n + 1]
        for t in range(playback.frames.shape[0]):
            frame = playback.frames[t, i]
            if frame < 0:
                poses.roots[t, i] = np.nan
                poses.rotations[t, i] = np.nan
                continue
            time = times[t, 0 if shared else i]
            while low < last and transitions.times[low] <= time - BLEND:
                low += 1
            blended = low < last and transitions.times[low] < time + BLEND
            offsets.root[:] = 0.0
            offsets.ground[:] = 0.0
            if blended:
                _add_transitions(low, last, time, motion, transitions, rows, n, remaining, offsets)
            fraction, pose = playback.fractions[t, i], poses.rotations[t, i]
            _write_rotations(frame, fraction, motion.rotations, blended, sums, pose)
            if blended:
                for k in range(hinges.joints.shape[0]):
                    _unfold(hinges.bones[k], hinges.limits[k, 0], hinges.limits[k, 1], pose[hinges.joints[k]])
            _write_root(motion, frame, fraction, rows.sizes[n], playback.ground[t, i], offsets, pose, poses.roots[t, i])

"""Compiled measurement of how motion jumps at transitions."""

import math

import numpy as np

from crowdsim.core.quaternions import conjugate, from_vector, relative, rotate_about_y
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import (
    AFTER,
    BEFORE,
    COS,
    FOOT_X,
    FOOT_Y,
    FOOT_Z,
    GAP_COLUMNS,
    GAP_X,
    GAP_Y,
    GAP_Z,
    HEADING,
    SIN,
    TOES_X,
    TOES_Y,
    TOES_Z,
    X,
    Z,
)
from crowdsim.poses.kernels.placement import place_at


@kernel
def _doubles(q):
    """Return a quaternion in double precision."""
    return np.float64(q[0]), np.float64(q[1]), np.float64(q[2]), np.float64(q[3])


@kernel
def _write_rotation_vector(old, new, out):
    """Write the rotation vector that leads from one quaternion to another."""
    w, x, y, z = relative(old, new)
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    size = math.sqrt(x * x + y * y + z * z)
    share = 2.0 * math.atan2(size, w) / size if size > 1e-9 else 2.0
    out[0], out[1], out[2] = x * share, y * share, z * share


@kernel
def _write_swing_and_twist(old, new, out):
    """Write the level rotation vector, with the angle about +y that follows it as y, that lead from one to another."""
    w, x, y, z = relative(old, new)
    half = math.atan2(y, w)
    if abs(half) > 0.5 * math.pi:
        half -= math.copysign(math.pi, half)
    cos, sin = math.cos(half), math.sin(-half)
    _write_rotation_vector((1.0, 0.0, 0.0, 0.0), rotate_about_y(cos, sin, (w, x, y, z)), out)
    out[1] = 2.0 * half


@kernel
def _rotate_about_y(heading, vector):
    """Rotate a vector about +y, in place."""
    cos, sin = math.cos(heading), math.sin(heading)
    x, z = vector[0], vector[2]
    vector[0], vector[2] = x * cos + z * sin, z * cos - x * sin


@kernel
def cross_gap(share, tilt, swing, twist):
    """Return a share of a gap: of the rotation ``swing``, a vector, and then of the one about +y, ``twist``."""
    q = from_vector(tilt * swing[0], tilt * swing[1], tilt * swing[2])
    if twist == 0.0 or share == 0.0:
        return q
    return rotate_about_y(math.cos(0.5 * share * twist), math.sin(0.5 * share * twist), q)


@kernel
def _write_returns(gap, returns):
    """Write the rotations of a foot, and of its toes on it, back over a gap."""
    foot = cross_gap(1.0, 1.0, (gap[FOOT_X], 0.0, gap[FOOT_Z]), gap[FOOT_Y])
    toes = cross_gap(1.0, 1.0, (gap[TOES_X], gap[TOES_Y], gap[TOES_Z]), 0.0)
    for k, q in enumerate((foot, toes)):
        returns[k, 0], returns[k, 1], returns[k, 2], returns[k, 3] = conjugate(q)


@kernel
def measure_gaps(transition, transitions, motion, toes, scale, steps):
    """Write how far held points of the feet jump, and by which rotations feet jump and toes on them."""
    old, new = transitions.before[transition], transitions.after[transition]
    shift = transitions.shifts[transition]
    heading = transitions.ground[transition, HEADING]
    cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
    # The motion before is seen from the ground transform of the motion after.
    away = shift[HEADING]
    cos_away, sin_away = math.cos(away), math.sin(away)
    cos_half, sin_half = math.cos(0.5 * away), math.sin(-0.5 * away)
    for foot in range(2):
        gap = steps.gaps[transition, foot]
        here, there = motion.holds[old, foot], motion.holds[new, foot]
        x, z = here[0] - shift[X], here[2] - shift[Z]
        dx = there[0] - (x * cos_away - z * sin_away)
        dz = there[2] - (x * sin_away + z * cos_away)
        gap[GAP_X] = dx * cos + dz * sin
        gap[GAP_Y] = (np.float64(there[1]) - here[1]) * scale
        gap[GAP_Z] = dz * cos - dx * sin
        turned = rotate_about_y(cos_half, sin_half, motion.feet[old, foot])
        _write_swing_and_twist(turned, _doubles(motion.feet[new, foot]), gap[FOOT_X:TOES_X])
        _rotate_about_y(heading, gap[FOOT_X:TOES_X])
        gap[TOES_X:GAP_COLUMNS] = 0.0
        toe = toes[foot]
        if toe >= 0:
            before, after = _doubles(motion.rotations[old, toe]), _doubles(motion.rotations[new, toe])
            _write_rotation_vector(before, after, gap[TOES_X:GAP_COLUMNS])
        _write_returns(gap, steps.returns[transition, foot])


@kernel
def _compare_signs(before, after, signs):
    """Write for each joint whether its quaternion goes on with the other sign, and whether any does."""
    joints = before.shape[0]
    signs[joints] = 0
    for j in range(joints):
        dot = np.float32(0.0)
        for k in range(4):
            dot += before[j, k] * after[j, k]
        signs[j] = -1 if dot < 0.0 else 1
        if dot < 0.0:
            signs[joints] = 1


@kernel
def measure_transitions(first, stop, rows, motion, transitions):
    """Measure how motion jumps at transitions ``first`` to ``stop``.

    Args:
        first: First transition.
        stop: One past the last.
        rows: The control frames, a ``Rows``.
        motion: The playback frames, a ``motion.Frames``.
        transitions: A ``Transitions``; signs, ground and directions are written.
    """
    for i in range(first, stop):
        n, old, new = transitions.owners[i], transitions.before[i], transitions.after[i]
        _, _, placed = place_at(rows, motion, transitions.times[i], n)
        ground = transitions.ground[i]
        ground[X], ground[Z], ground[HEADING] = placed
        heading, away = placed[HEADING], transitions.shifts[i, HEADING]
        left, on = heading - away - motion.ground[old, HEADING], heading - motion.ground[new, HEADING]
        directions = transitions.directions[i]
        directions[BEFORE, COS], directions[BEFORE, SIN] = math.cos(left), math.sin(left)
        directions[AFTER, COS], directions[AFTER, SIN] = math.cos(on), math.sin(on)
        _compare_signs(motion.rotations[old], motion.rotations[new], transitions.signs[i])

"""Compiled separation of bodies, arms left out, that lean or go into one another."""

import math

import numpy as np

from crowdsim.core.segments import nearest_on_segments
from crowdsim.jit import kernel
from crowdsim.poses.kernels.splines import spline_at

NEAR = 1.6
"""Distance on the ground beyond which no two bodies meet [m]."""
_FAR = 1.3
"""Distance on the ground of the middles of two bodies beyond which they do not meet [m]."""
_ROOM, _SOFT = 0.01, 0.02
"""Room that surfaces are given, and how far on either side of that they begin to give way [m]."""
_GIVES = _ROOM + _SOFT
"""Distance of surfaces from which bodies give way [m]."""
_CLEAR = _GIVES + 0.001
"""Distance of surfaces from which bodies do not give way, and a little [m]."""
_MOST = 0.3
"""Furthest that a body gives way [m]."""
_ROUNDS = 6
"""How often bodies are pushed on that are still in one another."""
AROUND = 8
"""How many times before and after a time, two a control frame, bodies are looked for where they are nearest: one that
passes through another one goes around it on one side, not back and then forward."""
_STEEP = 0.35
"""Least cosine of the angle between that way and the way between the bodies that counts: pushes set in gently."""
_LEFT = 0.01
"""Depth of legs that is left to knees and feet, which go around [m]."""
HEAD_POINT, NECK_POINT, PELVIS_POINT, LEG_POINT, SHOULDER_POINT, POINTS = 0, 1, 2, 3, 9, 11
"""Points of a body: head, neck, pelvis, hip, knee and ankle of either leg, and both ends of the shoulders."""
PIECES = (
    (HEAD_POINT, HEAD_POINT), (NECK_POINT, PELVIS_POINT), (9, 10), (3, 4), (6, 7), (4, 5), (7, 8)
)  # fmt: skip
"""Capsules of a body, by the points at both ends: head, trunk, shoulders, both thighs and both shins."""
_PIECES, _LEGS = np.array(PIECES), 3
"""These, and the first one that is part of a leg."""


@kernel(inline=True)
def _are_apart(p, q, r, s, least):
    """Whether two segments are further apart along one of the axes of the world than a distance."""
    return (
        max(min(p[0], q[0]) - max(r[0], s[0]), min(r[0], s[0]) - max(p[0], q[0])) > least
        or max(min(p[2], q[2]) - max(r[2], s[2]), min(r[2], s[2]) - max(p[2], q[2])) > least
        or max(min(p[1], q[1]) - max(r[1], s[1]), min(r[1], s[1]) - max(p[1], q[1])) > least
    )


@kernel
def _overlap(own, other, radii, others, x, z):
    """Return how deep a body is in another one that is moved over the ground [m]; negative where they are apart.

    Where that is further than bodies give way from, it is not said how far.
    """
    deepest = -math.inf
    for i in range(len(PIECES)):
        p, q = own[_PIECES[i, 0]], own[_PIECES[i, 1]]
        for j in range(len(PIECES)):
            start, end = other[_PIECES[j, 0]], other[_PIECES[j, 1]]
            r, s = (start[0] + x, start[1], start[2] + z), (end[0] + x, end[1], end[2] + z)
            widest = max(radii[i, 0], radii[i, 1]) + max(others[j, 0], others[j, 1])
            if _are_apart(p, q, r, s, widest + _CLEAR):
                continue
            share, part, far = nearest_on_segments(p, q, r, s)
            depth = radii[i, 0] + share * (radii[i, 1] - radii[i, 0]) - far
            depth += others[j, 0] + part * (others[j, 1] - others[j, 0])
            deepest = max(deepest, depth - _LEFT if i >= _LEGS or j >= _LEGS else depth)
    return deepest


@kernel(inline=True)
def _between(own, other):
    """Return the way over the ground between the middles of two bodies."""
    return (
        0.5 * (own[HEAD_POINT, 0] + own[PELVIS_POINT, 0] - other[HEAD_POINT, 0] - other[PELVIS_POINT, 0]),
        0.5 * (own[HEAD_POINT, 2] + own[PELVIS_POINT, 2] - other[HEAD_POINT, 2] - other[PELVIS_POINT, 2]),
    )


@kernel
def _are_beside(own, other, radii, others, x, z):
    """Return whether bodies do not reach each other along the way between them, of length 1."""
    low, high = math.inf, -math.inf
    for i in range(len(PIECES)):
        for k in range(2):
            p, q = own[_PIECES[i, k]], other[_PIECES[i, k]]
            low = min(low, p[0] * x + p[2] * z - radii[i, k])
            high = max(high, q[0] * x + q[2] * z + others[i, k])
    return low - high > _CLEAR


@kernel
def _depth(own, other, radii, others):
    """Return how deep a body is in another one [m]; less than ``-_GIVES`` where they are apart."""
    x, z = _between(own, other)
    far = math.sqrt(x * x + z * z)
    if far > _FAR or (far > 0.1 and _are_beside(own, other, radii, others, x / far, z / far)):
        return -math.inf
    return _overlap(own, other, radii, others, 0.0, 0.0)


@kernel
def _way_around(points, t, a, b, around):
    """Return the way between two bodies, of length 1, where they are nearest within so many times of a time."""
    least, x, z = math.inf, 0.0, 0.0
    for at in range(max(t - around, 0), min(t + around, points.shape[0] - 1)):
        px, pz = _between(points[at, a], points[at, b])
        qx, qz = _between(points[at + 1, a], points[at + 1, b])
        ux, uz = qx - px, qz - pz
        square = ux * ux + uz * uz
        if not math.isfinite(square):
            continue
        share = min(max(-(px * ux + pz * uz) / max(square, 1e-12), 0.0), 1.0)
        nx, nz = px + share * ux, pz + share * uz
        far = math.sqrt(nx * nx + nz * nz)
        if far < 1e-4:
            # Straight through the middle they may as well go to the right.
            nx, nz = uz, -ux
        size = math.sqrt(nx * nx + nz * nz)
        if far < least and size > 1e-9:
            least, x, z = far, nx / size, nz / size
    return x, z


@kernel
def _push_pair(points, radii, t, a, b, around, pushes):
    """Add what two bodies push each other away."""
    own, other = points[t, a], points[t, b]
    depth = _depth(own, other, radii[a], radii[b])
    if depth <= -_GIVES:
        return
    x, z = _between(own, other)
    far = math.sqrt(x * x + z * z)
    nx, nz = _way_around(points, t, a, b, around)
    if far < 1e-6 and nx == 0.0 and nz == 0.0:
        return
    if nx == 0.0 and nz == 0.0:
        nx, nz = x / far, z / far
    deep = depth + _ROOM
    apart = far + (deep if deep >= _SOFT else (deep + _SOFT) ** 2 / (4.0 * _SOFT))
    # As far along that way as brings the middles so far apart as they would be without the depth.
    along = max(x * nx + z * nz, _STEEP * far)
    push = 0.5 * (math.sqrt(max(apart * apart - far * far + along * along, 0.0)) - along)
    # Of bodies that are not round this may be too little.
    for _ in range(_ROUNDS):
        rest = _overlap(own, other, radii[a], radii[b], -2.0 * push * nx, -2.0 * push * nz) + _ROOM
        if rest <= 0.0:
            break
        push += 0.5 * rest
    pushes[a, 0] += push * nx
    pushes[a, 1] += push * nz
    pushes[b, 0] -= push * nx
    pushes[b, 1] -= push * nz


@kernel(inline=True)
def _note_places(points, t, order, xs, zs):
    """Write where the pelvises of avatars are on the ground at a time, in an order."""
    for n in range(len(order)):
        pelvis = points[t, order[n], PELVIS_POINT]
        xs[n], zs[n] = pelvis[0], pelvis[2]


@kernel(allocates=True)
def find_touching(first, stop, points, radii, order, touching):
    """Find which bodies are, at any of T times, in another one, or so near that they give way.

    Args:
        first: First of the times.
        stop: One past the last.
        points: The ``POINTS`` of each avatar, NaN while absent [m]. Shape (T, N, 11, 3).
        radii: Radii of its ``PIECES`` at both ends [m]. Shape (N, 7, 2).
        order: The avatars by x of the pelvis, absent ones last. Shape (T, N).
        touching: True is written for these; bodies that are known are not compared again. Shape (N,), bool.
    """
    count = order.shape[1]
    xs, zs = np.empty(count, np.float32), np.empty(count, np.float32)
    for t in range(first, stop):
        _note_places(points, t, order[t], xs, zs)
        for i in range(count):
            if not math.isfinite(xs[i]):
                break
            for j in range(i + 1, count):
                # Absent ones are not a number, and end the search too.
                if not xs[j] - xs[i] < NEAR:
                    break
                a, b = order[t, i], order[t, j]
                if not abs(zs[j] - zs[i]) < NEAR or (touching[a] and touching[b]):
                    continue
                if _depth(points[t, a], points[t, b], radii[a], radii[b]) > -_GIVES:
                    touching[a] = touching[b] = True


@kernel(allocates=True)
def push_trunks(first, stop, points, radii, order, times, around, pushes):
    """Find how far bodies are pushed out of one another, at R of T times.

    Args:
        first: First of these times.
        stop: One past the last.
        points: The ``POINTS`` of each avatar, NaN while absent [m]. Shape (T, N, 11, 3).
        radii: Radii of its ``PIECES`` at both ends [m]. Shape (N, 7, 2).
        order: The avatars by x of the pelvis, absent ones last. Shape (R, N).
        times: Which times these are. Shape (R,).
        around: Within how many times of each the way around another body is found, see ``AROUND``.
        pushes: Written: x and z [m]. Shape (R, N, 2).
    """
    count = order.shape[1]
    xs, zs = np.empty(count, np.float32), np.empty(count, np.float32)
    for row in range(first, stop):
        t, own, found = times[row], order[row], pushes[row]
        _note_places(points, t, own, xs, zs)
        for n in range(count):
            found[n, 0] = found[n, 1] = 0.0
        for i in range(count):
            if not math.isfinite(xs[i]):
                break
            for j in range(i + 1, count):
                # Absent ones are not a number, and end the search too.
                if not xs[j] - xs[i] < NEAR:
                    break
                if abs(zs[j] - zs[i]) < NEAR:
                    _push_pair(points, radii, t, own[i], own[j], around, found)
        for n in range(count):
            far = math.sqrt(found[n, 0] ** 2 + found[n, 1] ** 2)
            if far > 0.0:
                kept = _MOST * math.tanh(far / _MOST) / far
                found[n, 0] *= kept
                found[n, 1] *= kept


@kernel
def shift_roots(first, stop, moments, pushes, poses):
    """Move whole poses as far as their trunks give way, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        pushes: How far trunks give way, x and z [m], an ``Offsets``.
        poses: Roots are moved, a ``Posed``.
    """
    times = moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            x, z = spline_at(pushes, times[t, 0 if shared else i], moments.columns[i])
            poses.roots[t, i, 0] += x
            poses.roots[t, i, 2] += z

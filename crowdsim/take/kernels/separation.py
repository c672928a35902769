"""Compiled separation of trunks, heads and thighs that lean or go into one another."""

import math

from crowdsim.jit import kernel
from crowdsim.take.kernels.segments import nearest_on_segments
from crowdsim.take.kernels.splines import spline_at

NEAR = 1.6
"""Distance on the ground beyond which no two trunks or heads meet [m]."""
_ROOM, _SOFT = 0.01, 0.02
"""Room that surfaces are given, and how far on either side of that they begin to give way [m]."""
_MOST = 0.14
"""Furthest that a trunk gives way [m]."""
AROUND = 4
"""How many frames before and after a time bodies are looked for where they are nearest: who passes through another one
goes around it on one side, not back and then forward."""
_STEEP = 0.35
"""Least cosine of the angle between that way and the way between the bodies that counts: pushes set in gently."""
_LEFT = 0.03
"""Depth of thighs in one another that is left to knees and feet, which go around [m]."""
HEAD_POINT, NECK_POINT, PELVIS_POINT, HIP_POINT, POINTS = 0, 1, 2, 3, 7
"""Rows of the points of a body; from ``HIP_POINT`` on hip and knee of either leg."""


@kernel(allocates=False)
def _overlap_of_thighs(own, other, radii, others):
    """Return how deep thighs of two bodies are in one another [m]; negative where they are apart."""
    nearest = math.inf
    for i in range(HIP_POINT, POINTS, 2):
        for j in range(HIP_POINT, POINTS, 2):
            nearest = min(nearest, nearest_on_segments(own[i], own[i + 1], other[j], other[j + 1])[2])
    return radii[2] + others[2] - nearest


@kernel(allocates=False)
def _overlap(own, other, radii, others):
    """Return how deep heads, trunks and thighs of two bodies are in one another [m]; negative where they are apart."""
    neck, pelvis, head = own[NECK_POINT], own[PELVIS_POINT], own[HEAD_POINT]
    neck_2, pelvis_2, head_2 = other[NECK_POINT], other[PELVIS_POINT], other[HEAD_POINT]
    trunks = radii[1] + others[1] - nearest_on_segments(neck, pelvis, neck_2, pelvis_2)[2]
    heads = radii[0] + others[0] - nearest_on_segments(head, head, head_2, head_2)[2]
    one = radii[0] + others[1] - nearest_on_segments(head, head, neck_2, pelvis_2)[2]
    two = radii[1] + others[0] - nearest_on_segments(neck, pelvis, head_2, head_2)[2]
    return max(max(max(trunks, heads), max(one, two)), _overlap_of_thighs(own, other, radii, others) - _LEFT)


@kernel(inline=True)
def _between(own, other):
    """Return the way over the ground between the middles of two bodies."""
    return (
        0.5 * (own[HEAD_POINT, 0] + own[PELVIS_POINT, 0] - other[HEAD_POINT, 0] - other[PELVIS_POINT, 0]),
        0.5 * (own[HEAD_POINT, 2] + own[PELVIS_POINT, 2] - other[HEAD_POINT, 2] - other[PELVIS_POINT, 2]),
    )


@kernel(allocates=False)
def _way_around(points, t, a, b):
    """Return the way between two bodies, of length 1, where they are nearest within ``AROUND`` frames of a time."""
    least, x, z = math.inf, 0.0, 0.0
    for at in range(max(t - AROUND, 0), min(t + AROUND, points.shape[0] - 1)):
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


@kernel(allocates=False)
def _push_pair(points, radii, t, a, b, pushes):
    """Add what two bodies push each other away."""
    own, other = points[t, a], points[t, b]
    depth = _overlap(own, other, radii[a], radii[b])
    if depth <= -_ROOM - _SOFT:
        return
    x, z = _between(own, other)
    far = math.sqrt(x * x + z * z)
    nx, nz = _way_around(points, t, a, b)
    if far < 1e-6 and nx == 0.0 and nz == 0.0:
        return
    if nx == 0.0 and nz == 0.0:
        nx, nz = x / far, z / far
    deep = depth + _ROOM
    apart = far + (deep if deep >= _SOFT else (deep + _SOFT) ** 2 / (4.0 * _SOFT))
    # As far along that way as brings the middles so far apart as they would be without the depth.
    along = max(x * nx + z * nz, _STEEP * far)
    push = 0.5 * (math.sqrt(max(apart * apart - far * far + along * along, 0.0)) - along)
    pushes[a, 0] += push * nx
    pushes[a, 1] += push * nz
    pushes[b, 0] -= push * nx
    pushes[b, 1] -= push * nz


@kernel(allocates=False)
def push_trunks(points, radii, order, pushes):
    """Find how far bodies are pushed out of one another, at each of T times.

    Args:
        points: Middle of the head, upper and lower end of the trunk, hip and knee of either leg of each avatar, NaN
            while absent [m]. Shape (T, N, 7, 3).
        radii: Radius of its head, of its trunk and of its thighs [m]. Shape (N, 3).
        order: The avatars by x of the pelvis, absent ones last. Shape (T, N).
        pushes: Written: x and z [m]. Shape (T, N, 2).
    """
    count = order.shape[1]
    for t in range(points.shape[0]):
        for n in range(count):
            pushes[t, n, 0] = pushes[t, n, 1] = 0.0
        for i in range(count):
            a = order[t, i]
            x, z = points[t, a, PELVIS_POINT, 0], points[t, a, PELVIS_POINT, 2]
            if not math.isfinite(x):
                break
            for j in range(i + 1, count):
                b = order[t, j]
                # Absent ones are not a number, and end the search too.
                if not points[t, b, PELVIS_POINT, 0] - x < NEAR:
                    break
                if abs(points[t, b, PELVIS_POINT, 2] - z) < NEAR:
                    _push_pair(points, radii, t, a, b, pushes[t])
        for n in range(count):
            far = math.sqrt(pushes[t, n, 0] ** 2 + pushes[t, n, 1] ** 2)
            if far > 0.0:
                kept = _MOST * math.tanh(far / _MOST) / far
                pushes[t, n, 0] *= kept
                pushes[t, n, 1] *= kept


@kernel(allocates=False)
def shift_roots(first, stop, moments, rows, poses):
    """Move whole poses as far as their trunks give way, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        rows: The control frames, a ``Rows``.
        poses: Roots are moved, a ``Posed``.
    """
    times = moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            x, z = spline_at(rows.pushes, rows, times[t, 0 if shared else i], moments.columns[i])
            poses.roots[t, i, 0] += x
            poses.roots[t, i, 2] += z

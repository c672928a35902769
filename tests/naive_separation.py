"""Slow, obvious twins of the separation of trunks."""

import itertools
import math

import numpy as np

from crowdsim.motion import quaternion
from crowdsim.poses.capsules import trunk_capsules


def distance_to_point(p, q, point):
    """Least distance of a point from the segment p q."""
    way = _way(p, q)
    squared = _dot(way, way)
    share = min(max(_dot(way, _way(p, point)) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return math.dist(_along(p, way, share), point)


def distance(p, q, r, s):
    """Least distance of the segments p q and r s."""
    share, part = nearest(p, q, r, s)
    return math.dist(_along(p, _way(p, q), share), _along(r, _way(r, s), part))


def _way(p, q):
    return q[0] - p[0], q[1] - p[1], q[2] - p[2]


def _along(p, way, share):
    return p[0] + share * way[0], p[1] + share * way[1], p[2] + share * way[2]


def _dot(one, other):
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def nearest(p, q, r, s):
    """Shares of the ways along the segments p q and r s at which these are nearest to one another, in plain numbers."""
    p, q, r, s = (np.asarray(point, dtype=float).tolist() for point in (p, q, r, s))
    u, v, w = _way(p, q), _way(r, s), _way(r, p)

    def along(start, way, point):
        return min(max(_dot(way, _way(start, point)) / _dot(way, way), 0.0), 1.0) if _dot(way, way) > 0.0 else 0.0

    found = [(end, along(r, v, _along(p, u, end))) for end in (0.0, 1.0)]
    found += [(along(p, u, _along(r, v, end)), end) for end in (0.0, 1.0)]
    a, b, c, d, e = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, w), _dot(v, w)
    if (square := a * c - b * b) > 1e-12 * a * c:
        shares = (b * e - c * d) / square, (a * e - b * d) / square
        if min(shares) >= 0.0 and max(shares) <= 1.0:
            found.append(shares)
    return min(found, key=lambda shares: math.dist(_along(p, u, shares[0]), _along(r, v, shares[1])))


def body_points(motion, positions, rotations, scales):
    """Head, neck, pelvis, joints of legs and ends of shoulders of bodies with joints (T, n, J, 3) and (T, n, J, 4)."""
    body, legs, sizes = motion.body, motion.legs.joints.reshape(-1), scales[:, None]
    head, chest, across = body.roles["head"], body.roles["chest"], trunk_capsules(body)[-1]
    found = [positions[:, :, head] + sizes * quaternion.rotate(rotations[:, :, head], body.head_offset)]
    found += [positions[:, :, joint].astype(float) for joint in (body.roles["neck"], body.roles["pelvis"], *legs)]
    for end in (body.capsule_starts[across], body.capsule_ends[across]):
        found.append(positions[:, :, chest] + sizes * quaternion.rotate(rotations[:, :, chest], end))
    return np.stack(found, axis=2)


LEGS = 3
PARTS = ((0, 0), (1, 2), (9, 10), (3, 4), (6, 7), (4, 5), (7, 8))
"""Head, trunk, shoulders, thighs and shins: the points at their ends."""


def overlap(own, other, radii, others, left):
    """How deep two bodies are in one another, but for what is ``left`` to legs."""
    depth = -np.inf
    for i, j in itertools.product(range(len(PARTS)), repeat=2):
        p, q, r, s = own[PARTS[i][0]], own[PARTS[i][1]], other[PARTS[j][0]], other[PARTS[j][1]]
        share, part = nearest(p, q, r, s)
        wide = (1.0 - share) * radii[i][0] + share * radii[i][1] + (1.0 - part) * others[j][0] + part * others[j][1]
        gap = math.dist(p + share * (q - p), r + part * (s - r))
        depth = max(depth, wide - gap - (left if max(i, j) >= LEGS else 0.0))
    return depth


def between(bodies, a, b):
    """The way over the ground from the middle of one body to that of another, between head and pelvis."""
    return 0.5 * (bodies[a, 0] + bodies[a, 2] - bodies[b, 0] - bodies[b, 2])[[0, 2]]


def way_around(points, time, a, b, around):
    """The way from b to a, of length 1, where they are nearest on straight ways between the frames around a time."""
    nearest = None
    for at in range(max(time - around, 0), min(time + around, len(points) - 1)):
        start, end = between(points[at], a, b), between(points[at + 1], a, b)
        if np.isfinite([start, end]).all():
            share = np.clip(start @ (start - end) / ((end - start) @ (end - start)), 0.0, 1.0)
            point = start + share * (end - start)
            if nearest is None or np.linalg.norm(point) < np.linalg.norm(nearest):
                nearest = point
    way = between(points[time], a, b) if nearest is None else nearest
    return way / np.linalg.norm(way)


def pushes(points, time, radii, room, soft, most, left, around, steep, furthest, rounds):
    """How far each of N bodies gives way at a time; points are those of ``PARTS``. (T, N, 11, 3)."""
    bodies = points[time]
    out = np.zeros((len(bodies), 2))
    there = [n for n in range(len(bodies)) if np.isfinite(bodies[n]).all()]
    for a, b in itertools.permutations(there, 2):
        depth = overlap(bodies[a], bodies[b], radii[a], radii[b], left)
        way, goes = between(bodies, a, b), way_around(points, time, a, b, around)
        if np.linalg.norm(way) > furthest or depth <= -room - soft:
            continue
        # A bend over twice the softness, from nothing to all.
        deep = np.interp(depth + room, [-soft, soft], [0.0, 1.0])
        deep = max(depth + room, soft) if deep == 1.0 else deep**2 * soft
        # A point that is pushed along the way until it is further from the other one by the depth.
        far = np.linalg.norm(way)
        cosine = max(way @ goes / far, steep)
        push = np.roots([1.0, 2.0 * far * cosine, far**2 - (far + deep) ** 2]).real.max()
        for _ in range(rounds):
            moved = bodies[b] - push * np.array([goes[0], 0.0, goes[1]])
            push += max(overlap(bodies[a], moved, radii[a], radii[b], left) + room, 0.0)
        out[a] += 0.5 * push * goes
    size = np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)
    return out * most * np.tanh(size / most) / size


def depths(starts, ends, radii, arms):
    """Greatest depth of each of N bodies of K capsules in another, without arms and of arms. Shape (N, 2)."""
    out = np.zeros((len(starts), 2))
    for a, b in itertools.permutations(range(len(starts)), 2):
        for i, j in itertools.product(range(starts.shape[1]), repeat=2):
            # Many points of one axis against the other, since tapered capsules have no closed form.
            gaps = [
                distance_to_point(starts[b, j], ends[b, j], starts[a, i] + share * (ends[a, i] - starts[a, i]))
                for share in np.linspace(0.0, 1.0, 101)
            ]
            depth = radii[a, i, 0] + radii[b, j, 0] - min(gaps)
            kind = int(arms[a, i] or arms[b, j])
            out[a, kind] = max(out[a, kind], depth)
    return out

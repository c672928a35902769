"""Slow, obvious twins of the separation of trunks."""

import itertools

import numpy as np


def distance_to_point(p, q, point):
    """Least distance of a point from the segment p q."""
    way = q - p
    share = np.clip(way @ (point - p) / (way @ way), 0.0, 1.0) if way @ way > 0.0 else 0.0
    return float(np.linalg.norm(p + share * way - point))


def distance(p, q, r, s):
    """Least distance of the segments p q and r s: at an end, or where their lines are nearest if that is in both."""
    p, q, r, s = (np.asarray(point, dtype=float) for point in (p, q, r, s))
    found = [distance_to_point(p, q, r), distance_to_point(p, q, s)]
    found += [distance_to_point(r, s, p), distance_to_point(r, s, q)]
    ways = np.stack([q - p, r - s], axis=1)
    if np.linalg.matrix_rank(ways) == 2:
        shares = np.linalg.lstsq(ways, r - p, rcond=None)[0]
        if (shares >= 0.0).all() and (shares <= 1.0).all():
            found.append(float(np.linalg.norm(p + ways @ shares - r)))
    return min(found)


PARTS = ((0, 0, 0), (1, 2, 1), (3, 4, 2), (5, 6, 2))
"""Head, trunk and thighs: the points at their ends, and their radius."""


def overlap(own, other, radii, others, left):
    """How deep two bodies are in one another: heads and trunks, and thighs but for what is ``left`` to legs."""
    depth = -np.inf
    for i, j in itertools.product(PARTS, repeat=2):
        thighs = (i[2] == 2) + (j[2] == 2)
        if thighs != 1:
            gap = distance(own[i[0]], own[i[1]], other[j[0]], other[j[1]])
            depth = max(depth, radii[i[2]] + others[j[2]] - gap - (left if thighs else 0.0))
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


def pushes(points, time, radii, room, soft, most, left, around, steep):
    """How far each of N bodies gives way at a time; points are head, neck, pelvis, hips and knees. (T, N, 7, 3)."""
    bodies = points[time]
    out = np.zeros((len(bodies), 2))
    there = [n for n in range(len(bodies)) if np.isfinite(bodies[n]).all()]
    for a, b in itertools.permutations(there, 2):
        depth = overlap(bodies[a], bodies[b], radii[a], radii[b], left)
        way, goes = between(bodies, a, b), way_around(points, time, a, b, around)
        # A bend over twice the softness, from nothing to all.
        deep = np.interp(depth + room, [-soft, soft], [0.0, 1.0])
        deep = max(depth + room, soft) if deep == 1.0 else deep**2 * soft
        # A point that is pushed along the way until it is further from the other one by the depth.
        far = np.linalg.norm(way)
        cosine = max(way @ goes / far, steep)
        push = np.roots([1.0, 2.0 * far * cosine, far**2 - (far + deep) ** 2]).real.max()
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

"""A slow, obvious twin of the deflection of limbs."""

import numpy as np
from naive_separation import distance_to_point

MARGIN, ROUNDS, STEP, LEAST, MOST, FIST_IN, ALLOWED = 0.05, 10, 0.8, 0.3, 0.25, 0.02, 0.01


def nearest(p, q, own, r, s, other):
    """Depth of two capsules, and the shares of the ways along their axes at which these are nearest."""
    shares = np.linspace(0.0, 1.0, 201)
    points = p + shares[:, None] * (q - p)
    gaps = np.array([distance_to_point(r, s, point) for point in points])
    best = int(np.argmin(gaps))
    way = s - r
    part = float(np.clip(way @ (points[best] - r) / (way @ way), 0.0, 1.0)) if way @ way > 0.0 else 0.0
    return own[0] + other[0] - gaps[best], shares[best], part


def levers(limbs, n, capsule, share):
    """How far a point of a capsule goes along with the middle and the end of its limb."""
    if limbs.limbs[n, capsule] < 0:
        return np.zeros(2)
    first, last = limbs.weights[n, capsule]
    return first + share * (last - first)


def contacts_of(capsules, limbs, t, n, order):
    """Own capsule, other avatar, its capsule and the depth that is allowed, for all that a limb is in or near."""
    rank, found = list(order).index(n), []
    for other in [*order[:rank][::-1], *order[rank + 1 :]]:
        for j in range(capsules.counts[other]):
            for i in range(capsules.counts[n]):
                depth, share, part = nearest(
                    capsules.starts[t, n, i], capsules.ends[t, n, i], capsules.radii[n, i],
                    capsules.starts[t, other, j], capsules.ends[t, other, j], capsules.radii[other, j],
                )  # fmt: skip
                own, theirs = levers(limbs, n, i, share), levers(limbs, other, j, part).sum()
                if depth > ALLOWED - MARGIN and own.sum() > 1e-3:
                    fist = theirs == 0.0 and own[0] == 0.0
                    allowed = ALLOWED + (FIST_IN * limbs.landing[t, n, limbs.limbs[n, i]] if fist else 0.0)
                    part = theirs / (own.sum() + theirs)
                    found.append((i, other, j, allowed + max(depth - allowed, 0.0) * part))
    return found


def moves_of(capsules, limbs, t, n, order):
    """How far the limbs of one avatar are deflected. Shape (4, 2, 3)."""
    moves, contacts = np.zeros((4, 2, 3)), contacts_of(capsules, limbs, t, n, order)
    for _ in range(ROUNDS):
        pushed = False
        for i, other, j, allowed in contacts:
            limb, weights = limbs.limbs[n, i], limbs.weights[n, i]
            p = capsules.starts[t, n, i] + weights[0] @ moves[limb]
            q = capsules.ends[t, n, i] + weights[1] @ moves[limb]
            r, s = capsules.starts[t, other, j], capsules.ends[t, other, j]
            depth, share, part = nearest(p, q, capsules.radii[n, i], r, s, capsules.radii[other, j])
            if depth > allowed:
                pushed, lever = True, levers(limbs, n, i, share)
                way = p + share * (q - p) - r - part * (s - r)
                push = STEP * (depth - allowed) / max(lever @ lever, LEAST) * way / np.linalg.norm(way)
                moves[limb] += lever[:, None] * push
        if not pushed:
            break
        for limb in range(4):
            upper, middle, end = limbs.joints[t, n, limb].astype(float)
            bone = middle + moves[limb, 0] - upper
            elbow = upper + bone / np.linalg.norm(bone) * np.linalg.norm(middle - upper)
            moves[limb, 0] = elbow - middle
            if limb < 2:
                bone = end + moves[limb, 1] - elbow
                moves[limb, 1] = elbow + bone / np.linalg.norm(bone) * np.linalg.norm(end - middle) - end
    size = np.maximum(np.linalg.norm(moves, axis=-1, keepdims=True), 1e-12)
    return moves * MOST * np.tanh(size / MOST) / size

"""A slow, obvious twin of the deflection of limbs."""

import numpy as np
from naive_separation import distance_to_point

MARGIN, ROUNDS, STEP, LEAST, MOST, FIST_IN, ALLOWED = 0.05, 10, 0.8, 0.3, 0.25, 0.04, 0.01
FOOT_IN, LEG_MARGIN, ENOUGH, AT_LAST, STANDS = 0.02, 0.015, 0.0005, 1.001, 0.5


def nearest(p, q, own, r, s, other):
    """Depth of two capsules, and the shares of the ways along their axes at which these are nearest."""
    shares = np.linspace(0.0, 1.0, 201)
    points = p + shares[:, None] * (q - p)
    gaps = np.array([distance_to_point(r, s, point) for point in points])
    best = int(np.argmin(gaps))
    way = s - r
    part = float(np.clip(way @ (points[best] - r) / (way @ way), 0.0, 1.0)) if way @ way > 0.0 else 0.0
    return own[0] + other[0] - gaps[best], shares[best], part


def levers(limbs, t, n, capsule, share):
    """How far a point of a capsule goes along with the middle and the end of its limb."""
    limb = limbs.limbs[n, capsule]
    if limb < 0:
        return np.zeros(2)
    first, last = limbs.weights[n, capsule] * [1.0, limbs.freedom[t, n, limb]]
    return first + share * (last - first)


def is_foot(limbs, n, capsule):
    """Whether a capsule moves with the end of a leg alone."""
    return limbs.limbs[n, capsule] >= 2 and not limbs.weights[n, capsule, :, 0].any()


def order_feet(way, own, theirs, first):
    """1 for a foot that goes over another, -1 for one that does not, 0 where they are side by side."""
    if way[1] ** 2 < way[0] ** 2 + way[2] ** 2:
        return 0
    return 1 if (own, first) > (theirs, not first) else -1


def contacts_of(capsules, limbs, t, n, order):
    """Own capsule, other avatar, its capsule, the depth that is allowed and whether the own one goes over the other."""
    rank, found = list(order).index(n), []
    for other in [*order[:rank][::-1], *order[rank + 1 :]]:
        for j in range(capsules.counts[other]):
            for i in range(capsules.counts[n]):
                depth, share, part = nearest(
                    capsules.starts[t, n, i], capsules.ends[t, n, i], capsules.radii[n, i],
                    capsules.starts[t, other, j], capsules.ends[t, other, j], capsules.radii[other, j],
                )  # fmt: skip
                lever, theirs = levers(limbs, t, n, i, share), levers(limbs, t, other, j, part).sum()
                theirs = 0.0 if limbs.down[t, other] else theirs
                own, above, foot = lever.sum(), 0, is_foot(limbs, n, i)
                if foot and is_foot(limbs, other, j):
                    p, q = capsules.starts[t, n, i], capsules.ends[t, n, i]
                    r, s = capsules.starts[t, other, j], capsules.ends[t, other, j]
                    above = order_feet(p + share * (q - p) - r - part * (s - r), own, theirs, n < other)
                    own, theirs = own * (above >= 0), theirs * (above <= 0)
                margin = MARGIN if limbs.limbs[n, i] < 2 else LEG_MARGIN
                if depth > ALLOWED - margin and own > 1e-3:
                    fist = theirs == 0.0 and lever[0] == 0.0
                    allowed = FOOT_IN if foot else ALLOWED
                    allowed += FIST_IN * limbs.landing[t, n, limbs.limbs[n, i]] if fist else 0.0
                    own *= AT_LAST - limbs.landing[t, n, limbs.limbs[n, i]]
                    theirs *= AT_LAST - limbs.landing[t, other, limbs.limbs[other, j]]
                    part = theirs / (own + theirs)
                    found.append((i, other, j, allowed + max(depth - allowed, 0.0) * part, above > 0))
    return found


def way_beside(p, q, radii, r, s, others):
    """Where a foot goes from a body that lies, and how far for all of it to be beside it."""
    middle, flat, on_floor = 0.5 * (p + q) - r, (s - r)[[0, 2]], np.array([1.0, 0.0, 1.0])
    share = np.clip(middle[[0, 2]] @ flat / (flat @ flat), 0.0, 1.0)
    way = middle - share * (s - r)
    height, way = way[1], way * on_floor
    far = np.linalg.norm(way)
    meet = radii.max() + others[0] + share * (others[1] - others[0])
    return way, 0.5 * abs((q - p) @ way) / far + np.sqrt(max(meet**2 - height**2, 0.0)) - far


def keep_bones(upper, middle, end, moves):
    """Moves of an arm whose bones keep their lengths."""
    bone = middle + moves[0] - upper
    elbow = upper + bone / np.linalg.norm(bone) * np.linalg.norm(middle - upper)
    bone = end + moves[1] - elbow
    wrist = elbow + bone / np.linalg.norm(bone) * np.linalg.norm(end - middle)
    return np.stack([elbow - middle, wrist - end])


def keep_leg(upper, middle, end, moves):
    """Moves of a leg whose knee swivels and whose foot does not go down."""
    normal = np.cross(end - upper, middle - upper)
    most = np.linalg.norm(normal) / np.linalg.norm(end - upper)
    normal = normal / np.linalg.norm(normal)
    foot = [moves[1, 0], max(moves[1, 1], 0.0), moves[1, 2]]
    return np.stack([most * np.tanh(moves[0] @ normal / most) * normal, foot])


def moves_of(capsules, limbs, t, n, order):
    """How far the limbs of one avatar are deflected. Shape (4, 2, 3)."""
    moves, contacts = np.zeros((4, 2, 3)), [] if limbs.down[t, n] else contacts_of(capsules, limbs, t, n, order)
    for _ in range(ROUNDS):
        pushed = False
        for i, other, j, allowed, above in contacts:
            limb = limbs.limbs[n, i]
            weights = limbs.weights[n, i] * [1.0, limbs.freedom[t, n, limb]]
            p = capsules.starts[t, n, i] + weights[0] @ moves[limb]
            q = capsules.ends[t, n, i] + weights[1] @ moves[limb]
            r, s = capsules.starts[t, other, j], capsules.ends[t, other, j]
            depth, share, part = nearest(p, q, capsules.radii[n, i], r, s, capsules.radii[other, j])
            way = p + share * (q - p) - r - part * (s - r)
            if above and way[1] < 0.0:
                depth, way = depth + 2.0 * np.linalg.norm(way), -way
            if limbs.down[t, other] and is_foot(limbs, n, i) and (limbs.freedom[t, n, limb] < STANDS or way[1] < 0.0):
                way, beside = way_beside(p, q, capsules.radii[n, i], r, s, capsules.radii[other, j])
                depth = max(depth, beside) if depth > allowed + ENOUGH else depth
            if depth > allowed + ENOUGH:
                pushed, lever = True, levers(limbs, t, n, i, share)
                push = STEP * (depth - allowed) / max(lever @ lever, LEAST) * way / np.linalg.norm(way)
                moves[limb] += lever[:, None] * push
        if not pushed:
            break
        for limb in range(4):
            keep = keep_bones if limb < 2 else keep_leg
            moves[limb] = keep(*limbs.joints[t, n, limb].astype(float), moves[limb])
    moves *= 1.0 - limbs.struck[t, n][:, None, None]
    moves[:, 1] *= limbs.freedom[t, n][:, None]
    size = np.maximum(np.linalg.norm(moves, axis=-1, keepdims=True), 1e-12)
    return moves * (1.0 + (size / MOST) ** 4) ** -0.25

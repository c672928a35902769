"""Compiled search for how far elbows, hands, knees and feet give way to other bodies."""

import math
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.poses.kernels.capsules import NEAR, capsule_depth
from crowdsim.poses.kernels.limb_bounds import (
    LIMBS,
    WHOLE,
    bound_capsules,
    bound_limbs,
    boxes_meet,
    group_of,
    limbs_near,
)
from crowdsim.poses.kernels.limb_moves import END, JOINT, MOVED, keep_bones, keep_leg, limit

ALLOWED = 0.01
"""Depth at which bodies are left alone [m]."""
_FOOT_IN = 0.02
"""Depth at which a foot is left in what it is in [m]: it should stay where it is planted."""
_STANDS = 0.5
"""How free a foot is at the most that stands."""
_FIST_IN = 0.04
"""How much deeper the capsule of a fist may be in what it hits [m]: the skin of that is slimmer than capsules."""
_AT_LAST = 1.001
"""One, and how readily a limb gives way to another one while it lands a strike: that one goes, if it can."""
_MARGIN, _LEG_MARGIN = 0.05, 0.015
"""How far apart capsules may be that arms, and legs, might be pushed into [m]."""
_SLACK = 0.001
"""How much larger boxes are than they have to be, since they are of single numbers [m]."""
_ENOUGH = 0.0005
"""Depth beyond what is allowed that may be left [m]."""
_ROUNDS, _STEP = 10, 0.8
"""Rounds in which limbs are pushed out of what they are in, and the share of the way that each goes."""
_LEAST = 0.3
"""Least lever by which a push is divided: one close to a shoulder would swing the arm around."""
_CONTACTS = 160
"""Most pairs of capsules that are looked at for one avatar."""


class MovingLimbs(NamedTuple):
    """What moves of N bodies of K capsules at T times.

    Attributes:
        joints: Upper, middle and end joint of each limb [m]. Shape (T, N, 4, 3, 3), float32.
        limbs: Limb of each capsule, -1 for those of the trunk. Shape (N, K).
        weights: How far each of its ends goes along with the middle and the end of the limb. Shape (N, K, 2, 2).
        landing: How close to a strike that lands each limb is, from 0 to 1. Shape (T, N, 4).
        struck: How close each arm is to a strike that lands on its upper arm, likewise. Shape (T, N, 4).
        freedom: How readily the end of each limb moves, 1 unless it is a planted foot. Shape (T, N, 4).
        down: Bodies that are down: their limbs do not give way, those of others do the whole. Shape (T, N), bool.
    """

    joints: Array
    limbs: Array
    weights: Array
    landing: Array
    struck: Array
    freedom: Array
    down: Array


class _Contacts(NamedTuple):
    """Capsules of a body and those of others that they may be in.

    Attributes:
        own: Capsule of the body. Shape (C,).
        others: The other body, and its capsule. Shape (C, 2).
        depths: How deep they are in one another [m]. Shape (C,).
        allowed: Depth up to which the body's own capsule leaves it [m]. Shape (C,).
        above: Whether the body's own capsule belongs above it. Shape (C,), bool.
        middles: Where the bodies are on the ground, by x [m]. Shape (N, 2), float32.
        boxes: Boxes around the limbs of each body, its trunk and all of it, as of ``bound_limbs``. Shape (N, 6, 6).
        near: A box, and boxes around the capsules of the body's limbs. Shape (1 + K, 6).
        close: Which limbs of the body may be near each group of another one, a bit for each. Shape (5,).
        margins: How near capsules are to each limb that are looked at [m]. Shape (4,), float32.
    """

    own: Array
    others: Array
    depths: Array
    allowed: Array
    above: Array
    middles: Array
    boxes: Array
    near: Array
    close: Array
    margins: Array


@kernel
def _leverage(limbs, t, n, capsule, share):
    """Return how far a point of a capsule goes along with the middle and the end of its limb."""
    limb = limbs.limbs[n, capsule]
    if limb < 0:
        return 0.0, 0.0
    w = limbs.weights[n, capsule]
    middle = w[0, JOINT] + share * (w[1, JOINT] - w[0, JOINT])
    return middle, limbs.freedom[t, n, limb] * (w[0, END] + share * (w[1, END] - w[0, END]))


@kernel
def _part_of(limbs, t, n, i, own, other, j, theirs):
    """Return which part of what lies between them the capsule of the other body gives way, by levers of both.

    A limb that lands a strike goes on, and leaves the most to the other one.
    """
    limb, limb_2 = limbs.limbs[n, i], limbs.limbs[other, j]
    own *= _AT_LAST - limbs.landing[t, n, limb]
    if limb_2 >= 0:
        theirs *= _AT_LAST - limbs.landing[t, other, limb_2]
    return theirs / (own + theirs)


@kernel
def _order_feet(capsules, t, a, i, share, b, j, part, own, theirs):
    """Return 1 where a foot goes over another one, -1 where it is the other way around, 0 where they are side by side.

    The one that moves more readily goes over the other, and of two that are planted the one of the first avatar.
    """
    p, q, r, s = capsules.starts[t, a, i], capsules.ends[t, a, i], capsules.starts[t, b, j], capsules.ends[t, b, j]
    x = p[0] + share * (q[0] - p[0]) - r[0] - part * (s[0] - r[0])
    y = p[1] + share * (q[1] - p[1]) - r[1] - part * (s[1] - r[1])
    z = p[2] + share * (q[2] - p[2]) - r[2] - part * (s[2] - r[2])
    if y * y < x * x + z * z:
        return 0
    return 1 if own > theirs or (own == theirs and a < b) else -1


@kernel
def _find_close(contacts, n, other):
    """Note which limbs of a body may be near groups of another one; return whether any is."""
    boxes, others, found = contacts.boxes[n], contacts.boxes[other], 0
    if not boxes_meet(boxes[WHOLE], others[WHOLE], contacts.margins[0]):
        return False
    for group in range(LIMBS + 1):
        contacts.close[group] = limbs_near(boxes, others[group], -1, contacts.margins)
        found |= contacts.close[group]
    return found != 0


@kernel
def _add_contacts(capsules, limbs, t, n, other, contacts, count):
    """Note the capsules of limbs that are in another body, or near it; return how many are noted.

    Where both can give way, each does its part.
    """
    box = contacts.near[0]
    for j in range(capsules.counts[other]):
        near = contacts.close[group_of(limbs.limbs[other, j])]
        if near == 0:
            continue
        p, q = capsules.starts[t, other, j], capsules.ends[t, other, j]
        radius = np.float32(max(capsules.radii[other, j, 0], capsules.radii[other, j, 1]))
        for k in range(3):
            box[k], box[3 + k] = min(p[k], q[k]) - radius, max(p[k], q[k]) + radius
        near = limbs_near(contacts.boxes[n], box, near, contacts.margins)
        if near == 0:
            continue
        for i in range(capsules.counts[n]):
            limb = limbs.limbs[n, i]
            if limb < 0 or not (near >> limb) & 1 or count == contacts.own.shape[0]:
                continue
            if not boxes_meet(contacts.near[1 + i], box, np.float32(0.0)):
                continue
            depth, share, part = capsule_depth(
                capsules.starts[t, n, i], capsules.ends[t, n, i], capsules.radii[n, i],
                capsules.starts[t, other, j], capsules.ends[t, other, j], capsules.radii[other, j],
            )  # fmt: skip
            if depth <= ALLOWED - (_MARGIN if limb < 2 else _LEG_MARGIN):
                continue
            middle, end = _leverage(limbs, t, n, i, share)
            middle_2, end_2 = _leverage(limbs, t, other, j, part)
            own, theirs = middle + end, 0.0 if limbs.down[t, other] else middle_2 + end_2
            above = 0
            if middle == 0.0 and middle_2 == 0.0 and limbs.limbs[n, i] >= 2 and limbs.limbs[other, j] >= 2:
                above = _order_feet(capsules, t, n, i, share, other, j, part, own, theirs)
                own, theirs = own if above >= 0 else 0.0, theirs if above <= 0 else 0.0
            if own > 1e-3:
                allowed = _FOOT_IN if limbs.limbs[n, i] >= 2 and middle == 0.0 else ALLOWED
                if theirs == 0.0 and middle == 0.0:
                    allowed += limbs.landing[t, n, limbs.limbs[n, i]] * _FIST_IN
                contacts.own[count] = i
                contacts.others[count, 0], contacts.others[count, 1] = other, j
                contacts.above[count], contacts.depths[count] = above > 0, depth
                theirs = _part_of(limbs, t, n, i, own, other, j, theirs)
                contacts.allowed[count] = allowed + max(depth - allowed, 0.0) * theirs
                count += 1
    return count


@kernel
def _way_beside(p, q, radii, r, s, others):
    """Return which way on the floor, x and z, and how far a foot has to go so that all of it is beside a capsule."""
    x, y, z = 0.5 * (p[0] + q[0]) - r[0], 0.5 * (p[1] + q[1]) - r[1], 0.5 * (p[2] + q[2]) - r[2]
    dx, dz = s[0] - r[0], s[2] - r[2]
    share = min(max((x * dx + z * dz) / max(dx * dx + dz * dz, 1e-9), 0.0), 1.0)
    x, y, z = x - share * dx, y - share * (s[1] - r[1]), z - share * dz
    far = math.sqrt(x * x + z * z)
    meet = max(radii[0], radii[1]) + others[0] + share * (others[1] - others[0])
    half = 0.5 * abs((q[0] - p[0]) * x + (q[2] - p[2]) * z) / max(far, 1e-6)
    return x, z, half + math.sqrt(max(meet * meet - y * y, 0.0)) - far


@kernel
def _push(capsules, limbs, t, n, contact, contacts, moves, axis):
    """Push a limb out of what one of its capsules is in; return whether it was in it."""
    i, other, j = contacts.own[contact], contacts.others[contact, 0], contacts.others[contact, 1]
    limb, w, p, q = limbs.limbs[n, i], limbs.weights[n, i], axis[0], axis[1]
    move, free = moves[limb], limbs.freedom[t, n, limb]
    for k in range(3):
        p[k] = capsules.starts[t, n, i, k] + w[0, JOINT] * move[JOINT, k] + free * w[0, END] * move[END, k]
        q[k] = capsules.ends[t, n, i, k] + w[1, JOINT] * move[JOINT, k] + free * w[1, END] * move[END, k]
    r, s = capsules.starts[t, other, j], capsules.ends[t, other, j]
    depth, share, part = capsule_depth(p, q, capsules.radii[n, i], r, s, capsules.radii[other, j])
    if depth <= contacts.allowed[contact] + _ENOUGH and not contacts.above[contact]:
        return False
    x = p[0] + share * (q[0] - p[0]) - r[0] - part * (s[0] - r[0])
    y = p[1] + share * (q[1] - p[1]) - r[1] - part * (s[1] - r[1])
    z = p[2] + share * (q[2] - p[2]) - r[2] - part * (s[2] - r[2])
    far = math.sqrt(x * x + y * y + z * z)
    if contacts.above[contact] and y < 0.0:
        depth, x, y, z = depth + 2.0 * far, -x, -y, -z
    over = depth - contacts.allowed[contact]
    middle, end = _leverage(limbs, t, n, i, share)
    if limbs.down[t, other] and limb >= 2 and middle == 0.0 and (free < _STANDS or y < 0.0):
        # Feet that stand, or are below the middle of a body, go aside, to where all of them is beside it.
        x, z, beside = _way_beside(p, q, capsules.radii[n, i], r, s, capsules.radii[other, j])
        y, far, over = 0.0, math.sqrt(x * x + z * z), max(over, beside - contacts.allowed[contact])
    if over <= _ENOUGH or far < 1e-6:
        return False
    push = _STEP * over / max(middle * middle + end * end, _LEAST) / far
    for point, lever in ((JOINT, middle), (END, end)):
        move[point, 0] += push * lever * x
        move[point, 1] += push * lever * y
        move[point, 2] += push * lever * z
    return True


@kernel
def _find_contacts(capsules, limbs, t, n, order, rank, contacts):
    """Note all capsules that limbs of an avatar are in or near; return how many."""
    middles, count, bounded = contacts.middles, 0, False
    x, z = middles[rank, 0], middles[rank, 1]
    for way in (-1, 1):
        at = rank + way
        # Absent ones are not a number, and end the search too.
        while 0 <= at < order.shape[0] and abs(middles[at, 0] - x) < NEAR:
            if abs(middles[at, 1] - z) < NEAR and _find_close(contacts, n, order[at]):
                if not bounded:
                    bound_capsules(capsules, limbs.limbs[n], t, n, contacts.margins, contacts.near[1:])
                    bounded = True
                count = _add_contacts(capsules, limbs, t, n, order[at], contacts, count)
            at += way
    return count


@kernel
def _are_in(contacts, count):
    """Return whether any limb is where it should not be."""
    for contact in range(count):
        if contacts.above[contact] or contacts.depths[contact] > contacts.allowed[contact] + _ENOUGH:
            return True
    return False


@kernel(allocates=True)
def deflect_limbs(first, stop, capsules, limbs, order, ranks, asked, moves):
    """Find how far limbs give way so that they are in no other body, at each of T times.

    Each avatar is pushed out of the others as they are without this; of what lies between two limbs each goes its part.

    Args:
        first: First of the T x M avatars at times, time by time.
        stop: One past the last.
        capsules: The bodies, a ``Capsules``.
        limbs: Their ``MovingLimbs``.
        order: The avatars by x of the first capsule, absent ones last. Shape (T, N).
        ranks: Where each is in that order. Shape (T, N).
        asked: Avatars whose limbs are asked for. Shape (M,).
        moves: Written [m]. Shape (T, M, 4, 2, 3).
    """
    contacts = _Contacts(
        np.empty(_CONTACTS, np.int64),
        np.empty((_CONTACTS, 2), np.int64),
        np.empty(_CONTACTS, np.float64),
        np.empty(_CONTACTS, np.float64),
        np.empty(_CONTACTS, np.bool_),
        np.empty((order.shape[1], 2), np.float32),
        np.empty((order.shape[1], LIMBS + 2, 6), np.float32),
        np.empty((1 + capsules.bounds.shape[1], 6), np.float32),
        np.empty(LIMBS + 1, np.int64),
        np.empty(LIMBS, np.float32),
    )
    for limb in range(LIMBS):
        contacts.margins[limb] = (_MARGIN if limb < 2 else _LEG_MARGIN) - ALLOWED + _SLACK
    axis, own = np.empty((2, 3), np.float32), np.empty((LIMBS, MOVED, 3))
    bounded = -1
    for index in range(first, stop):
        t, m = index // asked.shape[0], index % asked.shape[0]
        n = asked[m]
        if t != bounded:
            bounded = t
            for other in range(order.shape[1]):
                middle = capsules.starts[t, order[t, other], 0]
                contacts.middles[other, 0], contacts.middles[other, 1] = middle[0], middle[2]
                bound_limbs(capsules, limbs.limbs[other], t, other, contacts.boxes[other])
        own[:] = 0.0
        if math.isfinite(capsules.starts[t, n, 0, 0]) and not limbs.down[t, n]:
            count = _find_contacts(capsules, limbs, t, n, order[t], ranks[t, n], contacts)
            rounds = _ROUNDS if _are_in(contacts, count) else 0
            for _ in range(rounds):
                pushed = False
                for contact in range(count):
                    pushed |= _push(capsules, limbs, t, n, contact, contacts, own, axis)
                if not pushed:
                    break
                for limb in range(LIMBS):
                    if limb < 2:
                        keep_bones(limbs.joints[t, n, limb], own[limb])
                    else:
                        keep_leg(limbs.joints[t, n, limb], own[limb])
            for limb in range(LIMBS):
                # Where a strike lands on an upper arm, the arm stays, or it would leave the fist.
                stays = 1.0 - limbs.struck[t, n, limb]
                for k in range(3):
                    own[limb, JOINT, k] *= stays
                    own[limb, END, k] *= stays * limbs.freedom[t, n, limb]
                limit(own[limb, JOINT])
                limit(own[limb, END])
        moves[t, m] = own

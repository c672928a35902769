"""Opponents and neighbours of a small crowd, by comparing with everyone; and when an avatar changes its opponent."""

import math

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.layout import (
    COHORT,
    FIXED,
    HEADING,
    HYSTERESIS,
    NUMBER,
    OPPONENT,
    SKIP,
    TEAM,
    X,
    Z,
)
from crowdsim.jit import kernel

BEHIND = 0.8  # how much further away an opponent counts that is behind [m]


@kernel(inline=True)
def observe_all(avatars, present, due, count, reach, observed, distances, hits):
    """Find opponents and neighbours as ``kd_tree.observe`` does, by comparing with all ``present`` slots.

    ``distances`` and ``hits`` (present,) are scratch space.
    """
    real, limit = avatars.real, reach * reach
    for q in range(count):
        own = due[q]
        x, z, skip = real[X, own], real[Z, own], avatars.whole[SKIP, own]
        for i in range(present):
            dx, dz = real[X, i] - x, real[Z, i] - z
            distances[i] = dx * dx + dz * dz
        held = 0
        for i in range(present):  # no branch, since it cannot be predicted which avatars are near
            hits[held] = i
            held += distances[i] <= limit
        best, found = _list_near(avatars.whole, q, own, held, observed, distances, hits)
        if skip > -2 and found < 0:
            best, found = _find_nearest(avatars.whole, own, present, distances, best, found)
        observed.opponents[q] = found


@kernel(inline=True)
def _list_near(whole, q, own, held, observed, distances, hits):
    """List the neighbours of an avatar among ``hits[:held]``; return its nearest opponent there, and how far it is."""
    neighbours, skip = observed.neighbours, whole[SKIP, own]
    room = neighbours.shape[1]
    best, found = math.inf, -1
    listed = 0
    for h in range(held):
        i = hits[h]
        if i == own:
            continue
        nearer = distances[i] < best or (distances[i] == best and whole[NUMBER, i] < whole[NUMBER, found])
        if skip > -2 and whole[TEAM, i] != skip and nearer:
            best, found = distances[i], i
        k = listed
        if listed < room:
            listed += 1
        elif held > room + 1:
            # Full: the nearest ones stay, lower numbers first among equals.
            k = 0
            for other in range(1, room):
                a, b = neighbours[q, other], neighbours[q, k]
                if distances[a] > distances[b] or (
                    distances[a] == distances[b] and whole[NUMBER, a] > whole[NUMBER, b]
                ):
                    k = other
            worst = neighbours[q, k]
            if distances[i] > distances[worst] or (
                distances[i] == distances[worst] and whole[NUMBER, i] > whole[NUMBER, worst]
            ):
                continue
        neighbours[q, k] = i
    observed.counts[q] = listed
    return best, found


@kernel(inline=True)
def _find_nearest(whole, own, present, distances, best, found):
    """Return the nearest opponent of an avatar, by squared distance, and how far it is."""
    for i in range(present):
        if (
            distances[i] <= best
            and i != own
            and whole[TEAM, i] != whole[SKIP, own]
            and (distances[i] < best or whole[NUMBER, i] < whole[NUMBER, found])
        ):
            best, found = distances[i], i
    return best, found


@kernel(inline=True)
def change_opponent(avatars, cohorts, present, own, nearest):
    """Return the number of an avatar's opponent, or of a target: the old one, unless another is nearer.

    Facing an opponent takes time: one right behind counts as ``BEHIND`` further away than one straight ahead.
    """
    whole, real, slot_of = avatars.whole, avatars.real, avatars.slot_of
    skip = whole[SKIP, own]
    if skip == -2:
        return whole[FIXED, own]
    if nearest < 0:
        return -1
    old = whole[OPPONENT, own]
    if old >= 0:
        slot = slot_of[old]
        if slot < present and slot != own and whole[TEAM, slot] != skip:
            ax, az = real[X, slot] - real[X, own], real[Z, slot] - real[Z, own]
            bx, bz = real[X, nearest] - real[X, own], real[Z, nearest] - real[Z, own]
            cos, sin = cos_sin(real[HEADING, own])
            a, b = math.sqrt(ax * ax + az * az), math.sqrt(bx * bx + bz * bz)
            near = cohorts[whole[COHORT, own], HYSTERESIS]
            # Cosines of the directions of the two.
            ahead = (ax * sin + az * cos) / max(a, 1e-9) - (bx * sin + bz * cos) / max(b, 1e-9)
            if b + 0.5 * BEHIND * ahead >= a - near:
                return old
    return whole[NUMBER, nearest]

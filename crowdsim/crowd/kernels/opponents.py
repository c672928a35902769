"""Opponents and neighbours of a small crowd, by comparing with everyone; and when an avatar changes its opponent."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.layout import (
    COHORT,
    FIXED,
    HEADING,
    HIT_BY,
    HIT_FRAME,
    HYSTERESIS,
    NUMBER,
    OPPONENT,
    SKIP,
    TEAM,
    X,
    Z,
)
from crowdsim.jit import kernel

BEHIND = 0.8  # how much further away an opponent counts that is behind than one ahead [m]
AVERTED = 0.8  # how much further one that looks away than one that looks at the avatar [m]
ENGAGED = 0.8  # how much further one that does not fight the avatar [m]
HIT, REMEMBERED = 1.0, 30.0  # how much nearer the avatar that hit it last [m], and for how long [control frames]


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
        if skip > -2 and whole[TEAM, i] != skip and whole[TEAM, i] >= 0 and nearer:
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
            and whole[TEAM, i] >= 0
            and (distances[i] < best or whole[NUMBER, i] < whole[NUMBER, found])
        ):
            best, found = distances[i], i
    return best, found


@kernel(inline=True)
def change_opponent(avatars, cohorts, now, own, observed, q):
    """Return the number of an avatar's opponent, or of a target: the old one, unless another seems nearer.

    That may be the nearest one or any neighbour; among equals it is the lower number.
    """
    whole, slot_of = avatars.whole, avatars.slot_of
    skip, nearest = whole[SKIP, own], observed.opponents[q]
    if skip == -2:
        fixed = whole[FIXED, own]
        return -1 if fixed >= 0 and whole[TEAM, slot_of[fixed]] < 0 else fixed
    if nearest < 0:
        return -1
    old, best, found = whole[OPPONENT, own], math.inf, -1
    if old >= 0:
        slot = slot_of[old]
        if slot < now.present and slot != own and whole[TEAM, slot] != skip and whole[TEAM, slot] >= 0:
            best = _seems_far(avatars, now.frame, own, slot) - cohorts[whole[COHORT, own], HYSTERESIS]
    best, found = _nearer(avatars, now.frame, own, nearest, best, found)
    for m in range(observed.counts[q]):
        j = observed.neighbours[q, m]
        if whole[TEAM, j] != skip and whole[TEAM, j] >= 0 and j != nearest:
            best, found = _nearer(avatars, now.frame, own, j, best, found)
    return old if found < 0 else whole[NUMBER, found]


@kernel(inline=True)
def _nearer(avatars, frame, own, j, best, found):
    """Return an avatar where it seems nearer than the one found before, and how far away; else those."""
    whole, real = avatars.whole, avatars.real
    dx, dz = real[X, j] - real[X, own], real[Z, j] - real[Z, own]
    most = best + (HIT if whole[HIT_BY, own] == whole[NUMBER, j] else 0.0)
    # Only the avatar that has just hit this one counts as nearer than it is; most others are too far away.
    if most >= 0.0 and dx * dx + dz * dz <= most * most:
        far = _seems_far(avatars, frame, own, j)
        if far < best or (far == best and found >= 0 and whole[NUMBER, j] < whole[NUMBER, found]):
            return far, np.int64(j)
    return best, np.int64(found)


@kernel(inline=True)
def _seems_far(avatars, frame, own, j):
    """Return how far away another avatar seems to one that looks for an opponent [m].

    Facing one another takes time, so it counts where both look. An avatar that fights another one seems further, and
    one that has just hit the avatar nearer: fights become those of two, and few are hit from behind.
    """
    whole, real = avatars.whole, avatars.real
    dx, dz = real[X, j] - real[X, own], real[Z, j] - real[Z, own]
    far = math.sqrt(dx * dx + dz * dz)
    part = 0.5 / max(far, 1e-9)
    cos, sin = cos_sin(real[HEADING, own])
    seems = far + BEHIND * (0.5 - part * (dx * sin + dz * cos))
    cos, sin = cos_sin(real[HEADING, j])
    seems += AVERTED * (0.5 + part * (dx * sin + dz * cos))
    if whole[OPPONENT, j] != whole[NUMBER, own]:
        seems += ENGAGED
    if whole[HIT_BY, own] == whole[NUMBER, j] and frame - real[HIT_FRAME, own] < REMEMBERED:
        seems -= HIT
    return seems

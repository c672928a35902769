"""Opponents and neighbours of a small crowd, by comparing with everyone; and when an avatar changes its opponent."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.positions import position_of, way_between
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
    limit = reach * reach
    for q in range(count):
        own = due[q]
        x, z = position_of(avatars, own)
        skip = avatars.skip[own]
        for i in range(present):
            dx, dz = avatars.x[i] - x, avatars.z[i] - z
            distances[i] = dx * dx + dz * dz
        held = 0
        for i in range(present):  # no branch, since it cannot be predicted which avatars are near
            hits[held] = i
            held += distances[i] <= limit
        best, found = _list_near(avatars, q, own, held, observed, distances, hits)
        if skip > -2 and found < 0:
            best, found = _find_nearest(avatars, own, present, distances, best, found)
        observed.opponents[q] = found


@kernel(inline=True)
def _list_near(avatars, q, own, held, observed, distances, hits):
    """List the neighbours of an avatar among ``hits[:held]``; return its nearest opponent there, and how far it is."""
    neighbours, skip = observed.neighbours, avatars.skip[own]
    room = neighbours.shape[1]
    best, found = math.inf, -1
    listed = 0
    for h in range(held):
        i = hits[h]
        if i == own:
            continue
        nearer = distances[i] < best or (distances[i] == best and avatars.number[i] < avatars.number[found])
        if skip > -2 and avatars.team[i] != skip and avatars.team[i] >= 0 and nearer:
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
                    distances[a] == distances[b] and avatars.number[a] > avatars.number[b]
                ):
                    k = other
            worst = neighbours[q, k]
            if distances[i] > distances[worst] or (
                distances[i] == distances[worst] and avatars.number[i] > avatars.number[worst]
            ):
                continue
        neighbours[q, k] = i
    observed.counts[q] = listed
    return best, found


@kernel(inline=True)
def _find_nearest(avatars, own, present, distances, best, found):
    """Return the nearest opponent of an avatar, by squared distance, and how far it is."""
    for i in range(present):
        if (
            distances[i] <= best
            and i != own
            and avatars.team[i] != avatars.skip[own]
            and avatars.team[i] >= 0
            and (distances[i] < best or avatars.number[i] < avatars.number[found])
        ):
            best, found = distances[i], i
    return best, found


@kernel(inline=True)
def change_opponent(avatars, cohorts, now, own, observed, q):
    """Return the number of an avatar's opponent, or of a target: the old one, unless another seems nearer.

    That may be the nearest one or any neighbour; among equals it is the lower number.
    """
    slot_of = avatars.slot_of
    skip, nearest = avatars.skip[own], observed.opponents[q]
    if skip == -2:
        fixed = avatars.fixed[own]
        return -1 if fixed >= 0 and avatars.team[slot_of[fixed]] < 0 else fixed
    if nearest < 0:
        return -1
    old, best, found = avatars.opponent[own], math.inf, -1
    if old >= 0:
        slot = np.int64(slot_of[old])
        if slot < now.present and slot != own and avatars.team[slot] != skip and avatars.team[slot] >= 0:
            best = _seems_far(avatars, now.frame, own, slot) - cohorts[avatars.playback[own].cohort].hysteresis
    best, found = _nearer(avatars, now.frame, own, nearest, best, found)
    for m in range(observed.counts[q]):
        j = np.int64(observed.neighbours[q, m])
        if avatars.team[j] != skip and avatars.team[j] >= 0 and j != nearest:
            best, found = _nearer(avatars, now.frame, own, j, best, found)
    return old if found < 0 else avatars.number[found]


@kernel(inline=True)
def _nearer(avatars, frame, own, j, best, found):
    """Return an avatar where it seems nearer than the one found before, and how far away; else those."""
    dx, dz = way_between(avatars, own, j)
    most = best + (HIT if avatars.fight[own].hit_by == avatars.number[j] else 0.0)
    # Only the avatar that has just hit this one counts as nearer than it is; most others are too far away.
    if most >= 0.0 and dx * dx + dz * dz <= most * most:
        far = _seems_far(avatars, frame, own, j)
        if far < best or (far == best and found >= 0 and avatars.number[j] < avatars.number[found]):
            return far, np.int64(j)
    return best, np.int64(found)


@kernel(inline=True)
def _seems_far(avatars, frame, own, j):
    """Return how far away another avatar seems to one that looks for an opponent [m].

    Facing one another takes time, so it counts where both look. An avatar that fights another one seems further, and
    one that has just hit the avatar nearer: fights become those of two, and few are hit from behind.
    """
    dx, dz = way_between(avatars, own, j)
    far = math.sqrt(dx * dx + dz * dz)
    part = 0.5 / max(far, 1e-9)
    cos, sin = cos_sin(avatars.heading[own])
    seems = far + BEHIND * (0.5 - part * (dx * sin + dz * cos))
    cos, sin = cos_sin(avatars.heading[j])
    seems += AVERTED * (0.5 + part * (dx * sin + dz * cos))
    if avatars.opponent[j] != avatars.number[own]:
        seems += ENGAGED
    if avatars.fight[own].hit_by == avatars.number[j] and frame - avatars.fight[own].hit_frame < REMEMBERED:
        seems -= HIT
    return seems

"""What an avatar does about its opponent: it fights, watches from a distance, or flees.

Behaviours are learned for opponents that are to be hit. An avatar that watches or flees sees its opponent elsewhere:
nearer by as much as the distance that it keeps is greater than that of a fight, or behind its own back. So it moves by
what it has learned; strikes cost it as much as one that rests. An avatar that fights does likewise between two bursts
of strikes, by its range and aggression.
"""

import math

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.arena import outside
from crowdsim.crowd.kernels.layout import FIGHTS, FLEES, RESTS, WATCHES, Target
from crowdsim.crowd.kernels.obstacle_steering import go_around
from crowdsim.crowd.kernels.positions import position_of, way_between
from crowdsim.crowd.kernels.resting import may_get_opponent
from crowdsim.jit import kernel

NEARBY = 1.2  # distance of an opponent from which on an avatar is on its way to it [m]
FIGHTING = 0.9  # how far apart avatars are that fight [m]
CLOSEST = 0.3  # how near an opponent seems at the most to one that watches [m]
FLIGHT = 10.0  # how far away the point is that an avatar flees to [m]
WAITING = 2.2  # how far from an opponent avatars wait that others fight already [m]
SHYNESS = 0.1  # how much further away an avatar keeps while it rests for each halving of its aggression [m]
FACING, NEARLY = 0.75, 0.35  # cosine of the bearing of an opponent up to which an avatar rests, at first and at last
BEYOND = 0.3  # how much further than its distance an avatar steps back, since it comes nearer as it stands at ease [m]
PATIENT = 20.0  # frames over which it grows content with half a metre less, and with facing less [control frames]
STEPS_BACK = 0.45  # how near an opponent seems at the most to one that is to rest [m]
RAISES = 24.0  # how long an avatar that is to fight again may take to raise its guard [control frames]
BORDER = 0.5  # how far it must be able to step back before the border of the arena [m]
TOO_NEAR = 0.4  # share of its distance at which it goes away again
ADMITTED = 0.5  # how much nearer an avatar counts that fights already, among those who would like to [m]


@kernel(inline=True)
def see_by_intent(model, avatars, world, now, own, opponent, target, observed, q):
    """Decide what an avatar does next about its opponent; return where it sees the target therefore.

    One that has no opponent, and can get none again, rests where its policy has rests.
    """
    row = avatars.conditions[avatars.number[own]]
    does, keeps, turns = row.mode, row.keeps, False
    if opponent == -1 and does != RESTS and model.ways_to_rest.shape[0] > 0:
        if row.piece > 0.0 or not may_get_opponent(avatars, now, own):
            does = RESTS
    elif does == RESTS and opponent != -1 and row.piece == 0.0:
        does, turns = _before_rest(avatars, world, now.frame, own, target, keeps)
    if does == FIGHTS and opponent >= 0:
        waits = _raises_guard(avatars, now, opponent)
        if waits or _has_to_wait(avatars, world, now, own, opponent, observed, q):
            does, keeps = WATCHES, WAITING
    row.does_next = does
    x, z = position_of(avatars, own)
    if opponent >= 0 and does != FLEES and (target.x - x) ** 2 + (target.z - z) ** 2 > NEARBY * NEARBY:
        target = go_around(model, avatars, own, target, observed, q)
    if does == FIGHTS:
        keeps = FIGHTING
        if is_resting(avatars, world, now.frame, own):
            keeps += row.range - SHYNESS * row.aggression
        if keeps == FIGHTING:
            return target
    dx, dz = target.x - x, target.z - z
    far = max(math.sqrt(dx * dx + dz * dz), 1e-9)
    if opponent == -1:
        return target
    if does == FLEES:
        return Target(x - FLIGHT * dx / far, target.y, z - FLIGHT * dz / far, 0.0, 0.0, target.lasts)
    if turns:
        # It is far enough away to rest: seen any nearer, the opponent would make it step back instead of turning round.
        keeps = min(keeps, far)
    part = max(far - (keeps - FIGHTING), CLOSEST if row.mode != RESTS else STEPS_BACK) / far
    return Target(x + part * dx, target.y, z + part * dz, target.vx, target.vz, target.lasts)


@kernel(inline=True)
def _before_rest(avatars, world, frame, own, target, keeps):
    """Return what an avatar does that is to rest, and whether it turns to its opponent: it steps back, turns, rests.

    It steps back to its distance, and is the sooner content with how far that is, and how it faces its opponent, the
    longer it takes. At the border of the arena it leaves that to the other.
    """
    dx, dz = target.x - avatars.x[own], target.z - avatars.z[own]
    square = dx * dx + dz * dz
    row = avatars.conditions[avatars.number[own]]
    late = min((frame - row.since) / PATIENT, 2.0)
    back = BORDER / max(math.sqrt(square), 1e-9)
    cornered = world.arena.kind != 0.0
    cornered = cornered and outside(world.arena, avatars.x[own] - back * dx, avatars.z[own] - back * dz) > 0.0
    near = keeps + BEYOND - 0.5 * late if row.does != RESTS and not cornered else TOO_NEAR * keeps
    cos, sin = cos_sin(avatars.heading[own])
    ahead, least = dx * sin + dz * cos, FACING + min(late, 1.0) * (NEARLY - FACING)
    if square < near * near:
        return WATCHES, False
    return (RESTS, False) if ahead > 0.0 and ahead * ahead > least * least * square else (WATCHES, True)


@kernel(inline=True)
def _raises_guard(avatars, now, opponent):
    """Return whether an opponent that has been at ease is to fight again and raises its guard."""
    row = avatars.conditions[opponent]
    called = row.since > 0.0 and now.frame - row.since < RAISES
    return row.mode == FIGHTS and avatars.slot_of[opponent] < now.present and (row.piece > 0.0 or called)


@kernel(inline=True)
def is_resting(avatars, world, frame, own):
    """Return whether an avatar has thrown a burst of strikes that it has not recovered from."""
    tires = world.cohorts[avatars.playback[own].cohort].interval > 0.0
    return tires and avatars.fight[own].burst <= 0 and frame < avatars.fight[own].rested


@kernel(inline=True)
def _has_to_wait(avatars, world, now, own, opponent, observed, q):
    """Return whether as many others as may attack an opponent are nearer to it, among those that are observed.

    An avatar that fights it already counts as nearer; among equals it is the lower number.
    """
    most = world.rules[avatars.playback[own].cohort].attackers
    j = avatars.slot_of[opponent]
    if most <= 0.0 or j >= now.present:
        return False
    mine = _claim(avatars, own, j)
    nearer = 0
    for m in range(observed.counts[q]):
        i = observed.neighbours[q, m]
        others = avatars.opponent[i] != opponent
        if others or avatars.team[i] < 0 or avatars.conditions[avatars.number[i]].mode != FIGHTS:
            continue
        far = _claim(avatars, i, j)
        nearer += far < mine or (far == mine and avatars.number[i] < avatars.number[own])
    return nearer >= most


@kernel(inline=True)
def _claim(avatars, i, j):
    """Return how far an avatar is from another, less where it fights that one already [m]."""
    dx, dz = way_between(avatars, i, j)
    far = math.sqrt(dx * dx + dz * dz)
    fights = avatars.opponent[i] == avatars.number[j] and avatars.conditions[avatars.number[i]].does == FIGHTS
    return far - ADMITTED if fights else far

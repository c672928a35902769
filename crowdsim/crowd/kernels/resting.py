"""Rests: an avatar that need not fight stands at ease, piece after piece, until it has to fight again.

An avatar that an event sets to rest steps back from its opponent while it lowers its guard, as far as it lacks distance
and the way is free. One without an opponent may walk off once during its rest, if its way is free.
"""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.arena import outside
from crowdsim.crowd.kernels.falling import last_frame
from crowdsim.crowd.kernels.layout import DROPS, RESTS, RISING
from crowdsim.crowd.kernels.positions import end_of
from crowdsim.crowd.kernels.walking import WALLS, free_walk, is_free, sets_off
from crowdsim.jit import kernel

ALIKE = 0.7  # how unlike the poses may be from which a rest begins that an event asks for [m2]
LASTING = 0.01  # what a control frame until it is at ease counts likewise,
LACKING, BEYOND, TURNED = 0.5, 0.05, 0.2  # and a metre that lacks to its distance then, or is beyond that, and facing
SHORT = 0.2  # how much may lack to the distance of an avatar that is not content with where it is [m]
FACING = 0.6  # cosine of the bearing of its opponent up to which it then rests
NO_WAY = 255  # instead of the number of actions until a rest can be entered, where the policy has no rests


@kernel(inline=True)
def resting_action(model, avatars, world, now, own):
    """Return the action by which an avatar enters a rest, goes on with it, or leaves it; -1 where it may choose.

    An avatar that walks off comes to the end of that before it leaves the rest.
    """
    row = avatars.conditions[avatars.number[own]]
    rests = row.does_next == RESTS
    if row.piece > 0.0:
        piece = int(row.piece) - 1
        if not rests and model.rests[piece].leave >= 0:
            row.piece = 0.0
            return np.int64(model.rests[piece].leave)
        walk = -1
        alone = rests and row.mode != RESTS
        if alone and sets_off(model, avatars, world, own, piece) and not may_get_opponent(avatars, now, own):
            walk = free_walk(model, avatars, world, now, own, piece)
        if walk >= 0:
            row.piece = model.walks[walk].row + 1.0
            return np.int64(model.walks[walk].action)
        following = model.rests[piece].follows
        row.piece = following + 1.0
        return np.int64(model.rests[following].hold)
    if row.mode == RESTS:
        state = nearest_rest(model, avatars, world, now, own)
    elif rests:
        state = np.int64(model.actions[avatars.motion[own].action].next)
    else:
        return np.int64(-1)
    if state < 0 or model.ways_to_rest[state].enter < 0:
        return np.int64(-1)
    if row.mode != RESTS and model.ways_to_rest[state].walk >= 0:
        return np.int64(-1)
    row.does_next = RESTS
    row.piece = model.ways_to_rest[state].row + 1.0
    return np.int64(model.ways_to_rest[state].enter)


@kernel
def nearest_rest(model, avatars, world, now, own):
    """Return the state of the avatar's policy before the rest that begins most like the end of its action, or -1.

    It soon drops its guard, as far from the opponent as asked and facing it. No pose is less alike than ``ALIKE``; and
    unless the avatar is content with where it is, it is at its distance then.
    """
    policy, row = avatars.policy[own], avatars.conditions[avatars.number[own]]
    left, ways = last_frame(model, avatars, own), model.ways_to_rest
    opponent, wanted, x, z = avatars.fight[own].next_opponent, 0.0, 0.0, 0.0
    if opponent >= 0 and avatars.slot_of[opponent] < now.present:
        j = np.int64(avatars.slot_of[opponent])
        x, z = end_of(avatars, j)
        wanted = own_share(avatars, world, own, j)
    cos, sin = cos_sin(avatars.heading[own])
    size = np.float64(avatars.playback[own].scale)
    found, least = np.int64(-1), math.inf
    for state in range(model.policies[policy].states, model.policies[policy + 1].states):
        enter = np.int64(ways[state].enter)
        if enter < 0:
            continue
        cost = LASTING * model.actions[enter].length
        if wanted > 0.0:
            move = model.moves[enter]
            dx = x - avatars.x[own] - size * (move.x * cos + move.z * sin)
            dz = z - avatars.z[own] - size * (move.z * cos - move.x * sin)
            far = max(math.sqrt(dx * dx + dz * dz), 1e-6)
            ahead = (dx * (sin * move.cos + cos * move.sin) + dz * (cos * move.cos - sin * move.sin)) / far
            if row.does_next != RESTS and (far < wanted - SHORT or ahead < FACING):
                continue
            cost += LACKING * max(wanted - far, 0.0) + BEYOND * max(far - wanted, 0.0) + TURNED * (1.0 - ahead)
        if cost >= least:
            continue
        gap = pose_gap(model, left, model.actions[enter].origin)
        if gap < ALIKE and cost + gap < least:
            walk = np.int64(ways[state].walk)
            if walk < 0 or is_free(model, avatars, world, now, own, walk):
                found, least = np.int64(state), cost + gap
    return found


@kernel(inline=True)
def own_share(avatars, world, own, j):
    """Return how far from its opponent an avatar goes that is to rest [m]: half the way where both go back."""
    row, other = avatars.conditions[avatars.number[own]], avatars.conditions[avatars.number[j]]
    x, z = end_of(avatars, j)
    dx, dz = x - avatars.x[own], z - avatars.z[own]
    far = max(math.sqrt(dx * dx + dz * dz), 1e-6)
    if far >= row.keeps or other.mode != RESTS or other.does == RESTS:
        return row.keeps
    share = (0.5 * (row.keeps - far) + WALLS) / far
    if outside(world.arena, x + share * dx, z + share * dz) > 0.0:
        return row.keeps
    return 0.5 * (row.keeps + far)


@kernel(inline=True)
def pose_gap(model, one, other):
    """Return how far apart the poses of two playback frames are: squares of distances of head, trunk and arms [m2]."""
    gap = 0.0
    for k in range(model.bodies.shape[1]):
        for axis in range(3):
            gap += (model.bodies[one, k, axis] - model.bodies[other, k, axis]) ** 2
    for k in range(model.arms.shape[1]):
        for axis in range(3):
            gap += (model.arms[one, k, axis] - model.arms[other, k, axis]) ** 2
    return gap


@kernel(inline=True)
def may_get_opponent(avatars, now, own):
    """Return whether an avatar that has no opponent may get one again: one that is down, but not out."""
    skip, fixed = avatars.skip[own], avatars.fixed[own]
    if skip == -2:
        return fixed >= 0 and avatars.slot_of[fixed] < now.present and comes_back(avatars, avatars.slot_of[fixed])
    for j in range(now.present):
        if j != own and avatars.team[j] < 0 and -2 - avatars.team[j] != skip and comes_back(avatars, j):
            return True
    return False


@kernel(inline=True)
def comes_back(avatars, j):
    """Return whether an avatar that is down will get up again, or may."""
    row = avatars.conditions[avatars.number[j]]
    return row.standing == DROPS or (row.standing <= RISING and row.rises < math.inf)

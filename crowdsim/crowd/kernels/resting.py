"""Rests: an avatar that need not fight stands at ease, piece after piece, until it has to fight again.

An avatar without an opponent may walk off once during its rest, if its way is free.
"""

import math

import numpy as np

from crowdsim.crowd.kernels.falling import last_frame
from crowdsim.crowd.kernels.layout import DROPS, RESTS, RISING
from crowdsim.crowd.kernels.walking import free_walk, sets_off
from crowdsim.jit import kernel

ALIKE = 0.7  # how unlike the poses may be from which a rest begins that an event asks for [m2]
LASTING, NEARER_BY = 0.01, 0.5  # what a control frame until it is at ease counts likewise, and a metre ahead
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
    if not rests:
        return np.int64(-1)
    state = model.actions[avatars.motion[own].action].next
    if model.ways_to_rest[state].enter < 0:
        state = nearest_rest(model, avatars, own) if row.mode == RESTS else np.int64(-1)
        if state < 0:
            return np.int64(-1)
    row.piece = model.ways_to_rest[state].row + 1.0
    return np.int64(model.ways_to_rest[state].enter)


@kernel
def nearest_rest(model, avatars, own):
    """Return the state of the avatar's policy before the rest that begins most like the end of its action.

    It soon drops its guard, and does not go ahead meanwhile. -1 where none is as alike as ``ALIKE``.
    """
    policy = avatars.policy[own]
    left, ways = last_frame(model, avatars, own), model.ways_to_rest
    found, least = np.int64(-1), ALIKE
    for state in range(model.policies[policy].states, model.policies[policy + 1].states):
        if ways[state].enter >= 0:
            enter = np.int64(ways[state].enter)
            gap = pose_gap(model, left, model.actions[enter].origin)
            gap += LASTING * model.actions[enter].length + NEARER_BY * max(model.moves[enter].z, 0.0)
            if gap < least:
                found, least = np.int64(state), gap
    return found


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

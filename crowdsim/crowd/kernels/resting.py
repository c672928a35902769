"""Rests: an avatar that need not fight stands at ease, piece after piece, until it has to fight again.

An avatar without an opponent may walk off once during its rest, if its way is free.
"""

import math

import numpy as np

from crowdsim.crowd.kernels.layout import (
    ACTION,
    DOES_NEXT,
    DROPS,
    ENTER,
    FIXED,
    FOLLOWS,
    HOLD,
    LEAVE,
    MODE,
    NEXT,
    NUMBER,
    ONTO,
    PIECE,
    RESTS,
    RISES,
    RISING,
    ROW,
    SKIP,
    STANDING,
    TAKES,
    TEAM,
)
from crowdsim.crowd.kernels.walking import free_walk, sets_off
from crowdsim.jit import kernel

NO_WAY = 255  # instead of the number of actions until a rest can be entered, where the policy has no rests


@kernel(inline=True)
def resting_action(model, avatars, world, now, own):
    """Return the action by which an avatar enters a rest, goes on with it, or leaves it; -1 where it may choose.

    An avatar that walks off comes to the end of that before it leaves the rest.
    """
    row = avatars.conditions[avatars.whole[NUMBER, own]]
    rests = row[DOES_NEXT] == RESTS
    if row[PIECE] > 0.0:
        piece = int(row[PIECE]) - 1
        if not rests and model.rests[piece, LEAVE] >= 0:
            row[PIECE] = 0.0
            return np.int64(model.rests[piece, LEAVE])
        walk = -1
        alone = rests and row[MODE] != RESTS
        if alone and sets_off(model, avatars, world, own, piece) and not may_get_opponent(avatars, now, own):
            walk = free_walk(model, avatars, world, now, own, piece)
        if walk >= 0:
            row[PIECE] = model.walks[walk, ONTO] + 1.0
            return np.int64(model.walks[walk, TAKES])
        following = model.rests[piece, FOLLOWS]
        row[PIECE] = following + 1.0
        return np.int64(model.rests[following, HOLD])
    way = model.ways_to_rest[model.actions[avatars.whole[ACTION, own], NEXT]]
    if not rests or way[ENTER] < 0:
        return np.int64(-1)
    row[PIECE] = way[ROW] + 1.0
    return np.int64(way[ENTER])


@kernel(inline=True)
def may_get_opponent(avatars, now, own):
    """Return whether an avatar that has no opponent may get one again: one that is down, but not out."""
    whole = avatars.whole
    skip, fixed = whole[SKIP, own], whole[FIXED, own]
    if skip == -2:
        return fixed >= 0 and avatars.slot_of[fixed] < now.present and comes_back(avatars, avatars.slot_of[fixed])
    for j in range(now.present):
        if j != own and whole[TEAM, j] < 0 and -2 - whole[TEAM, j] != skip and comes_back(avatars, j):
            return True
    return False


@kernel(inline=True)
def comes_back(avatars, j):
    """Return whether an avatar that is down will get up again, or may."""
    row = avatars.conditions[avatars.whole[NUMBER, j]]
    return row[STANDING] == DROPS or (row[STANDING] <= RISING and row[RISES] < math.inf)

"""Celebrations: an avatar whose last opponent stays down raises its fists, once, unless somebody fights it."""

import math

import numpy as np

from crowdsim.core.random import uniform
from crowdsim.crowd.kernels.falling import last_frame
from crowdsim.crowd.kernels.forced_actions import is_down
from crowdsim.crowd.kernels.layout import CHEERS, FALLING, FIGHTS, LYING, OUT, UP
from crowdsim.crowd.kernels.resting import may_get_opponent, pose_gap
from crowdsim.jit import kernel

WAITS = 8.0  # how long an avatar looks at the one that it has knocked down before that [control frames]
DIFFERS = 0.4  # how much chance counts beside how unlike poses are [m2]


@kernel(inline=True)
def cheering_action(model, avatars, world, now, own):
    """Return the action in which an avatar celebrates that has won; -1 where it does not."""
    row, opponent = avatars.conditions[avatars.number[own]], avatars.fight[own].next_opponent
    if opponent <= -2 or (opponent >= 0 and not is_down(avatars, avatars.slot_of[opponent])):
        row.cheered = 0.0
        return np.int64(-1)
    if row.cheered > 0.0 or row.standing != UP or row.mode != FIGHTS or row.piece > 0.0:
        return np.int64(-1)
    if row.felled > 0.0 and now.frame - row.felled_frame < WAITS:
        return np.int64(-1)
    if not _has_won(avatars, now, own) or may_get_opponent(avatars, now, own):
        return np.int64(-1)
    found = _pick_cheer(model, avatars, world, own, last_frame(model, avatars, own))
    if found >= 0:
        row.cheered = 1.0
    return found


@kernel
def _pick_cheer(model, avatars, world, own, left):
    """Return the celebration of an avatar's policy that begins most like it ends its action, or by chance; or -1."""
    number, decisions = np.int64(avatars.number[own]), np.int64(avatars.fight[own].decisions)
    found, least = np.int64(-1), math.inf
    for row in range(model.falls.shape[0]):
        if model.falls[row].kind == CHEERS and model.falls[row].policy == avatars.policy[own]:
            action = np.int64(model.falls[row].action)
            cost = pose_gap(model, left, model.actions[action].origin)
            cost += DIFFERS * uniform(world.streams.choice, number, decisions + row)
            if cost < least:
                found, least = action, cost
    return found


@kernel
def _has_won(avatars, now, own):
    """Return whether an avatar has had opponents, all of them are out of the fight, and no other one fights it."""
    won, number, skip = False, avatars.number[own], avatars.skip[own]
    for j in range(now.present):
        team, row = avatars.team[j], avatars.conditions[avatars.number[j]]
        is_fighting = team >= 0
        fought = avatars.number[j] == avatars.fixed[own] if skip == -2 else (team if is_fighting else -2 - team) != skip
        if j == own:
            continue
        if is_fighting and (fought or avatars.opponent[j] == number):
            return False
        if fought and not is_fighting:
            won |= row.standing == OUT or (FALLING <= row.standing <= LYING and row.rises == math.inf)
    return won

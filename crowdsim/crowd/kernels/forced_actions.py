"""Special actions, which follow from damage instead of a choice: staggers, falls, lying and getting up."""

import math

import numpy as np

from crowdsim.crowd.kernels.fall_clearance import slide
from crowdsim.crowd.kernels.falling import next_piece, part_of, pick_fall
from crowdsim.crowd.kernels.layout import (
    COHORT,
    DOES,
    DOES_NEXT,
    DOWN_FRAMES,
    DOWNS,
    DROPS,
    FALL,
    FALL_ACTION,
    FALL_KIND,
    FALL_POLICY,
    FALLING,
    FALLS,
    HEALTH,
    LENGTH,
    LIES,
    LYING,
    MOST_DOWNS,
    MOVE_X,
    MOVE_Z,
    NUMBER,
    REST_GAIN,
    RISES,
    RISING,
    RUN_TIRES,
    SLIDE_X,
    SLIDE_Z,
    SPEED,
    STAGGERS,
    STAMINA,
    STANDING,
    STANDING_NEXT,
    STANDS_UP,
    STRIKE_TIRES,
    STRIKES,
    STUMBLES,
    TEAM,
    UP,
)
from crowdsim.jit import kernel


@kernel(inline=True)
def falls_of(model, policy):
    """Return whether a policy has falls."""
    found = False
    for row in range(model.falls.shape[0]):
        found |= model.falls[row, FALL_POLICY] == policy and model.falls[row, FALL_KIND] == FALLS
    return found


@kernel(inline=True)
def is_down(avatars, i):
    """Return whether an avatar falls, lies, or is out of the fight; not one that has stood up and now chooses again."""
    standing = avatars.conditions[avatars.whole[NUMBER, i], STANDING]
    return standing >= DROPS and standing != RISING


@kernel(inline=True)
def special_action(model, avatars, world, frame, own, observed, q):
    """Return the action that an avatar has to do next because it staggers, falls or is down; -1 where it may choose.

    What it will be doing is noted in its row of ``conditions``; others see it when the action starts.
    """
    row = avatars.conditions[avatars.whole[NUMBER, own]]
    standing = row[STANDING]
    row[STANDING_NEXT] = UP
    if standing <= STAGGERS:
        found = pick_fall(model, avatars, world, own, STUMBLES, observed, q) if standing == STAGGERS else -1
        if found < 0:
            found = next_piece(model, np.int64(row[FALL]))
        if found < 0:
            return -1
        row[FALL] = found
        return model.falls[found, FALL_ACTION]
    if standing == DROPS:
        found = pick_fall(model, avatars, world, own, FALLS, observed, q)
        row[STANDING_NEXT], row[FALL] = FALLING, found
        slide(model, avatars, own, found, observed, q)
        return model.falls[found, FALL_ACTION]
    if FALLING <= standing <= LYING:
        avatars.real[SLIDE_X, own], avatars.real[SLIDE_Z, own] = 0.0, 0.0
        rises = standing == LYING and frame >= row[RISES]
        row[STANDING_NEXT] = RISING if rises else LYING
        return part_of(model, np.int64(row[FALL]), STANDS_UP if rises else LIES)
    return -1


@kernel(inline=True)
def note_condition(model, avatars, world, frame, i, action):
    """Note what an avatar does from now on, as it starts an action; and what that takes from its stamina."""
    whole = avatars.whole
    row, rules = avatars.conditions[whole[NUMBER, i]], world.rules[whole[COHORT, i]]
    row[DOES] = row[DOES_NEXT]
    frames = model.actions[action, LENGTH] / avatars.real[SPEED, i]
    strikes = model.actions[action + 1, STRIKES] - model.actions[action, STRIKES]
    x, z = model.moves[action, MOVE_X], model.moves[action, MOVE_Z]
    spent = rules[STRIKE_TIRES] * strikes + rules[RUN_TIRES] * math.sqrt(x * x + z * z)
    row[STAMINA] = min(max(row[STAMINA] - spent, 0.0) + rules[REST_GAIN] * frames, 1.0)
    if row[STANDING_NEXT] == FALLING and row[STANDING] == DROPS:
        out = row[HEALTH] <= 0.0 or row[DOWNS] >= rules[MOST_DOWNS]
        row[RISES] = math.inf if out else frame + frames + rules[DOWN_FRAMES]
    row[STANDING] = row[STANDING_NEXT]
    if row[STANDING] == UP and whole[TEAM, i] < 0:
        whole[TEAM, i] = -2 - whole[TEAM, i]

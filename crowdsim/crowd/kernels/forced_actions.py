"""Special actions, which follow from damage instead of a choice: lying and getting up."""

import math

import numpy as np

from crowdsim.crowd.kernels.falling import part_of
from crowdsim.crowd.kernels.layout import DROPS, FALLING, FALLS, LIES, LYING, RISING, STANDS_UP, UP
from crowdsim.jit import kernel


@kernel(inline=True)
def falls_of(model, policy):
    """Return whether a policy has falls."""
    found = False
    for row in range(model.falls.shape[0]):
        found |= model.falls[row].policy == policy and model.falls[row].kind == FALLS
    return found


@kernel(inline=True)
def is_down(avatars, i):
    """Return whether an avatar falls, lies, or is out of the fight; not one that has stood up and now chooses again."""
    standing = avatars.conditions[avatars.number[i]].standing
    return standing >= DROPS and standing != RISING


@kernel(inline=True)
def special_action(model, avatars, frame, own):
    """Return the action that an avatar has to do next because it falls or is down; -1 where it may choose.

    What it will be doing is noted in its row of ``conditions``; others see it when the action starts.
    """
    row = avatars.conditions[avatars.number[own]]
    standing = row.standing
    row.standing_next = UP
    if FALLING <= standing <= LYING:
        avatars.slides[own].x, avatars.slides[own].z = 0.0, 0.0
        rises = standing == LYING and frame >= row.rises
        row.standing_next = RISING if rises else LYING
        return part_of(model, np.int64(row.fall), STANDS_UP if rises else LIES)
    return -1


@kernel(inline=True)
def note_condition(model, avatars, world, frame, i, action):
    """Note what an avatar does from now on, as it starts an action; and what that takes from its stamina."""
    row, rules = avatars.conditions[avatars.number[i]], world.rules[avatars.playback[i].cohort]
    row.does = row.does_next
    frames = model.actions[action].length / avatars.motion[i].speed
    strikes = model.actions[action + 1].strikes - model.actions[action].strikes
    x, z = model.moves[action].x, model.moves[action].z
    spent = rules.strike_tires * strikes + rules.run_tires * math.sqrt(x * x + z * z)
    row.stamina = min(max(row.stamina - spent, 0.0) + rules.rest_gain * frames, 1.0)
    if row.standing_next == FALLING and row.standing == DROPS:
        out = row.health <= 0.0 or row.downs >= rules.most_downs
        row.rises = math.inf if out else frame + frames + rules.down_frames
    row.standing = row.standing_next
    if row.standing == UP and avatars.team[i] < 0:
        avatars.team[i] = -2 - avatars.team[i]

"""Damage: landed and blocked strikes lower the victim's health, and make it stagger or fall.

Damage is a whole number of parts of a point (``GRAIN``), so that sums do not depend on the order of strikes.
"""

import math

from crowdsim.crowd.kernels.forced_actions import falls_of
from crowdsim.crowd.kernels.interpolation import between
from crowdsim.crowd.kernels.layout import (
    ACTION,
    BLOCKED,
    BLOCKED_SHARE,
    BODY_SHARE,
    COHORT,
    DOWN_FROM,
    DOWNS,
    DROPS,
    FULL_HEALTH,
    HEALTH,
    HIT_COST,
    HURT,
    HURT_FRAME,
    LANDED,
    LENGTH,
    MOST_DOWNS,
    NECK,
    NUMBER,
    ORIGIN,
    OUT,
    PHASE,
    POLICY,
    SCALE,
    STAGGER_FROM,
    STAGGERS,
    STANDING,
    STRIDE,
    STRONG,
    TEAM,
    UP,
)
from crowdsim.crowd.kernels.strikes import ATTACKER, FAST, FELLED, OUTCOME, POINT_Y, TAKEN, VICTIM
from crowdsim.jit import kernel

GRAIN = 1024.0  # parts of a point
LATELY = 30  # longest time between hits whose damage adds up to a knock-down [control frames]
STRONGEST = 2.0  # greatest damage of a hit, as a multiple of that of a strong hit


@kernel(inline=True)
def hurt(model, avatars, world, frame, strikes, first, last):
    """Apply the damage of strikes ``first`` to ``last`` of ``frame``; return how many avatars are knocked down."""
    whole, conditions, slot_of = avatars.whole, avatars.conditions, avatars.slot_of
    if conditions.shape[0] == 0:
        return 0
    for k in range(first, last):
        j = _hurt_by(model, avatars, world, strikes, k)
        if j >= 0:
            row = conditions[whole[NUMBER, j]]
            harm = _harm(model, avatars, world, strikes, k, j)
            strikes.real[k, TAKEN] = harm
            row[HEALTH] = max(row[HEALTH] - harm, 0.0)
            if frame - row[HURT_FRAME] > LATELY:
                row[HURT] = 0.0
            row[HURT] += harm
            row[HURT_FRAME] = frame
    felled = 0
    for k in range(first, last):
        victim = strikes.whole[k, VICTIM]
        j = slot_of[victim] if victim >= 0 else -1
        if j >= 0 and whole[TEAM, j] >= 0 and conditions[victim, HURT_FRAME] == frame:
            fallen = _fell(model, avatars, world, j)
            felled += fallen
            if fallen > 0:
                strikes.whole[_hardest(strikes, victim, first, last), FELLED] = 1
    return felled


@kernel(inline=True)
def _hardest(strikes, victim, first, last):
    """Return the strike with the greatest damage to an avatar, among equals that of the lowest attacker."""
    best, most = -1, 0.0
    for k in range(first, last):
        if strikes.whole[k, VICTIM] == victim:
            taken = strikes.real[k, TAKEN]
            lower = best >= 0 and taken == most and strikes.whole[k, ATTACKER] < strikes.whole[best, ATTACKER]
            if taken > most or lower:
                best, most = k, taken
    return best


@kernel(inline=True)
def _hurt_by(model, avatars, world, strikes, k):
    """Return the slot of the avatar that a strike damages, or -1."""
    victim = strikes.whole[k, VICTIM]
    if victim < 0 or not (strikes.whole[k, OUTCOME] == LANDED or strikes.whole[k, OUTCOME] == BLOCKED):
        return -1
    j = avatars.slot_of[victim]
    if avatars.whole[TEAM, j] < 0 or world.rules[avatars.whole[COHORT, j], FULL_HEALTH] <= 0.0:
        return -1
    return j


@kernel(inline=True)
def _harm(model, avatars, world, strikes, k, j):
    """Return the damage of a strike to an avatar, by its speed and by where it lands."""
    whole, real, actions = avatars.whole, avatars.real, model.actions
    attacker = avatars.slot_of[strikes.whole[k, ATTACKER]]
    rules = world.rules[whole[COHORT, j]]
    strength = min(strikes.real[k, FAST] / model.sizes[whole[POLICY, attacker], STRONG], STRONGEST)
    action = whole[ACTION, j]
    frame = (
        actions[action, ORIGIN]
        + min(real[PHASE, j], actions[action, LENGTH]) * model.policies[whole[POLICY, j], STRIDE]
    )
    share = (
        1.0
        if strikes.real[k, POINT_Y] >= between(model.bodies, frame, NECK + 1) * real[SCALE, j]
        else (rules[BODY_SHARE])
    )
    if strikes.whole[k, OUTCOME] == BLOCKED:
        share *= rules[BLOCKED_SHARE]
    return math.floor(GRAIN * rules[HIT_COST] * strength * share + 0.5) / GRAIN


@kernel(inline=True)
def _fell(model, avatars, world, j):
    """Let an avatar that was damaged in this frame stagger, fall or leave; return whether it is knocked down.

    Without falls in its policy an avatar is removed when it is out, and stays up until then.
    """
    whole = avatars.whole
    row, rules = avatars.conditions[whole[NUMBER, j]], world.rules[whole[COHORT, j]]
    falls = falls_of(model, whole[POLICY, j])
    down = row[HURT] >= rules[DOWN_FROM] or row[HEALTH] <= 0.0
    if down:
        row[DOWNS] += 1.0
        row[HURT] = 0.0
    out = row[HEALTH] <= 0.0 or row[DOWNS] >= rules[MOST_DOWNS]
    if not out and not (down and falls):
        if row[STANDING] == UP and row[HURT] >= rules[STAGGER_FROM]:
            row[STANDING] = STAGGERS
        return 1 if down else 0
    row[STANDING] = DROPS if falls else OUT
    # Teams below 0 are no opponents of others, and have none themselves.
    whole[TEAM, j] = -2 - whole[TEAM, j]
    return 1

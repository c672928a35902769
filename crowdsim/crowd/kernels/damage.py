"""Damage: landed and blocked strikes lower the victim's health, and make it stagger or fall.

Damage is a whole number of parts of a point (``GRAIN``), so that sums do not depend on the order of strikes.
"""

import math

from crowdsim.crowd.kernels.forced_actions import falls_of
from crowdsim.crowd.kernels.interpolation import between
from crowdsim.crowd.kernels.layout import BLOCKED, DROPS, LANDED, NECK, OUT, STAGGERS, UP
from crowdsim.jit import kernel

GRAIN = 1024.0  # parts of a point
LATELY = 30  # longest time between hits whose damage adds up to a knock-down [control frames]
STRONGEST = 2.0  # greatest damage of a hit, as a multiple of that of a strong hit


@kernel(inline=True)
def apply_damage(model, avatars, world, frame, strikes, first, last):
    """Apply the damage of strikes ``first`` to ``last`` of ``frame``; return how many avatars are knocked down."""
    conditions, slot_of = avatars.conditions, avatars.slot_of
    if conditions.shape[0] == 0:
        return 0
    for k in range(first, last):
        j = _hurt_by(model, avatars, world, strikes, k)
        if j >= 0:
            row = conditions[avatars.number[j]]
            harm = _harm(model, avatars, world, strikes, k, j)
            strikes[k].damage = harm
            row.health = max(row.health - harm, 0.0)
            if frame - row.hurt_frame > LATELY:
                row.hurt = 0.0
            row.hurt += harm
            row.hurt_frame = frame
    felled = 0
    for k in range(first, last):
        victim = strikes[k].victim
        j = slot_of[victim] if victim >= 0 else -1
        if j >= 0 and avatars.team[j] >= 0 and conditions[victim].hurt_frame == frame:
            fallen = _fell(model, avatars, world, j)
            felled += fallen
            if fallen > 0:
                strikes[_hardest(strikes, victim, first, last)].down = 1
    return felled


@kernel(inline=True)
def _hardest(strikes, victim, first, last):
    """Return the strike with the greatest damage to an avatar, among equals that of the lowest attacker."""
    best, most = -1, 0.0
    for k in range(first, last):
        if strikes[k].victim == victim:
            taken = strikes[k].damage
            lower = best >= 0 and taken == most and strikes[k].attacker < strikes[best].attacker
            if taken > most or lower:
                best, most = k, taken
    return best


@kernel(inline=True)
def _hurt_by(model, avatars, world, strikes, k):
    """Return the slot of the avatar that a strike damages, or -1."""
    victim = strikes[k].victim
    if victim < 0 or not (strikes[k].outcome == LANDED or strikes[k].outcome == BLOCKED):
        return -1
    j = avatars.slot_of[victim]
    if avatars.team[j] < 0 or world.rules[avatars.playback[j].cohort].full_health <= 0.0:
        return -1
    return j


@kernel(inline=True)
def _harm(model, avatars, world, strikes, k, j):
    """Return the damage of a strike to an avatar, by its speed and by where it lands."""
    motion = avatars.motion
    actions = model.actions
    attacker = avatars.slot_of[strikes[k].attacker]
    rules = world.rules[avatars.playback[j].cohort]
    strength = min(strikes[k].speed / model.sizes[avatars.policy[attacker]].strong, STRONGEST)
    action = motion[j].action
    shown = min(motion[j].phase, actions[action].length) * model.policies[avatars.policy[j]].stride
    neck = between(model.bodies, actions[action].origin + shown, NECK, 1) * avatars.playback[j].scale
    share = 1.0 if strikes[k].y >= neck else rules.body_share
    if strikes[k].outcome == BLOCKED:
        share *= rules.blocked_share
    return math.floor(GRAIN * rules.hit_cost * strength * share + 0.5) / GRAIN


@kernel(inline=True)
def _fell(model, avatars, world, j):
    """Let an avatar that was damaged in this frame stagger, fall or leave; return whether it is knocked down.

    Without falls in its policy an avatar is removed when it is out, and stays up until then.
    """
    row, rules = avatars.conditions[avatars.number[j]], world.rules[avatars.playback[j].cohort]
    falls = falls_of(model, avatars.policy[j])
    down = row.hurt >= rules.down_from or row.health <= 0.0
    if down:
        row.downs += 1.0
        row.hurt = 0.0
    out = row.health <= 0.0 or row.downs >= rules.most_downs
    if not out and not (down and falls):
        if row.standing == UP and row.hurt >= rules.stagger_from:
            row.standing = STAGGERS
        return 1 if down else 0
    row.standing = DROPS if falls else OUT
    # Teams below 0 are no opponents of others, and have none themselves.
    avatars.team[j] = -2 - avatars.team[j]
    return 1

"""Damage: landed and blocked strikes lower the victim's health, and make it stagger or fall.

Damage is a whole number of parts of a point (``GRAIN``), so that sums are exact.
"""

import math

import numpy as np

from crowdsim.crowd.kernels.forced_actions import falls_of
from crowdsim.crowd.kernels.interpolation import between
from crowdsim.crowd.kernels.layout import BLOCKED, DROPS, LANDED, NECK, OUT, STAGGERS, UP
from crowdsim.jit import kernel

GRAIN = 1024.0  # parts of a point
LATELY = 30  # longest time between hits whose damage adds up to a knock-down [control frames]
STRONGEST = 2.0  # greatest damage of a hit, as a multiple of that of a strong hit


@kernel(allocates=True)
def apply_damage(model, avatars, world, frame, strikes, first, last):
    """Apply the damage of strikes ``first`` to ``last`` of ``frame``, one after the other as they land.

    Strikes that an avatar throws after the blow from which it falls are removed; of two at the same time that of the
    lower attacker comes first. Returns how many avatars are knocked down, and where the strikes that are left end.
    """
    conditions = avatars.conditions
    if conditions.shape[0] == 0 or first == last:
        return 0, last
    felled, removed = 0, 0
    for k in _in_order(strikes, first, last):
        if conditions[strikes[k].attacker].standing == DROPS:
            strikes[k].down = -1
            removed += 1
            continue
        j = _hurt_by(model, avatars, world, strikes, k)
        if j >= 0:
            strikes[k].damage = _harm(model, avatars, world, strikes, k, j)
            _hurt(conditions[strikes[k].victim], strikes[k].damage, frame)
            strikes[k].down = _fell(model, avatars, world, j)
            felled += strikes[k].down
    if removed == 0:
        return felled, last
    kept = first
    for k in range(first, last):
        if strikes[k].down >= 0:
            strikes[kept] = strikes[k]
            kept += 1
    return felled, kept


@kernel(allocates=True)
def _in_order(strikes, first, last):
    """Return strikes ``first`` to ``last`` in the order in which they land.

    This is a merge sort. That of numba would take seconds to compile in each kernel that calls this one.
    """
    count, width = last - first, 1
    order, merged = np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(count):
        order[k] = first + k
    while width < count:
        for start in range(0, count, 2 * width):
            i, j = start, start + width
            middle, end = min(j, count), min(j + width, count)
            for k in range(start, end):
                if i < middle and (j >= end or not _lands_before(strikes[order[j]], strikes[order[i]])):
                    merged[k] = order[i]
                    i += 1
                else:
                    merged[k] = order[j]
                    j += 1
        order, merged = merged, order
        width *= 2
    return order


@kernel(inline=True)
def _lands_before(one, other):
    """Return whether a strike lands before another, or at the same time and is of a lower attacker."""
    return one.frame < other.frame or (one.frame == other.frame and one.attacker < other.attacker)


@kernel(inline=True)
def _hurt(row, harm, frame):
    """Take some of the health of an avatar."""
    row.health = max(row.health - harm, 0.0)
    if frame - row.hurt_frame > LATELY:
        row.hurt = 0.0
    row.hurt += harm
    row.hurt_frame = frame


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
    """Let an avatar that has just been damaged stagger, fall or leave; return whether it is knocked down.

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

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


@kernel
def apply_damage(model, avatars, world, frame, strikes, first, last, before):
    """Apply the damage of strikes ``first`` to ``last`` of ``frame``.

    Strikes that an avatar throws after the blow from which it falls are removed, except those that knock down.
    ``before`` is scratch space, with a row of 4 for each of these strikes.
    Returns how many avatars are knocked down, and where the strikes that are left end.
    """
    conditions, slot_of = avatars.conditions, avatars.slot_of
    if conditions.shape[0] == 0 or first == last:
        return 0, last
    for k in range(first, last):
        before[k - first, 0] = math.nan
        if _hurt_by(model, avatars, world, strikes, k) >= 0:
            row, kept = conditions[strikes[k].victim], before[k - first]
            kept[0], kept[1], kept[2], kept[3] = row.health, row.hurt, row.hurt_frame, row.standing
    for k in range(first, last):
        j = _hurt_by(model, avatars, world, strikes, k)
        if j >= 0:
            strikes[k].damage = _harm(model, avatars, world, strikes, k, j)
            _hurt(conditions, strikes[k].victim, strikes[k].damage, frame)
    felled = 0
    for k in range(first, last):
        victim = strikes[k].victim
        j = slot_of[victim] if victim >= 0 else -1
        if j >= 0 and avatars.team[j] >= 0 and conditions[victim].hurt_frame == frame:
            fallen = _fell(model, avatars, world, j)
            felled += fallen
            if fallen > 0:
                strikes[_hardest(strikes, victim, first, last)].down = 1
    if felled > 0:
        last = _take_back(model, avatars, world, frame, strikes, first, last, before)
    return felled, last


@kernel(inline=True)
def _hurt(conditions, victim, harm, frame):
    """Take some of the health of an avatar."""
    row = conditions[victim]
    row.health = max(row.health - harm, 0.0)
    if frame - row.hurt_frame > LATELY:
        row.hurt = 0.0
    row.hurt += harm
    row.hurt_frame = frame


@kernel(inline=True)
def _take_back(model, avatars, world, frame, strikes, first, last, before):
    """Remove the strikes of those who fall already when they throw them; return where those that are left end.

    Victims are as if these had not been thrown, from what they were ``before``; who is knocked down stays down.
    """
    for k in range(first, last):
        attacker = strikes[k].attacker
        if strikes[k].down == 0 and avatars.conditions[attacker].standing == DROPS:
            blow = _blow_on(strikes, attacker, first, last)
            if blow >= 0 and strikes[k].frame > strikes[blow].frame:
                strikes[k].down = -1
    for k in range(first, last):
        if strikes[k].down < 0 and not math.isnan(before[k - first, 0]):
            _hurt_again(model, avatars, world, frame, strikes, k, first, last, before)
    kept = first
    for k in range(first, last):
        if strikes[k].down >= 0:
            if kept < k:
                strikes[kept] = strikes[k]
            kept += 1
    return kept


@kernel(inline=True)
def _blow_on(strikes, victim, first, last):
    """Return the strike that knocks an avatar down, or -1."""
    for k in range(first, last):
        if strikes[k].down > 0 and strikes[k].victim == victim:
            return k
    return -1


@kernel(inline=True)
def _hurt_again(model, avatars, world, frame, strikes, k, first, last, before):
    """Let the victim of a strike that is removed take the others only."""
    victim, kept = strikes[k].victim, before[k - first]
    row = avatars.conditions[victim]
    hurt, hurt_frame = row.hurt, row.hurt_frame
    row.health, row.hurt, row.hurt_frame = kept[0], kept[1], kept[2]
    for other in range(first, last):
        if strikes[other].victim == victim and strikes[other].down >= 0 and not math.isnan(before[other - first, 0]):
            _hurt(avatars.conditions, victim, strikes[other].damage, frame)
    if _blow_on(strikes, victim, first, last) >= 0:
        row.hurt, row.hurt_frame = hurt, hurt_frame
        return
    row.standing = kept[3]
    if row.hurt_frame == frame:
        _fell(model, avatars, world, avatars.slot_of[victim])


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

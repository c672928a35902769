"""Strikes thrown since the frame before: what becomes of them, and what they do to their victims."""

import math
from typing import NamedTuple

import numpy as np

from crowdsim.crowd.kernels.bases import over_ground
from crowdsim.crowd.kernels.damage import apply_damage
from crowdsim.crowd.kernels.layout import AHEAD, BLOCKED, DROPS, LANDED, MISSED
from crowdsim.crowd.kernels.outcomes import Strike, judge
from crowdsim.crowd.kernels.positions import position_of, way_between
from crowdsim.crowd.kernels.prefetch import prefetch, prefetch_avatar
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import is_way_free

FOOT, LEGS = 2.0, (2, 3, 6, 7)  # effective mass of feet and knees over that of a fist, and their ``LIMBS``
GUARDED = 1.0 / 3.0  # share of an impulse that gets through the arm that blocks it


class Stretch(NamedTuple):
    """The motion of an avatar in one action within a control frame.

    Attributes:
        action: The action.
        opponent: Whom it is for.
        low: The phase that it begins behind.
        high: The last phase.
        passed: Frames of motion that came before in this control frame.
        motion: Frames of motion in this control frame.
    """

    action: int
    opponent: int
    low: float
    high: float
    passed: float
    motion: float


@kernel(inline=True)
def list_strikes(model, avatars, world, now, first, last, who, strikes, held):
    """List the strikes that avatars have thrown since the frame before; return how many ``held`` and they are.

    Within a control frame motion runs evenly, through the end of an action where there is one; strikes and opponents
    are placed in between accordingly. Where ``strikes`` has no room, they are only counted. ``who`` is scratch space
    for as many avatars.
    """
    listed = 0
    for i in range(first, last):  # no branch, since it cannot be predicted which avatars strike
        who[listed] = i
        listed += avatars.motion[i].phase > avatars.playback[i].pending
    for k in range(listed):
        _prefetch_strikes(model, avatars, who, k, listed)
        i = np.int64(who[k])
        if avatars.playback[i].action_before >= 0:
            held = _list_strikes(model, avatars, world, now, i, True, strikes, held)
        held = _list_strikes(model, avatars, world, now, i, False, strikes, held)
    return held


@kernel(allocates=True)
def resolve(model, avatars, world, frame, strikes, first, last):
    """Apply strikes ``first`` to ``last``, which are those of ``frame``, but those of avatars that fall already.

    Returns how many avatars are knocked down, and where the strikes that are left end.
    """
    felled, last = apply_damage(model, avatars, world, frame, strikes, first, last)
    note_hits(model, avatars, frame, strikes, first, last)
    for k in range(first, last if felled > 0 else first):
        # It falls where this blow sends it, whatever else hit it.
        if strikes[k].down > 0 and avatars.conditions[strikes[k].victim].standing == DROPS:
            avatars.fight[avatars.slot_of[strikes[k].victim]].hit_frame = frame - 1
            note_hits(model, avatars, frame, strikes, k, k + 1)
    return felled, last


@kernel(inline=True)
def note_hits(model, avatars, frame, strikes, first, last):
    """Let avatars note by whom they were hit in strikes ``first`` to ``last``, which are those of ``frame``.

    An avatar that blocks a strike notes it like one that lands. A hit is as strong as its impulse, 1 for a strong
    strike of the fist of a body of scale 1: its speed over ``Model.sizes``, times the limb's effective mass, which goes
    with the cube of the scale. Of several hits in a frame the strongest counts, among equals that of the lower number,
    so that their order does not matter.
    """
    fight = avatars.fight
    slot_of = avatars.slot_of
    for k in range(first, last):
        attacker, victim = strikes[k].attacker, strikes[k].victim
        outcome = strikes[k].outcome
        if (outcome != LANDED and outcome != BLOCKED) or victim < 0:
            continue
        i, j = np.int64(slot_of[attacker]), np.int64(slot_of[victim])
        strength = strikes[k].speed / model.sizes[avatars.policy[i]].strong
        strength *= FOOT if strikes[k].limb in LEGS else 1.0
        strength *= GUARDED if outcome == BLOCKED else 1.0
        strength *= np.float64(avatars.playback[i].scale) ** 3
        dx, dz = way_between(avatars, i, j)
        part = strength / max(math.sqrt(dx * dx + dz * dz), 1e-9)
        # As it is stored: so the strongest hit does not depend on the order.
        hit_x, hit_z = np.float64(np.float32(part * dx)), np.float64(np.float32(part * dz))
        if fight[j].hit_frame == frame:
            old_x, old_z = np.float64(fight[j].hit_x), np.float64(fight[j].hit_z)
            more = (hit_x * hit_x + hit_z * hit_z) - (old_x * old_x + old_z * old_z)
            if more < 0.0 or (more == 0.0 and fight[j].hit_by < attacker):
                continue
        fight[j].hit_by = attacker
        fight[j].hit_x, fight[j].hit_z, fight[j].hit_frame = hit_x, hit_z, frame


@kernel(inline=True)
def _prefetch_strikes(model, avatars, who, k, listed):
    """Prefetch strikes of avatars soon after the ``k``-th one, what these have seen, and their opponents."""
    motion = avatars.motion
    if k + 3 * AHEAD < listed:
        prefetch_avatar(avatars, who[k + 3 * AHEAD])
        prefetch(avatars.fight, who[k + 3 * AHEAD])
    if k + 2 * AHEAD < listed:
        i = who[k + 2 * AHEAD]
        prefetch(avatars.slot_of, max(avatars.opponent[i], 0))
        prefetch(avatars.seen, avatars.number[i])
        prefetch(model.strikes, model.actions[motion[i].action].strikes)
        prefetch(model.ways, model.actions[motion[i].action].strikes)
        prefetch(model.starts, motion[i].action)
    if k + AHEAD < listed:
        prefetch_avatar(avatars, avatars.slot_of[max(avatars.opponent[who[k + AHEAD]], 0)])
    if k + AHEAD // 2 < listed:
        j = avatars.slot_of[max(avatars.opponent[who[k + AHEAD // 2]], 0)]
        frame = model.actions[motion[j].action].origin + int(motion[j].phase) * model.policies[avatars.policy[j]].stride
        prefetch(model.bodies, frame)
        prefetch(model.arms, frame)
        prefetch(model.ground, frame)


@kernel(inline=True)
def _list_strikes(model, avatars, world, now, i, old, out, held):
    """List the strikes of one avatar in its action, or in its ``old`` one; return how many ``held`` and they are."""
    part = _stretch_of(model, avatars, i, old)
    for k in range(model.actions[part.action].strikes, model.actions[part.action + 1].strikes):
        time = np.float64(model.strikes[k].time)
        if not part.low < time <= part.high:
            continue
        if held < out.shape[0]:
            strike, reach = out[held], model.strikes[k]
            px, pz = over_ground(model, avatars, i, part.action, old, reach.x, reach.z)
            scale = np.float64(avatars.playback[i].scale)
            py = reach.y * scale
            origin = over_ground(model, avatars, i, part.action, old, reach.from_x, reach.from_z)
            strike.attacker, strike.victim, strike.limb = avatars.number[i], part.opponent, np.int32(reach.limb)
            strike.down, strike.damage = 0, 0.0
            # Between two frames, and as exact as a number that is written: landing is judged then.
            strike.frame = now.frame - 1.0 + (time - part.low + part.passed) / part.motion
            strike.speed = reach.speed * scale * avatars.motion[i].speed
            share = strike.frame - (now.frame - 1.0)
            thrown = Strike(k, part.action, part.opponent, (px, py, pz), origin, share, old)
            strike.outcome, end = judge(model, avatars, world.targets, now, i, thrown)
            x, z = position_of(avatars, i)
            if strike.outcome != MISSED and not is_way_free(world.places, now.frame, x, z, px, pz, 0.0, py):
                strike.outcome, end = MISSED, thrown.point
            strike.x, strike.y, strike.z = end
        held += 1
    return held


@kernel(inline=True)
def _stretch_of(model, avatars, i, old):
    """Return the motion of an avatar in its action, or in its ``old`` one."""
    motion, playback = avatars.motion, avatars.playback
    actions = model.actions
    switched = playback[i].action_before >= 0
    before = playback[i].action_before if switched else motion[i].action
    shown = min(motion[i].phase, np.float64(actions[motion[i].action].length))
    rest = actions[before].length - playback[i].phase_before if switched else 0.0
    return Stretch(
        before if old else motion[i].action,
        avatars.fight[i].next_opponent if old else avatars.opponent[i],
        playback[i].phase_before if old or not switched else 0.0,
        np.float64(actions[before].length) if old else shown,
        0.0 if old or not switched else rest,
        rest + shown if switched else shown - playback[i].phase_before,
    )

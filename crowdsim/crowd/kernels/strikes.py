"""Strikes thrown since the frame before, and what becomes of them."""

from typing import NamedTuple

import numpy as np

from crowdsim.crowd.kernels.layout import (
    ACTION,
    ACTION_BEFORE,
    AHEAD,
    BASE_COS,
    BASE_SIN,
    BASE_TURN,
    BASE_X,
    BASE_Z,
    BLOCKED,
    DECISIONS,
    FIST_SPEED,
    FIST_X,
    FIST_Y,
    FIST_Z,
    FROM_X,
    FROM_Z,
    HIT_BY,
    HIT_FRAME,
    HIT_X,
    HIT_Z,
    LANDED,
    LENGTH,
    LIMB,
    NUMBER,
    OPPONENT,
    OPPONENT_BEFORE,
    ORIGIN,
    PENDING,
    PHASE,
    PHASE_BEFORE,
    POLICY,
    SCALE,
    SPEED,
    STRIDE,
    STRIKES,
    STRONG,
    TIME,
    WIDTH,
    X,
    Z,
)
from crowdsim.crowd.kernels.motion import over_ground
from crowdsim.crowd.kernels.outcomes import Strike, judge
from crowdsim.crowd.kernels.prefetch import ask_for, ask_for_rows
from crowdsim.jit import kernel

# Rows of ``Avatars.real`` that place strikes and bodies.
_MOVES = (SCALE, SPEED, PHASE, PHASE_BEFORE, BASE_X, BASE_Z, BASE_COS, BASE_SIN, BASE_TURN, X, Z, WIDTH)

ATTACKER, VICTIM, STRIKER, OUTCOME, FELLED = range(5)
WHEN, POINT_X, POINT_Y, POINT_Z, FAST, TAKEN = range(6)


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
def strike(model, avatars, world, now, first, last, who, strikes, held):
    """List the strikes that avatars have thrown since the frame before; return how many ``held`` and they are.

    Within a control frame motion runs evenly, through the end of an action where there is one; strikes and opponents
    are placed in between accordingly. Where ``strikes`` has no room, they are only counted. ``who[first:last]`` is
    scratch space.
    """
    whole, real = avatars.whole, avatars.real
    listed = first
    for i in range(first, last):  # no branch, since it cannot be predicted which avatars strike
        who[listed] = i
        listed += real[PHASE, i] > whole[PENDING, i]
    for k in range(first, listed):
        _ask_for_strikes(model, avatars, who, k, listed)
        i = np.int64(who[k])
        if whole[ACTION_BEFORE, i] >= 0:
            held = _list_strikes(model, avatars, world.targets, now, i, True, strikes, held)
        held = _list_strikes(model, avatars, world.targets, now, i, False, strikes, held)
    return held


@kernel(inline=True)
def note_hits(model, avatars, frame, strikes, first, last):
    """Let avatars note by whom they were hit in strikes ``first`` to ``last``, which are those of ``frame``.

    An avatar that blocks a strike notes it like one that lands. A hit is as strong as its speed over ``Model.sizes``
    says: 1 for a strong one. Of several hits in a frame the strongest counts, among equals that of the lower number, so
    that their order does not matter.
    """
    whole, real, slot_of = avatars.whole, avatars.real, avatars.slot_of
    for k in range(first, last):
        attacker, victim = strikes.whole[k, ATTACKER], strikes.whole[k, VICTIM]
        outcome = strikes.whole[k, OUTCOME]
        if (outcome != LANDED and outcome != BLOCKED) or victim < 0:
            continue
        i, j = slot_of[attacker], slot_of[victim]
        strength = strikes.real[k, FAST] / model.sizes[whole[POLICY, i], STRONG]
        dx, dz = real[X, j] - real[X, i], real[Z, j] - real[Z, i]
        part = strength / max(np.sqrt(dx * dx + dz * dz), 1e-9)
        hit_x, hit_z = part * dx, part * dz
        if real[HIT_FRAME, j] == frame:
            more = hit_x * hit_x + hit_z * hit_z - real[HIT_X, j] ** 2 - real[HIT_Z, j] ** 2
            if more < 0.0 or (more == 0.0 and whole[HIT_BY, j] < attacker):
                continue
        whole[HIT_BY, j] = attacker
        real[HIT_X, j], real[HIT_Z, j], real[HIT_FRAME, j] = hit_x, hit_z, frame


@kernel(inline=True)
def _ask_for_strikes(model, avatars, who, k, listed):
    """Ask memory for strikes of avatars soon after the ``k``-th one, what these have seen, and their opponents."""
    whole, real = avatars.whole, avatars.real
    if k + 3 * AHEAD < listed:
        ask_for_rows(whole, (NUMBER, POLICY, ACTION, OPPONENT, OPPONENT_BEFORE, DECISIONS), who[k + 3 * AHEAD])
        ask_for_rows(real, _MOVES, who[k + 3 * AHEAD])
    if k + 2 * AHEAD < listed:
        i = who[k + 2 * AHEAD]
        ask_for(avatars.slot_of, max(whole[OPPONENT, i], 0))
        ask_for(avatars.seen, 8 * whole[NUMBER, i])
        ask_for(model.strikes, model.strikes.shape[1] * model.actions[whole[ACTION, i], STRIKES])
        ask_for(model.ways, 6 * model.actions[whole[ACTION, i], STRIKES])
        ask_for(model.starts, 3 * whole[ACTION, i])
    if k + AHEAD < listed:
        j = avatars.slot_of[max(whole[OPPONENT, who[k + AHEAD]], 0)]
        ask_for_rows(whole, (POLICY, ACTION, ACTION_BEFORE), j)
        ask_for_rows(real, _MOVES, j)
    if k + AHEAD // 2 < listed:
        j = avatars.slot_of[max(whole[OPPONENT, who[k + AHEAD // 2]], 0)]
        frame = model.actions[whole[ACTION, j], ORIGIN] + int(real[PHASE, j]) * model.policies[whole[POLICY, j], STRIDE]
        ask_for(model.bodies, 9 * frame)
        ask_for(model.arms, 12 * frame)
        ask_for(model.ground, 3 * frame)


@kernel(inline=True)
def _list_strikes(model, avatars, targets, now, i, old, out, held):
    """List the strikes of one avatar in its action, or in its ``old`` one; return how many ``held`` and they are."""
    part = _stretch_of(model, avatars, i, old)
    for k in range(model.actions[part.action, STRIKES], model.actions[part.action + 1, STRIKES]):
        time = np.float64(model.strikes[k, TIME])
        if not part.low < time <= part.high:
            continue
        if held < out.whole.shape[0]:
            whole, real = out.whole[held], out.real[held]
            reach = model.strikes[k]
            px, pz = over_ground(model, avatars, i, part.action, old, reach[FIST_X], reach[FIST_Z])
            py = reach[FIST_Y] * avatars.real[SCALE, i]
            origin = over_ground(model, avatars, i, part.action, old, reach[FROM_X], reach[FROM_Z])
            whole[ATTACKER], whole[VICTIM] = avatars.whole[NUMBER, i], part.opponent
            whole[STRIKER] = model.strikes[k, LIMB]
            whole[FELLED], real[TAKEN] = 0, 0.0
            # Between two frames, and as exact as a number that is written: landing is judged then.
            real[WHEN] = now.frame - 1.0 + (time - part.low + part.passed) / part.motion
            real[FAST] = model.strikes[k, FIST_SPEED] * avatars.real[SCALE, i] * avatars.real[SPEED, i]
            share = real[WHEN] - (now.frame - 1.0)
            thrown = Strike(k, part.action, part.opponent, (px, py, pz), origin, share, old)
            whole[OUTCOME], end = judge(model, avatars, targets, now, i, thrown)
            real[POINT_X], real[POINT_Y], real[POINT_Z] = end
        held += 1
    return held


@kernel(inline=True)
def _stretch_of(model, avatars, i, old):
    """Return the motion of an avatar in its action, or in its ``old`` one."""
    whole, real, actions = avatars.whole, avatars.real, model.actions
    switched = whole[ACTION_BEFORE, i] >= 0
    before = whole[ACTION_BEFORE, i] if switched else whole[ACTION, i]
    shown = min(real[PHASE, i], np.float64(actions[whole[ACTION, i], LENGTH]))
    rest = actions[before, LENGTH] - real[PHASE_BEFORE, i] if switched else 0.0
    return Stretch(
        before if old else whole[ACTION, i],
        whole[OPPONENT_BEFORE, i] if old else whole[OPPONENT, i],
        real[PHASE_BEFORE, i] if old or not switched else 0.0,
        np.float64(actions[before, LENGTH]) if old else shown,
        0.0 if old or not switched else rest,
        rest + shown if switched else shown - real[PHASE_BEFORE, i],
    )

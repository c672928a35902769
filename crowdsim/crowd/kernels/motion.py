"""Avatars along their actions: playback of the present one, and the start of the next."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.easing import minimum_jerk
from crowdsim.crowd.kernels.forced_actions import note_condition
from crowdsim.crowd.kernels.interpolation import ground_at
from crowdsim.crowd.kernels.layout import (
    ACTION,
    ACTION_BEFORE,
    AHEAD,
    BASE_COS,
    BASE_SIN,
    BASE_TURN,
    BASE_X,
    BASE_Z,
    DECISIONS,
    END_X,
    END_Z,
    ENTERED,
    FIRST_STRIKE,
    HALT_X,
    HALT_Z,
    HEADING,
    LENGTH,
    NEXT_OPPONENT,
    NO_STRIKE,
    NUMBER,
    OPPONENT,
    OPPONENT_BEFORE,
    ORIGIN,
    PENDING,
    PHASE,
    PHASE_BEFORE,
    POLICY,
    SCALE,
    SLIDE_X,
    SLIDE_Z,
    SPEED,
    STRIDE,
    STRIKES,
    THROWN,
    THROWN_UNTIL,
    TIME,
    X,
    Z,
)
from crowdsim.crowd.kernels.prefetch import ask_for, ask_for_rows
from crowdsim.crowd.kernels.shown_motion import ask_for_marks, is_varied, note_shown
from crowdsim.jit import kernel

# Rows of ``Avatars.whole`` and ``Avatars.real`` that ``switch`` reads or writes.
_SWITCHED = (NUMBER, ACTION, DECISIONS, PENDING, OPPONENT, NEXT_OPPONENT, THROWN, THROWN_UNTIL)
_MOVED = (X, Z, HEADING, PHASE, BASE_X, BASE_Z, BASE_COS, BASE_SIN, BASE_TURN, END_X, END_Z, HALT_X, HALT_Z)


@kernel(inline=True)
def _next_strike(actions, strikes, action, phase):
    """Return the last whole frame before the next strike of an action, or ``NO_STRIKE``."""
    found = NO_STRIKE
    for k in range(actions[action, STRIKES], actions[action + 1, STRIKES]):
        if strikes[k, TIME] > phase:
            found = min(found, np.int64(np.ceil(strikes[k, TIME])) - 1)
    return found


@kernel(inline=True)
def advance(model, avatars, first, last, due, few):
    """Move avatars by one frame; list in ``due[first:]`` those whose action has ended.

    Where they are ``few``, what the next frame will read is prefetched. Returns how many are listed, or -1 - i
    where the position of avatar i is not a number.
    """
    whole, real = avatars.whole, avatars.real
    actions, ground, policies = model.actions, model.ground, model.policies
    held, slides = first, avatars.conditions.shape[0] > 0
    for i in range(first, last):
        action = whole[ACTION, i]
        length, before = actions[action, LENGTH], real[PHASE, i]
        if before > whole[PENDING, i]:
            whole[PENDING, i] = _next_strike(actions, model.strikes, action, before)
        phase = before + real[SPEED, i]
        real[PHASE_BEFORE, i] = min(before, length)
        real[PHASE, i] = phase
        whole[ACTION_BEFORE, i] = -1
        if slides and (real[SLIDE_X, i] != 0.0 or real[SLIDE_Z, i] != 0.0):
            share = minimum_jerk(phase / length) - minimum_jerk(before / length)
            real[BASE_X, i] += share * real[SLIDE_X, i]
            real[BASE_Z, i] += share * real[SLIDE_Z, i]
        stride = policies[whole[POLICY, i], STRIDE]
        shown = actions[action, ORIGIN] + min(phase, length) * stride
        if few:
            soon = int(shown) + stride
            ask_for(ground, 3 * soon)
            ask_for(model.bodies, 9 * soon)
        gx, gz, turned = ground_at(ground, shown)
        cos, sin = real[BASE_COS, i], real[BASE_SIN, i]
        x = real[BASE_X, i] + gx * cos + gz * sin
        z = real[BASE_Z, i] - gx * sin + gz * cos
        heading = real[BASE_TURN, i] + turned
        real[X, i], real[Z, i], real[HEADING, i] = x, z, heading
        if not math.isfinite(x + z + heading):
            return -1 - i
        due[held] = i
        held += phase >= length
    return held - first


@kernel(inline=True)
def _ask_for_start(model, avatars, i, action, varied):
    """Ask memory for what ``switch`` will read and write where avatar ``i`` starts an action."""
    origin, length = model.actions[action, ORIGIN], model.actions[action, LENGTH]
    ask_for(model.ground, 3 * origin)
    ask_for(model.ground, 3 * (origin + length * model.policies[avatars.whole[POLICY, i], STRIDE]))
    ask_for(model.starts, 3 * action)
    ask_for(model.halts, 2 * action)
    if varied:
        ask_for_marks(model, avatars, i, action)


@kernel(inline=True)
def switch(model, avatars, world, frame, due, chosen, first, last):
    """Start the chosen actions, and fights, where the old ones have ended, with the motion that was left over.

    ``frame`` is the control frame.
    """
    whole, real = avatars.whole, avatars.real
    actions, ground, starts, policies = model.actions, model.ground, model.starts, model.policies
    varied = is_varied(world)
    for q in range(first, last):
        if q + 2 * AHEAD < last:
            ask_for_rows(whole, _SWITCHED, due[q + 2 * AHEAD])
            ask_for_rows(real, _MOVED, due[q + 2 * AHEAD])
        if q + AHEAD < last:
            _ask_for_start(model, avatars, due[q + AHEAD], chosen[q + AHEAD], varied)
        i = due[q]
        old, new = whole[ACTION, i], chosen[q]
        if varied:
            note_shown(model, avatars, frame, i, new)
        stride, scale, speed = policies[whole[POLICY, i], STRIDE], real[SCALE, i], real[SPEED, i]
        phase = min(real[PHASE, i] - actions[old, LENGTH], speed)
        origin = actions[new, ORIGIN]
        x, z, heading = real[X, i], real[Z, i], real[HEADING, i]
        heading -= 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
        gx, gz, gh = starts[new, 0], starts[new, 1], starts[new, 2]
        if (
            whole[ACTION_BEFORE, i] == ENTERED
        ):  # what came before was not seen, so the position is exact without a shift
            gx, gz, gh = ground[origin, 0], ground[origin, 1], ground[origin, 2]
        cos, sin = cos_sin(heading)
        cos, sin = cos * scale, sin * scale
        hx, hz = model.halts[new, 0], model.halts[new, 1]
        real[HALT_X, i], real[HALT_Z, i] = x + hx * cos + hz * sin, z + hz * cos - hx * sin
        turn = heading - gh
        cos, sin = cos_sin(turn)
        cos, sin = cos * scale, sin * scale
        base_x, base_z = x - gx * cos - gz * sin, z + gx * sin - gz * cos
        real[BASE_X, i], real[BASE_Z, i] = base_x, base_z
        real[BASE_COS, i], real[BASE_SIN, i], real[BASE_TURN, i] = cos, sin, turn
        last_frame = origin + actions[new, LENGTH] * stride
        gx, gz = ground[last_frame, 0], ground[last_frame, 1]
        real[END_X, i], real[END_Z, i] = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
        if avatars.conditions.shape[0] > 0:
            real[END_X, i] += real[SLIDE_X, i]
            real[END_Z, i] += real[SLIDE_Z, i]
            note_condition(model, avatars, world, frame, i, new)
        gx, gz, heading = ground_at(ground, origin + min(phase, actions[new, LENGTH]) * stride)
        real[X, i], real[Z, i] = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
        real[HEADING, i] = heading + turn
        whole[PENDING, i] = -1 if whole[PENDING, i] < actions[old, LENGTH] else actions[new, FIRST_STRIKE]
        whole[ACTION_BEFORE, i] = old
        whole[ACTION, i] = new
        real[PHASE, i] = phase
        whole[OPPONENT_BEFORE, i] = whole[OPPONENT, i]
        whole[OPPONENT, i] = whole[NEXT_OPPONENT, i]
        whole[DECISIONS, i] += 1


@kernel(inline=True)
def base_before(model, avatars, i):
    """Return where the action before the present one is based: x, z, cos, sin, turn."""
    whole, real, actions, ground, starts = avatars.whole, avatars.real, model.actions, model.ground, model.starts
    new = whole[ACTION, i]
    gx, gz = starts[new, 0], starts[new, 1]
    cos, sin = real[BASE_COS, i], real[BASE_SIN, i]
    x = real[BASE_X, i] + gx * cos + gz * sin
    z = real[BASE_Z, i] - gx * sin + gz * cos
    old = whole[ACTION_BEFORE, i]
    end = actions[old, ORIGIN] + actions[old, LENGTH] * model.policies[whole[POLICY, i], STRIDE]
    turn = real[BASE_TURN, i] + starts[new, 2] - ground[end, 2]
    cos, sin = cos_sin(turn)
    cos, sin = cos * real[SCALE, i], sin * real[SCALE, i]
    gx, gz = ground[end, 0], ground[end, 1]
    return x - gx * cos - gz * sin, z + gx * sin - gz * cos, cos, sin, turn


@kernel(inline=True)
def over_ground(model, avatars, i, action, old, fx, fz):
    """Return over what a point lies that is seen from the start of an avatar's action, or of its ``old`` one."""
    real, starts = avatars.real, model.starts
    base_x, base_z, cos, sin = real[BASE_X, i], real[BASE_Z, i], real[BASE_COS, i], real[BASE_SIN, i]
    if old:
        base_x, base_z, cos, sin, _ = base_before(model, avatars, i)
    gx, gz, gh = starts[action, 0], starts[action, 1], starts[action, 2]
    wx, wz = cos_sin(gh)
    gx, gz = gx + fx * wx + fz * wz, gz - fx * wz + fz * wx
    return base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos

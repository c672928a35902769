"""What avatars observe before they choose: opponents, and where these will be, seen from where their actions end."""

import math

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.arena import outside
from crowdsim.crowd.kernels.forced_actions import is_down
from crowdsim.crowd.kernels.intents import see_by_intent
from crowdsim.crowd.kernels.interpolation import between
from crowdsim.crowd.kernels.layout import (
    ACTION,
    AHEAD,
    ARENA,
    BASE_TURN,
    CENTRE_X,
    CENTRE_Z,
    COHORT,
    END_X,
    END_Z,
    FACING,
    HEAD,
    HEADING,
    HIT_BY,
    HIT_FRAME,
    LASTS,
    LENGTH,
    MOVING_X,
    MOVING_Z,
    NEXT,
    NEXT_OPPONENT,
    NUMBER,
    OPPONENT,
    ORIGIN,
    PHASE,
    POLICY,
    SCALE,
    SKIP,
    SPEED,
    STRIDE,
    TARGET_X,
    TARGET_Y,
    TARGET_Z,
    TEAM,
    TURN_BACK,
    Target,
    X,
    Z,
)
from crowdsim.crowd.kernels.opponents import change_opponent
from crowdsim.crowd.kernels.prefetch import ask_for, ask_for_rows
from crowdsim.jit import kernel

# Rows of ``Avatars.whole`` and ``Avatars.real`` that ``observe`` reads of an avatar, and of its opponent.
_OWN = (OPPONENT, SKIP, ACTION, COHORT, POLICY, HIT_BY, NUMBER, NEXT_OPPONENT)
_OWN_REAL = (X, Z, SCALE, HEADING, SPEED, HIT_FRAME)
_OTHERS = (OPPONENT, ACTION, POLICY, TEAM, NUMBER)
_OTHERS_REAL = (X, Z, SCALE, HEADING, PHASE, SPEED, END_X, END_Z, BASE_TURN)


@kernel(inline=True)
def observe(model, avatars, world, now, due, count, observed, scratch):
    """Choose opponents for avatars ``due[:count]`` and write their situations (``values.value_actions``).

    The state is that in which the action ends, or -1 where there is no opponent. Opponents change when the next
    actions start (``motion.switch``), so that all avatars see the opponents that the others had when the frame began.
    """
    whole, real, slot_of, arena = avatars.whole, avatars.real, avatars.slot_of, world.arena
    for q in range(count):
        _ask_for_targets(model, avatars, due, count, observed, q)
        own = due[q]
        opponent = change_opponent(avatars, world.cohorts, now, own, observed, q)
        whole[NEXT_OPPONENT, own] = opponent
        seen = True
        if opponent <= -2:
            target = _scripted_target(world.targets, now.moment, -2 - opponent)
        elif opponent >= 0 and slot_of[opponent] < now.present:
            target = _head_of(model, avatars, slot_of[opponent])
        else:
            target, seen = Target(0.0, 1.5 * real[SCALE, own], 0.0, 0.0, 0.0, 0.0), False
        down = False
        if avatars.conditions.shape[0] > 0:
            down = is_down(avatars, own)
            if down:
                whole[NEXT_OPPONENT, own], seen = -1, False
            else:
                other = opponent if seen else -1
                target = see_by_intent(model, avatars, world, now, own, other, target, observed, q)
        if not down and arena[ARENA] != 0.0 and outside(arena, real[X, own], real[Z, own]) > world.crowding[TURN_BACK]:
            # The middle counts until the avatar is inside again.
            target, seen = Target(arena[CENTRE_X], target.y, arena[CENTRE_Z], 0.0, 0.0, target.lasts), True
        _write_situation(real, own, target, scratch.situations, q)
        faces = real[HEADING, slot_of[opponent]] if opponent >= 0 else math.atan2(target.vx, target.vz)
        scratch.situations[q, FACING] = faces - real[HEADING, own]
        state = model.actions[whole[ACTION, own], NEXT]
        for action in range(model.offsets[state], model.offsets[state + 1], 2):
            ask_for(model.moves, action * model.moves.shape[1])
            ask_for(model.actions, action * model.actions.shape[1])
        scratch.states[q] = state if seen else -1
        scratch.cohorts[q], scratch.policies[q] = whole[COHORT, own], whole[POLICY, own]


@kernel(inline=True)
def _ask_for_targets(model, avatars, due, count, observed, q):
    """Ask memory for what some avatars after the ``q``-th one will read of themselves and of their opponents."""
    whole, real = avatars.whole, avatars.real
    if q + 3 * AHEAD < count:
        own, nearest = due[q + 3 * AHEAD], max(observed.opponents[q + 3 * AHEAD], 0)
        ask_for_rows(whole, _OWN, own)
        ask_for_rows(real, _OWN_REAL, own)
        ask_for_rows(whole, _OTHERS, nearest)
        ask_for_rows(real, _OTHERS_REAL, nearest)
    if q + 2 * AHEAD < count:
        ask_for(avatars.slot_of, max(whole[OPPONENT, due[q + 2 * AHEAD]], 0))
    if q + AHEAD < count:
        old, nearest = avatars.slot_of[max(whole[OPPONENT, due[q + AHEAD]], 0)], max(observed.opponents[q + AHEAD], 0)
        ask_for_rows(whole, _OTHERS, old)
        ask_for_rows(real, _OTHERS_REAL, old)
        action, stride = whole[ACTION, nearest], model.policies[whole[POLICY, nearest], STRIDE]
        first, end = model.actions[action, ORIGIN], model.actions[action, LENGTH] * stride
        ask_for(model.bodies, 9 * (first + int(real[PHASE, nearest]) * stride))
        ask_for(model.bodies, 9 * (first + end))
        ask_for(model.ground, 3 * (first + end))


@kernel(inline=True)
def _scripted_target(targets, moment, target):
    """Return a scripted target, which moves on for ever."""
    x, y, z = targets[moment, target, 0], targets[moment, target, 1], targets[moment, target, 2]
    return Target(x, y, z, x - targets[moment - 1, target, 0], z - targets[moment - 1, target, 2], math.inf)


@kernel(inline=True)
def _head_of(model, avatars, j):
    """Return an avatar's head, which moves to where it is at the end of its action."""
    whole, real, actions, bodies = avatars.whole, avatars.real, model.actions, model.bodies
    action = whole[ACTION, j]
    done = min(real[PHASE, j], actions[action, LENGTH])
    frame = actions[action, ORIGIN] + done * model.policies[whole[POLICY, j], STRIDE]
    size = real[SCALE, j]
    hx, hz = between(bodies, frame, HEAD) * size, between(bodies, frame, HEAD + 2) * size
    cos, sin = cos_sin(real[HEADING, j])
    x, z = real[X, j] + hx * cos + hz * sin, real[Z, j] - hx * sin + hz * cos
    y = between(bodies, frame, HEAD + 1) * size
    lasts = (actions[action, LENGTH] - done) / real[SPEED, j]
    vx, vz = 0.0, 0.0
    if lasts > 0.0:
        stride = model.policies[whole[POLICY, j], STRIDE]
        end = actions[action, ORIGIN] + actions[action, LENGTH] * stride
        cos, sin = cos_sin(real[BASE_TURN, j] + model.ground[end, 2])
        hx, hz = bodies[end, HEAD] * size, bodies[end, HEAD + 2] * size
        vx = (real[END_X, j] + hx * cos + hz * sin - x) / lasts
        vz = (real[END_Z, j] - hx * sin + hz * cos - z) / lasts
    return Target(x, y, z, vx, vz, lasts)


@kernel(inline=True)
def _write_situation(real, own, target, out_situations, q):
    """Write a target as an avatar sees it, for a body of scale 1 and in its own frames of motion."""
    scale, speed = real[SCALE, own], real[SPEED, own]
    cos, sin = cos_sin(real[HEADING, own])
    dx, dz = (target.x - real[X, own]) / scale, (target.z - real[Z, own]) / scale
    out_situations[q, TARGET_X] = dx * cos - dz * sin
    out_situations[q, TARGET_Y] = target.y / scale
    out_situations[q, TARGET_Z] = dx * sin + dz * cos
    dx, dz = target.vx / (scale * speed), target.vz / (scale * speed)
    out_situations[q, MOVING_X] = dx * cos - dz * sin
    out_situations[q, MOVING_Z] = dx * sin + dz * cos
    out_situations[q, LASTS] = target.lasts * speed

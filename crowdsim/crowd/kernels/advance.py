"""Avatars along their actions: playback of the present one, and the start of the next."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.easing import minimum_jerk
from crowdsim.crowd.kernels.bases import base_at, base_of
from crowdsim.crowd.kernels.confinement import confine, is_clear, whole
from crowdsim.crowd.kernels.forced_actions import note_condition
from crowdsim.crowd.kernels.interpolation import ground_at
from crowdsim.crowd.kernels.layout import AHEAD, NO_STRIKE
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.crowd.kernels.prefetch import prefetch, prefetch_avatar
from crowdsim.crowd.kernels.shown_motion import is_varied, note_shown, prefetch_marks
from crowdsim.jit import kernel

NEARLY = 1e-4  # how near its end an action is over [frames of motion]


@kernel(inline=True)
def _next_strike(actions, strikes, action, phase):
    """Return the last whole frame before the next strike of an action, or ``NO_STRIKE``."""
    found = NO_STRIKE
    for k in range(actions[action].strikes, actions[action + 1].strikes):
        if strikes[k].time > phase:
            found = min(found, np.int64(math.ceil(strikes[k].time)) - 1)
    return found


@kernel(inline=True)
def advance(model, avatars, world, frame, first, last, due, few):
    """Move avatars ``first`` to ``last`` by one frame; list in ``due`` those whose action has ended.

    Where they are ``few``, what the next frame will read is prefetched, else what is read of avatars soon after.
    Returns how many are listed, or -1 - i where the position of avatar i is not a number.
    """
    motion, playback = avatars.motion, avatars.playback
    actions, ground, policies = model.actions, model.ground, model.policies
    held, confined = 0, world.places.parts.shape[0] > 0
    for i in range(first, last):
        if not few and i + 2 * AHEAD < last:
            _prefetch_ground(model, avatars, i + 2 * AHEAD)
        action = motion[i].action
        length, before = actions[action].length, motion[i].phase
        if before > playback[i].pending:
            playback[i].pending = _next_strike(actions, model.strikes, action, before)
        phase = np.float32(np.float64(before) + motion[i].speed)
        if length - NEARLY < phase < length:
            phase = np.float32(length)  # it is over but for rounding
        playback[i].phase_before = min(before, length)
        motion[i].phase = phase
        playback[i].action_before = -1
        stride = policies[avatars.policy[i]].stride
        shown = actions[action].origin + min(phase, length) * stride
        if few:
            soon = int(shown) + stride
            prefetch(ground, soon)
            prefetch(model.bodies, soon)
        gx, gz, turned = ground_at(ground, shown)
        base_x, base_z, cos, sin = base_at(model, avatars, i)
        x, z = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
        heading = playback[i].base_turn + turned
        avatars.x[i], avatars.z[i], avatars.heading[i] = x, z, heading
        if not math.isfinite(x + z + heading):
            return -1 - i
        if confined:
            confine(model, avatars, world, frame, i)
        due[held] = i
        held += phase >= length
    return held


@kernel(inline=True)
def _prefetch_ground(model, avatars, i):
    """Prefetch the ground transforms that ``advance`` will read of avatar ``i``."""
    action, stride = model.actions[avatars.motion[i].action], model.policies[avatars.policy[i]].stride
    prefetch(model.ground, action.origin + int(avatars.motion[i].phase) * stride)
    prefetch(model.ground, action.origin + action.length * stride)


@kernel(inline=True)
def _prefetch_start(model, avatars, i, action, varied):
    """Prefetch what ``switch`` will read and write where avatar ``i`` starts an action."""
    origin, length = model.actions[action].origin, model.actions[action].length
    prefetch(model.ground, origin)
    prefetch(model.ground, origin + length * model.policies[avatars.policy[i]].stride)
    prefetch(model.starts, action)
    prefetch(model.halts, action)
    if varied:
        prefetch_marks(model, avatars, i, action)


@kernel(inline=True)
def switch(model, avatars, world, frame, due, chosen, first, last):
    """Start the chosen actions, and fights, where the old ones have ended, with the motion that was left over.

    ``frame`` is the control frame.
    """
    motion, playback, actions = avatars.motion, avatars.playback, model.actions
    varied, confined = is_varied(world), world.places.parts.shape[0] > 0
    for q in range(first, last):
        if q + 2 * AHEAD < last:
            prefetch_avatar(avatars, due[q + 2 * AHEAD])
            prefetch(avatars.fight, due[q + 2 * AHEAD])
        if q + AHEAD < last:
            _prefetch_start(model, avatars, due[q + AHEAD], chosen[q + AHEAD], varied)
        i, new = np.int64(due[q]), np.int64(chosen[q])
        old = motion[i].action
        if varied:
            note_shown(model, avatars, frame, i, new)
        phase = min(motion[i].phase - actions[old].length, motion[i].speed)
        missing = playback[i].pending < actions[old].length
        start_action(model, avatars, world, frame, i, new, phase)
        playback[i].pending = -1 if missing else actions[new].first_strike
        playback[i].action_before = old
        if confined:
            confine(model, avatars, world, frame, i)
        before, avatars.opponent[i] = avatars.opponent[i], avatars.fight[i].next_opponent
        avatars.fight[i].next_opponent = before
        avatars.fight[i].decisions += 1


@kernel(inline=True)
def start_action(model, avatars, world, frame, i, new, phase):
    """Start an action on the ground transform of an avatar, with some frames of motion done already."""
    motion, playback = avatars.motion, avatars.playback
    actions, ground, policies = model.actions, model.ground, model.policies
    stride, scale = policies[avatars.policy[i]].stride, np.float64(playback[i].scale)
    origin = actions[new].origin
    x, z = position_of(avatars, i)
    heading = np.float64(avatars.heading[i])
    heading -= 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
    cos, sin = cos_sin(heading)
    cos, sin = cos * scale, sin * scale
    hx, hz = model.halts[new].x, model.halts[new].z
    motion[i].halt_x, motion[i].halt_z = x + hx * cos + hz * sin, z + hz * cos - hx * sin
    base_x, base_z, cos, sin, turn = base_of(model, avatars, i, new, heading)
    playback[i].base_turn = turn
    last_frame = origin + actions[new].length * stride
    gx, gz = ground[last_frame].x, ground[last_frame].z
    motion[i].end_x, motion[i].end_z = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
    if avatars.conditions.shape[0] > 0:
        slides = 1.0 - minimum_jerk(phase / actions[new].length)
        motion[i].end_x += slides * avatars.slides[i].x
        motion[i].end_z += slides * avatars.slides[i].z
        note_condition(model, avatars, world, frame, i, new)
    gx, gz, heading = ground_at(ground, origin + min(phase, actions[new].length) * stride)
    avatars.x[i], avatars.z[i] = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
    avatars.heading[i] = heading + turn
    motion[i].action = new
    motion[i].phase = phase
    if avatars.free.shape[0] > 0:
        is_free = is_clear(model, avatars, world.places, i, new, base_x, base_z, cos, sin)
        avatars.free[i] = whole(actions[new].length, motion[i].speed) if is_free else -1.0

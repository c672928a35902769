"""What avatars observe before they choose: opponents, and where these will be, seen from where their actions end."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.mathematics import atan2
from crowdsim.crowd.kernels.arena import outside
from crowdsim.crowd.kernels.forced_actions import is_down
from crowdsim.crowd.kernels.hidden import prefer_seen, way_to
from crowdsim.crowd.kernels.intents import see_by_intent
from crowdsim.crowd.kernels.interpolation import between
from crowdsim.crowd.kernels.layout import AHEAD, FORESEEN, HEAD, Target
from crowdsim.crowd.kernels.noticing import noticed, see_fallen
from crowdsim.crowd.kernels.opponents import change_opponent
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.crowd.kernels.prefetch import prefetch, prefetch_avatar
from crowdsim.crowd.kernels.terms.defence import see_threat
from crowdsim.crowd.kernels.travelling import see_way, travels
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE

AT_HAND = 0.5  # distance of a scripted target beyond which an avatar walks to where the two will meet [m]
WALKS = 0.08  # how far it walks in a control frame meanwhile [m]


@kernel(inline=True)
def observe(model, avatars, world, now, due, count, observed, scratch):
    """Choose opponents for avatars ``due[:count]`` and write their situations (``values.value_actions``).

    The state is that in which the action ends, or -1 where there is no opponent. Opponents change when the next
    actions start (``advance.switch``), so that all avatars see the opponents that the others had when the frame began.
    """
    slot_of, arena, walled = avatars.slot_of, world.arena, world.places.parts.shape[0] > 0
    for q in range(count):
        _prefetch_targets(model, avatars, due, count, observed, q)
        own = np.int64(due[q])
        opponent = change_opponent(avatars, world.cohorts, now, own, observed, q)
        is_open = True
        if walled:
            opponent, is_open = prefer_seen(avatars, world, now, own, opponent, observed, q)
        fallen = -1
        if avatars.conditions.shape[0] > 0:
            fallen = noticed(avatars, now, own, opponent)
            if fallen >= 0:
                opponent, is_open = fallen, True
        avatars.fight[own].next_opponent = opponent
        seen = True
        if opponent <= -2:
            target = _meet(avatars, own, world.targets, now.moment, -2 - opponent)
        elif opponent >= 0 and slot_of[opponent] < now.present:
            target = _head_of(model, avatars, slot_of[opponent])
        else:
            target, seen = Target(0.0, 1.5 * avatars.playback[own].scale, 0.0, 0.0, 0.0, 0.0), False
        if seen and not is_open:
            target = way_to(world.places, now.frame, *position_of(avatars, own), target)
        down = False
        if avatars.conditions.shape[0] > 0:
            down = is_down(avatars, own)
            if down:
                avatars.fight[own].next_opponent, seen = -1, False
            elif travels(avatars, own):
                opponent, target, seen = -1, see_way(model, avatars, world, now.frame, own, observed, q), True
            elif fallen >= 0:
                target = see_fallen(avatars, world, now, own, target)
            else:
                other = opponent if seen else -1
                target = see_by_intent(model, avatars, world, now, own, other, target, observed, q)
        bounded = not down and arena.kind != 0.0 and not travels(avatars, own)
        if bounded and outside(arena, avatars.x[own], avatars.z[own]) > world.crowding.turn_back:
            # The middle counts until the avatar is inside again.
            target, seen = Target(arena.x, target.y, arena.z, 0.0, 0.0, target.lasts), True
        _write_situation(avatars, own, target, scratch.situations, q)
        faces = avatars.heading[slot_of[opponent]] if opponent >= 0 else atan2(target.vx, target.vz)
        scratch.situations[q].heading = faces - avatars.heading[own]
        if model.sizes[avatars.policy[own]].watches > 0.0:
            impact = see_threat(model, avatars, world.cohorts, now, own, observed, q).frames * avatars.motion[own].speed
            scratch.situations[q].impact = min(impact, UNSEEN_STRIKE)
        state = model.actions[avatars.motion[own].action].next
        for action in range(model.offsets[state], model.offsets[state + 1], 2):
            prefetch(model.moves, action)
            prefetch(model.prices, action)
            prefetch(model.actions, action)
        scratch.states[q] = state if seen else -1
        scratch.cohorts[q], scratch.policies[q] = avatars.playback[own].cohort, avatars.policy[own]


@kernel(inline=True)
def _prefetch_targets(model, avatars, due, count, observed, q):
    """Prefetch what some avatars after the ``q``-th one will read of themselves and of their opponents."""
    motion = avatars.motion
    if q + 3 * AHEAD < count:
        own, nearest = due[q + 3 * AHEAD], max(observed.opponents[q + 3 * AHEAD], 0)
        prefetch_avatar(avatars, own)
        prefetch(avatars.fight, own)
        prefetch_avatar(avatars, nearest)
    if q + 2 * AHEAD < count:
        prefetch(avatars.slot_of, max(avatars.opponent[due[q + 2 * AHEAD]], 0))
    if q + AHEAD < count:
        old, nearest = avatars.slot_of[max(avatars.opponent[due[q + AHEAD]], 0)], max(observed.opponents[q + AHEAD], 0)
        prefetch_avatar(avatars, old)
        action, stride = motion[nearest].action, model.policies[avatars.policy[nearest]].stride
        first, end = model.actions[action].origin, model.actions[action].length * stride
        prefetch(model.bodies, first + int(motion[nearest].phase) * stride)
        prefetch(model.bodies, first + end)
        prefetch(model.ground, first + end)


@kernel(inline=True)
def _scripted_target(targets, moment, target):
    """Return a scripted target, which moves on for ever."""
    x, y, z = targets[moment, target, 0], targets[moment, target, 1], targets[moment, target, 2]
    return Target(x, y, z, x - targets[moment - 1, target, 0], z - targets[moment - 1, target, 2], math.inf)


@kernel(inline=True)
def _meet(avatars, own, targets, moment, target):
    """Return a scripted target where it is, or, if it is out of reach, where an avatar can meet it at a walk."""
    x, z = position_of(avatars, own)
    scale = np.float64(avatars.playback[own].scale)
    step, frames = WALKS * scale * avatars.motion[own].speed, 0
    while frames < FORESEEN:
        dx, dz = targets[moment + frames, target, 0] - x, targets[moment + frames, target, 2] - z
        if math.sqrt(dx * dx + dz * dz) <= AT_HAND * scale + step * frames:
            break
        frames += 1
    if frames == 0:
        return _scripted_target(targets, moment, target)
    there = targets[moment + frames, target]
    return Target(there[0], there[1], there[2], 0.0, 0.0, 0.0)


@kernel(inline=True)
def _head_of(model, avatars, j):
    """Return an avatar's head, which moves to where it is at the end of its action."""
    motion = avatars.motion
    actions, bodies = model.actions, model.bodies
    action = motion[j].action
    done = min(motion[j].phase, actions[action].length)
    frame = actions[action].origin + done * model.policies[avatars.policy[j]].stride
    size = np.float64(avatars.playback[j].scale)
    hx, hz = between(bodies, frame, HEAD, 0) * size, between(bodies, frame, HEAD, 2) * size
    cos, sin = cos_sin(avatars.heading[j])
    x, z = avatars.x[j] + hx * cos + hz * sin, avatars.z[j] - hx * sin + hz * cos
    y = between(bodies, frame, HEAD, 1) * size
    lasts = (actions[action].length - done) / motion[j].speed
    vx, vz = 0.0, 0.0
    if lasts > 0.0:
        stride = model.policies[avatars.policy[j]].stride
        end = actions[action].origin + actions[action].length * stride
        cos, sin = cos_sin(avatars.playback[j].base_turn + model.ground[end].heading)
        hx, hz = bodies[end, HEAD, 0] * size, bodies[end, HEAD, 2] * size
        vx = (motion[j].end_x + hx * cos + hz * sin - x) / lasts
        vz = (motion[j].end_z - hx * sin + hz * cos - z) / lasts
    return Target(x, y, z, vx, vz, lasts)


@kernel(inline=True)
def _write_situation(avatars, own, target, out_situations, q):
    """Write a target as an avatar sees it, for a body of scale 1 and in its own frames of motion."""
    motion = avatars.motion
    scale, speed = np.float64(avatars.playback[own].scale), np.float64(motion[own].speed)
    cos, sin = cos_sin(avatars.heading[own])
    situation = out_situations[q]
    dx, dz = (target.x - avatars.x[own]) / scale, (target.z - avatars.z[own]) / scale
    situation.x = dx * cos - dz * sin
    situation.y = target.y / scale
    situation.z = dx * sin + dz * cos
    dx, dz = target.vx / (scale * speed), target.vz / (scale * speed)
    situation.vx = dx * cos - dz * sin
    situation.vz = dx * sin + dz * cos
    situation.lasts = target.lasts * speed

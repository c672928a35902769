"""Value of actions that lead to a strike on a scripted target, whose path is known in advance."""

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.bodies import lands_on_posed_body
from crowdsim.core.mathematics import atan2
from crowdsim.crowd.kernels.layout import FORESEEN
from crowdsim.crowd.kernels.outcomes import ball_at
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel

AIM = 4.0  # value of a strike that will land
SET_UP = 0.75  # share of a value that is left one action earlier
AIMED = 4.0  # distance up to which a target is aimed at, as far as the actions of a plan and the target lead [m]
DEPTH = 3  # how many actions a plan has before its strike


@kernel(inline=True)
def aim_at_target(model, avatars, world, now, own, observed, q, scratch):
    """Add to the values of actions by how soon a strike can land on the avatar's scripted target.

    A strike that will land is worth ``AIM``. Any other action is worth ``SET_UP`` times the best plan that can follow
    it, of up to ``DEPTH`` actions and a strike.
    """
    target, values = avatars.fight[own].next_opponent, scratch.values[q]
    if target > -2 or world.crowding.at_air <= 0.0:
        return
    actions, state = model.actions, model.actions[avatars.motion[own].action].next
    size = np.float64(avatars.playback[own].scale)
    x, z = position_of(avatars, own)
    start = x, z, np.float64(avatars.heading[own])
    ball = world.targets[now.moment, -2 - target]
    near = (ball[0] - x) ** 2 + (ball[2] - z) ** 2 <= AIMED * AIMED * size * size
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        action = model.offsets[state] + k
        if actions[action].strikes < actions[action + 1].strikes:
            lands = near and _lands(model, avatars, world, now, own, action, start, 0.0)
            values[k] += AIM if lands else -world.crowding.at_air
        elif near:
            then, frames = _end_of(model, action, start, size), np.float64(actions[action].length)
            values[k] += AIM * SET_UP * _plan(model, avatars, world, now, own, actions[action].next, then, frames)


@kernel(inline=True)
def _end_of(model, action, start, size):
    """Return the position and the heading at the end of an action that begins at ``start``."""
    cos, sin = cos_sin(start[2])
    move = model.moves[action]
    x, z = move.x * size, move.z * size
    return start[0] + x * cos + z * sin, start[1] - x * sin + z * cos, start[2] + atan2(move.sin, move.cos)


@kernel
def _strike(model, avatars, world, now, own, state, start, frames):
    """Return 1 where a strike of a state lands, else 0; see ``_lands``."""
    actions, first, end = model.actions, np.int64(model.offsets[state]), np.int64(model.offsets[state + 1])
    if actions[first].strikes < actions[end].strikes:
        for action in range(first, end):
            if _lands(model, avatars, world, now, own, action, start, frames):
                return 1.0
    return 0.0


def _after_another(plan, depth):
    """Return a kernel that looks for a strike that lands, or for an action that others of a plan follow."""

    def look(model, avatars, world, now, own, state, start, frames):
        best = _strike(model, avatars, world, now, own, state, start, frames)
        if best > 0.0:
            return best
        actions, size = model.actions, np.float64(avatars.playback[own].scale)
        for action in range(np.int64(model.offsets[state]), np.int64(model.offsets[state + 1])):
            if best == 1.0:
                break
            if actions[action].strikes == actions[action + 1].strikes:
                then, length = _end_of(model, action, start, size), np.float64(actions[action].length)
                best = max(best, plan(model, avatars, world, now, own, actions[action].next, then, frames + length))
        return SET_UP * best

    return kernel(look, name=f"plan_{depth}")


_plan = _strike
for _depth in range(2, DEPTH + 1):
    _plan = _after_another(_plan, _depth)


@kernel(inline=True)
def _lands(model, avatars, world, now, own, action, start, frames):
    """Return whether the first strike of an action lands on an avatar's scripted target, along its path.

    The action starts at a position and heading, after some frames of motion.
    """
    first, target = model.actions[action].strikes, avatars.fight[own].next_opponent
    if first == model.actions[action + 1].strikes:
        return False
    size, strike, motion = np.float64(avatars.playback[own].scale), model.strikes[first], avatars.motion[own]
    cos, sin = cos_sin(start[2])
    fx, fz = strike.x * size, strike.z * size
    point = start[0] + fx * cos + fz * sin, strike.y * size, start[1] - fx * sin + fz * cos
    # Frames of the next action that have passed already, see ``advance.switch``.
    begun = min(motion.phase - model.actions[motion.action].length, motion.speed)
    ahead = (frames + strike.time - begun) / motion.speed
    if ahead > FORESEEN - 1.0:
        return False
    x, y, z = _foresee(world, now, target, ahead)
    body = ball_at(model, avatars, own, x, y, z)
    return lands_on_posed_body(point, body, model.sizes[avatars.policy[own]].tolerance * size)


@kernel(inline=True)
def _foresee(world, now, target, frames):
    """Return where a scripted target will be in some control frames, up to ``FORESEEN - 1``: x, y and z [m]."""
    frames = max(frames, 0.0)
    moment, share = now.moment + int(frames), frames - int(frames)
    before, after = world.targets[moment, -2 - target], world.targets[moment + 1, -2 - target]
    x, y = before[0] + share * (after[0] - before[0]), before[1] + share * (after[1] - before[1])
    return x, y, before[2] + share * (after[2] - before[2])

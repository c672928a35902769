"""What strikes are worth beside what they earn: more to the aggressive, less between bursts and behind a back."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.bodies import lands_on_posed_body
from crowdsim.core.mathematics import atan2
from crowdsim.crowd.kernels.hidden import is_hidden
from crowdsim.crowd.kernels.intents import is_resting
from crowdsim.crowd.kernels.layout import FIGHTS, FLEES, FORESEEN
from crowdsim.crowd.kernels.outcomes import ball_at
from crowdsim.crowd.kernels.positions import position_of, way_between
from crowdsim.crowd.kernels.vetoes.strike_at_air import strikes_air
from crowdsim.jit import kernel

REST = 4.0  # what a strike costs an avatar that rests, in normalised values
BOLDNESS = 0.2  # how much more a strike is worth to an avatar for each doubling of its aggression
AIM = 2.0  # what a strike is worth that will land on a scripted target
AIMED = 4.0  # distance up to which a scripted target is aimed at, as far as two actions and the target lead [m]
AT_HAND = 1.2  # distance of an opponent beyond which strikes may end short of it [m]
SHORT = 3.0  # what such a strike costs, as a multiple of ``Crowding.wasted``
WALLED = 15.0  # the same in a scenario with obstacles, where all else may cost more than that
STRUCK_AT = 2.5  # distance up to which an opponent may be struck at through an obstacle [m]
SET_UP = 0.6  # what an action is worth that such a strike can follow, of that
AWAY, NEAR = -0.3, 2.0  # where an avatar does not see another: cosine of the bearing; and how near that one is [m]


@kernel(inline=True)
def weigh_strikes(model, avatars, world, now, own, observed, q, scratch):
    """Add to the values of actions for each of their strikes.

    Strikes come in bursts. After a burst an avatar rests until it has recovered, and strikes cost it ``REST``
    meanwhile, as they do while it watches or flees, or an obstacle hides its opponent; and something where that looks
    away, or is out of their reach. Those at a scripted target are worth more that will land on it.
    """
    offsets, opponent = model.offsets, avatars.fight[own].next_opponent
    state = model.actions[avatars.motion[own].action].next
    if opponent > -2 and model.actions[offsets[state]].strikes == model.actions[offsets[state + 1]].strikes:
        return
    rests, bonus = is_resting(avatars, world, now.frame, own), 0.0
    if avatars.conditions.shape[0] > 0:
        row = avatars.conditions[avatars.number[own]]
        rests, bonus = rests or row.does_next != FIGHTS, BOLDNESS * row.aggression
    walled = world.places.parts.shape[0] > 0
    rests = rests or (walled and _is_behind_obstacle(avatars, world, now, own))
    if avatars.fight[own].next_opponent <= -2 and world.crowding.at_air > 0.0:
        _aim_at_ball(model, avatars, world, now, own, scratch.values[q])
    elif avatars.fight[own].next_opponent >= 0 and (walled or not rests):
        _reach_opponent(model, avatars, world, now, own, observed, q, scratch, walled)
    worth = -REST if rests else bonus - world.crowding.unseen * _is_unseen(avatars, now, own)
    if worth != 0.0:
        weigh_by_strikes(model, avatars, own, worth, scratch.values[q])


@kernel(inline=True)
def _reach_opponent(model, avatars, world, now, own, observed, q, scratch, walled):
    """Lower the values of strikes that end far from an avatar's opponent, where that one is not at hand."""
    x, z = scratch.situations[q].x, scratch.situations[q].z
    if x * x + z * z <= AT_HAND * AT_HAND:
        return
    state, short = model.actions[avatars.motion[own].action].next, WALLED if walled else SHORT
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        action = model.offsets[state] + k
        scratch.values[q, k] -= short * strikes_air(model, avatars, world, now, own, observed, q, action)


@kernel(inline=True)
def _is_behind_obstacle(avatars, world, now, own):
    """Return whether an avatar's opponent is hidden from it by an obstacle."""
    opponent = avatars.fight[own].next_opponent
    if opponent < 0 or avatars.slot_of[opponent] >= now.present:
        return False
    j = avatars.slot_of[opponent]
    dx, dz = way_between(avatars, own, j)
    is_near = dx * dx + dz * dz < STRUCK_AT * STRUCK_AT
    return is_near and is_hidden(avatars, world, now.frame, own, *position_of(avatars, j))


@kernel(inline=True)
def weigh_by_strikes(model, avatars, own, worth, values):
    """Add ``worth`` to the values of an avatar's next actions for each of their strikes."""
    actions, state = model.actions, model.actions[avatars.motion[own].action].next
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        action = model.offsets[state] + k
        values[k] += worth * (actions[action + 1].strikes - actions[action].strikes)


@kernel(inline=True)
def _is_unseen(avatars, now, own):
    """Return whether an avatar is close behind its opponent, unless that one flees."""
    opponent = avatars.fight[own].next_opponent
    if opponent < 0:
        return False
    j = avatars.slot_of[opponent]
    if j >= now.present or (avatars.conditions.shape[0] > 0 and avatars.conditions[opponent].does == FLEES):
        return False
    dx, dz = way_between(avatars, j, own)
    far = math.sqrt(dx * dx + dz * dz)
    cos, sin = cos_sin(avatars.heading[j])
    return far < NEAR and dx * sin + dz * cos < AWAY * far


@kernel(inline=True)
def _aim_at_ball(model, avatars, world, now, own, values):
    """Add to the values of an avatar's next actions by when a strike can land on its scripted target after them.

    A strike is worth ``AIM`` where it lands itself. Other actions are worth ``SET_UP`` of that where a strike that may
    follow them lands, and ``SET_UP`` squared where it takes one more action before it.
    """
    actions, state = model.actions, model.actions[avatars.motion[own].action].next
    size = np.float64(avatars.playback[own].scale)
    x, z = position_of(avatars, own)
    start = x, z, np.float64(avatars.heading[own])
    ball = world.targets[now.moment, -2 - avatars.fight[own].next_opponent]
    near = (ball[0] - x) ** 2 + (ball[2] - z) ** 2 <= AIMED * AIMED * size * size
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        action = model.offsets[state] + k
        if actions[action].strikes < actions[action + 1].strikes:
            lands = near and _lands_on_ball(model, avatars, world, now, own, action, start, 0.0)
            values[k] += AIM if lands else -world.crowding.at_air
        elif near:
            then, frames = _end_of(model, action, start, size), np.float64(actions[action].length)
            after = actions[action].next
            if _can_land(model, avatars, world, now, own, after, then, frames):
                values[k] += SET_UP * AIM
            elif _can_set_up(model, avatars, world, now, own, after, then, frames):
                values[k] += SET_UP * SET_UP * AIM


@kernel(inline=True)
def _end_of(model, action, start, size):
    """Return the position and the heading in which an action ends that starts in others."""
    cos, sin = cos_sin(start[2])
    move = model.moves[action]
    x, z = move.x * size, move.z * size
    return start[0] + x * cos + z * sin, start[1] - x * sin + z * cos, start[2] + atan2(move.sin, move.cos)


@kernel(inline=True)
def _can_land(model, avatars, world, now, own, state, start, frames):
    """Return whether an action of a state lands a strike on an avatar's scripted target, see ``_lands_on_ball``."""
    actions, first, end = model.actions, model.offsets[state], model.offsets[state + 1]
    if actions[first].strikes == actions[end].strikes:
        return False
    for action in range(first, end):
        if _lands_on_ball(model, avatars, world, now, own, action, start, frames):
            return True
    return False


@kernel(inline=True)
def _can_set_up(model, avatars, world, now, own, state, start, frames):
    """Return whether an action of a state leads to one that lands a strike on an avatar's scripted target."""
    actions, size = model.actions, np.float64(avatars.playback[own].scale)
    for action in range(model.offsets[state], model.offsets[state + 1]):
        if actions[action].strikes < actions[action + 1].strikes:
            continue
        then = _end_of(model, action, start, size)
        if _can_land(model, avatars, world, now, own, actions[action].next, then, frames + actions[action].length):
            return True
    return False


@kernel(inline=True)
def _lands_on_ball(model, avatars, world, now, own, action, start, frames):
    """Return whether the first strike of an action lands on an avatar's scripted target, along its path.

    The action starts at a position and heading in some frames of motion.
    """
    first, target = model.actions[action].strikes, avatars.fight[own].next_opponent
    size = np.float64(avatars.playback[own].scale)
    if first == model.actions[action + 1].strikes:
        return False
    strike = model.strikes[first]
    ahead = min(int((frames + strike.time) / avatars.motion[own].speed + 0.5), FORESEEN)
    cos, sin = cos_sin(start[2])
    fx, fz = strike.x * size, strike.z * size
    point = start[0] + fx * cos + fz * sin, strike.y * size, start[1] - fx * sin + fz * cos
    ball = world.targets[now.moment + ahead, -2 - target]
    body = ball_at(model, avatars, own, ball[0], ball[1], ball[2])
    return lands_on_posed_body(point, body, model.sizes[avatars.policy[own]].tolerance * size)

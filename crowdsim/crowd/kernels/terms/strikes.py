"""What strikes are worth beside what they earn: more to the aggressive, less between bursts and behind a back."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.hidden import is_hidden
from crowdsim.crowd.kernels.intents import is_resting
from crowdsim.crowd.kernels.layout import FIGHTS, FLEES
from crowdsim.crowd.kernels.positions import position_of, way_between
from crowdsim.crowd.kernels.vetoes.strike_at_air import strikes_air
from crowdsim.jit import kernel

REST = 4.0  # what a strike costs an avatar that rests, in normalised values
BOLDNESS = 0.2  # how much more a strike is worth to an avatar for each doubling of its aggression
AT_HAND = 1.2  # distance of an opponent beyond which strikes may end short of it [m]
SHORT = 3.0  # what such a strike costs, as a multiple of ``Crowding.wasted``
WALLED = 15.0  # the same in a scenario with obstacles, where all else may cost more than that
STRUCK_AT = 2.5  # distance up to which an opponent may be struck at through an obstacle [m]
AWAY, NEAR = -0.3, 2.0  # where an avatar does not see another: cosine of the bearing; and how near that one is [m]


@kernel(inline=True)
def weigh_strikes(model, avatars, world, now, own, observed, q, scratch):
    """Add to the values of actions for each of their strikes.

    Strikes come in bursts. After a burst an avatar rests until it has recovered, and strikes cost it ``REST``
    meanwhile, as they do while it watches or flees, or an obstacle hides its opponent; and something where that looks
    away, or is out of their reach.
    """
    offsets, opponent = model.offsets, avatars.fight[own].next_opponent
    state = model.actions[avatars.motion[own].action].next
    if model.actions[offsets[state]].strikes == model.actions[offsets[state + 1]].strikes:
        return
    rests, bonus = is_resting(avatars, world, now.frame, own), 0.0
    if avatars.conditions.shape[0] > 0:
        row = avatars.conditions[avatars.number[own]]
        rests, bonus = rests or row.does_next != FIGHTS, BOLDNESS * row.aggression
    walled = world.places.parts.shape[0] > 0
    rests = rests or (walled and _is_behind_obstacle(avatars, world, now, own))
    if opponent >= 0 and (walled or not rests):
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
    j = np.int64(avatars.slot_of[opponent])
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
    j = np.int64(avatars.slot_of[opponent])
    if j >= now.present or (avatars.conditions.shape[0] > 0 and avatars.conditions[opponent].does == FLEES):
        return False
    dx, dz = way_between(avatars, j, own)
    far = math.sqrt(dx * dx + dz * dz)
    cos, sin = cos_sin(avatars.heading[j])
    return far < NEAR and dx * sin + dz * cos < AWAY * far

"""What strikes are worth beside what they earn: more to the aggressive, less between bursts and behind a back."""

import math

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.intents import is_resting
from crowdsim.crowd.kernels.layout import FIGHTS, FLEES
from crowdsim.jit import kernel

REST = 4.0  # what a strike costs an avatar that rests, in normalised values
BOLDNESS = 0.2  # how much more a strike is worth to an avatar for each doubling of its aggression
AWAY, NEAR = -0.3, 2.0  # where an avatar does not see another: cosine of the bearing; and how near that one is [m]


@kernel(inline=True)
def weigh_strikes(model, avatars, world, now, own, observed, q, scratch):
    """Add to the values of actions for each of their strikes.

    Strikes come in bursts. After a burst an avatar rests until it has recovered, and strikes cost it ``REST``
    meanwhile, as they do while it watches or flees; and something where its opponent looks away.
    """
    rests, bonus = is_resting(avatars, world, now.frame, own), 0.0
    if avatars.conditions.shape[0] > 0:
        row = avatars.conditions[avatars.number[own]]
        rests, bonus = rests or row.does_next != FIGHTS, BOLDNESS * row.aggression
    worth = -REST if rests else bonus - world.crowding.unseen * _is_unseen(avatars, now, own)
    if worth != 0.0:
        weigh_by_strikes(model, avatars, own, worth, scratch.values[q])


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
    dx, dz = avatars.x[own] - avatars.x[j], avatars.z[own] - avatars.z[j]
    far = math.sqrt(dx * dx + dz * dz)
    cos, sin = cos_sin(avatars.heading[j])
    return far < NEAR and dx * sin + dz * cos < AWAY * far

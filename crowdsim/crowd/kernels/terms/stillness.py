"""Stillness: what actions are worth in which the body is still, between bursts of strikes."""

import math

from crowdsim.crowd.kernels.intents import is_resting
from crowdsim.crowd.kernels.layout import FIGHTS
from crowdsim.jit import kernel

CALM = 0.6  # what an action is worth in which the body is still all the time, in normalised values
FACING, BESIDE = 0.6, 1.2  # where the opponent is then: cosine of its bearing, distance [m]


@kernel(inline=True)
def favour_stillness(model, avatars, world, now, own, observed, q, scratch):
    """Raise the values of actions in which the body is still, if an avatar rests that fights an opponent at hand."""
    if avatars.fight[own].next_opponent < 0 or not is_resting(avatars, world, now.frame, own):
        return
    if avatars.conditions.shape[0] > 0 and avatars.conditions[avatars.number[own]].does_next != FIGHTS:
        return
    x, z = scratch.situations[q].x, scratch.situations[q].z
    far = math.sqrt(x * x + z * z)
    if z >= FACING * far and far <= BESIDE:
        state = model.actions[avatars.motion[own].action].next
        for k in range(model.offsets[state + 1] - model.offsets[state]):
            scratch.values[q, k] += CALM * model.calm[model.offsets[state] + k]

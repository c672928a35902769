"""Stillness: what actions are worth in which the body is still, between bursts of strikes."""

import math

from crowdsim.crowd.kernels.intents import is_resting
from crowdsim.crowd.kernels.layout import (
    ACTION,
    DOES_NEXT,
    FIGHTS,
    NEXT,
    NEXT_OPPONENT,
    NUMBER,
    TARGET_X,
    TARGET_Z,
)
from crowdsim.jit import kernel

CALM = 0.6  # what an action is worth in which the body is still all the time, in normalised values
FACING, BESIDE = 0.6, 1.2  # where the opponent is then: cosine of its bearing, distance [m]


@kernel(inline=True)
def favour_stillness(model, avatars, world, now, own, observed, q, scratch):
    """Raise the values of actions in which the body is still, if an avatar rests that fights an opponent at hand."""
    whole = avatars.whole
    if whole[NEXT_OPPONENT, own] < 0 or not is_resting(avatars, world, now.frame, own):
        return
    if avatars.conditions.shape[0] > 0 and avatars.conditions[whole[NUMBER, own], DOES_NEXT] != FIGHTS:
        return
    x, z = scratch.situations[q, TARGET_X], scratch.situations[q, TARGET_Z]
    far = math.sqrt(x * x + z * z)
    if z >= FACING * far and far <= BESIDE:
        state = model.actions[whole[ACTION, own], NEXT]
        for k in range(model.offsets[state + 1] - model.offsets[state]):
            scratch.values[q, k] += CALM * model.calm[model.offsets[state] + k]

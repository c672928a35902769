"""Pace: what it costs an avatar that travels to go slower or faster than it should, or to strike."""

import math

from crowdsim.crowd.kernels.layout import TRAVELS
from crowdsim.jit import kernel

OFF_PACE = 20.0  # what it costs to be a metre in a control frame slower or faster, in normalised values
AT_NOBODY = 8.0  # what a strike costs it, beside what it costs all that do not fight


@kernel(inline=True)
def keep_pace(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions by how far off its pace they bring an avatar to its point, and by their strikes."""
    if avatars.conditions.shape[0] == 0 or avatars.conditions[avatars.number[own]].does_next != TRAVELS:
        return
    pace, speed = avatars.conditions[avatars.number[own]].pace, avatars.motion[own].speed
    x, z = scratch.situations[q].x, scratch.situations[q].z
    far = max(math.sqrt(x * x + z * z), 1e-6)
    state = model.actions[avatars.motion[own].action].next
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        action = model.offsets[state] + k
        along = (model.moves[action].x * x + model.moves[action].z * z) / far
        frames = model.actions[action].length / speed
        scratch.values[q, k] -= OFF_PACE * abs(along / frames - pace)
        scratch.values[q, k] -= AT_NOBODY * (model.actions[action + 1].strikes - model.actions[action].strikes)

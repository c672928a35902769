"""Stunned: what strikes cost an avatar that a hit has stunned. It may step, guard and be pushed meanwhile."""

import math

import numpy as np

from crowdsim.jit import kernel

STUNS, LONGEST = 18.0, 27.0  # for how long a strong hit stuns, by its strength, and the strongest [control frames]


@kernel(inline=True)
def hold_strikes(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions for each strike that they would throw before the avatar has recovered from a hit."""
    left = stunned_for(avatars, now.frame, own)
    if left <= 0.0 or world.crowding.stunned <= 0.0:
        return
    state, soon = model.actions[avatars.motion[own].action].next, left * avatars.motion[own].speed
    offset = model.offsets[state]
    for k in range(model.actions[offset].strikes, model.actions[model.offsets[state + 1]].strikes):
        if model.strikes[k].time < soon:
            scratch.values[q, int(model.strikes[k].owner)] -= world.crowding.stunned


@kernel(inline=True)
def stunned_for(avatars, frame, own):
    """Return for how much longer the last hit stuns an avatar [control frames]."""
    fight = avatars.fight[own]
    x, z = np.float64(fight.hit_x), np.float64(fight.hit_z)
    strength = math.sqrt(x * x + z * z)
    return min(STUNS * strength, LONGEST) - (frame - fight.hit_frame)

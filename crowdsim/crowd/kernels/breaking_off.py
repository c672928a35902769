"""Breaking off: an avatar leaves its action before a strike whose opponent is about to be out of reach.

It goes on from the state whose pose is most like its own, and so decides anew (``Model.breaks`` and ``Model.leaves``).
"""

import numpy as np

from crowdsim.crowd.kernels.bases import over_ground
from crowdsim.crowd.kernels.layout import NO_STRIKE
from crowdsim.jit import kernel

BEFORE = 2.0  # how long before the last whole frame before a strike an avatar looks whether to break off [frames]
OUT = 0.55  # how far from where its opponent's action ends a strike may end [m]


@kernel(inline=True)
def looks_again(avatars, i, length):
    """Return whether this is the control frame in which an avatar may break off; ``length`` is that of its action."""
    speed, phase = avatars.motion[i].speed, avatars.motion[i].phase
    left = avatars.playback[i].pending - phase - BEFORE
    return (-0.5 * speed < left) & (left <= 0.5 * speed) & (phase < length)


@kernel
def break_off(model, avatars, world, now, looking, out, held):
    """List in ``out``, behind ``held`` others, avatars that break off; return how many are listed then.

    They are among ``looking``, and at the end of an action after that. Of others only what does not change here is
    read, so that their order does not matter; ``out`` may be the array that ends with ``looking``.
    """
    if world.crowding.at_air <= 0.0:
        return held
    motion, playback, actions = avatars.motion, avatars.playback, model.actions
    for q in range(looking.shape[0]):
        i = looking[q]
        old, strike, opponent = motion[i].action, _next_strike(model, avatars, i), avatars.opponent[i]
        new = model.breaks[strike] if strike >= 0 else model.leaves[old]
        if new < 0 or opponent < 0 or avatars.slot_of[opponent] >= now.present:
            continue
        x, z = model.strikes[strike].x + 0.0, model.strikes[strike].z + 0.0
        if strike < 0:
            x, z = strike_after(model, old)
        x, z = over_ground(model, avatars, i, old, False, x, z)
        j = avatars.slot_of[opponent]
        dx, dz = x - motion[j].end_x, z - motion[j].end_z
        if dx * dx + dz * dz <= OUT * OUT:
            continue
        length = actions[new].length
        last = actions[new].origin + length * model.policies[avatars.policy[i]].stride
        motion[i].action, motion[i].phase = new, length
        playback[i].phase_before = max(length - motion[i].speed, 0.0)
        playback[i].base_turn = avatars.heading[i] - model.ground[last].heading
        playback[i].pending = NO_STRIKE
        out[held] = i
        held += 1
    return held


@kernel(inline=True)
def strike_after(model, action):
    """Return where the strike ends that has to follow an action, seen from the start of that."""
    strike, move = model.strikes[model.bound[model.actions[action].next]], model.moves[action]
    return move.x + strike.x * move.cos + strike.z * move.sin, move.z + strike.z * move.cos - strike.x * move.sin


@kernel(inline=True)
def _next_strike(model, avatars, i):
    """Return the row of the next strike of an avatar's action, -1 where it has none left."""
    action, phase = avatars.motion[i].action, avatars.motion[i].phase
    found, soonest = np.int64(-1), NO_STRIKE + 0.0
    for k in range(model.actions[action].strikes, model.actions[action + 1].strikes):
        if phase < model.strikes[k].time < soonest:
            found, soonest = np.int64(k), model.strikes[k].time + 0.0
    return found

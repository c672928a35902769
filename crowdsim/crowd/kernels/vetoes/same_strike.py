"""The same strike at once: an avatar leaves to its opponent what the opponent throws too, or its mirror image."""

import numpy as np

from crowdsim.crowd.kernels.shown_motion import THROWN
from crowdsim.jit import kernel

TWICE, TOGETHER = 4.0, 9  # what such a strike costs, in normalised values; frames within which both end


@kernel(inline=True)
def mirrors_opponent(model, avatars, world, now, own, observed, q, action):
    """Return what an action costs whose strikes the opponent throws too, or their mirror image; 0 for others.

    Motion of the same strike is simultaneous where it ends at about the same time; of two avatars that decide in the
    same frame each may take half of the strikes.
    """
    motion, fight = avatars.motion, avatars.fight
    actions = model.actions
    opponent = fight[own].next_opponent
    strikes = actions[action + 1].strikes - actions[action].strikes
    if strikes == 0 or opponent < 0 or world.cohorts[avatars.playback[own].cohort].variety <= 0.0:
        return 0.0
    j, piece = avatars.slot_of[opponent], np.int64(model.twins[actions[action].next])
    ends = now.frame + np.int64(actions[action].length / motion[own].speed)
    if piece & THROWN == fight[j].thrown and abs(ends - fight[j].thrown_until) < TOGETHER:
        return TWICE
    half = ((piece * 40503 + now.frame * 30011) >> 7) & 1
    decides = motion[j].phase >= actions[motion[j].action].length
    return TWICE if decides and half != (avatars.number[own] > opponent) else 0.0

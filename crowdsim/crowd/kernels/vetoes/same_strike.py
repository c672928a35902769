"""The same strike at once: an avatar leaves to its opponent what the opponent throws too, or its mirror image."""

import numpy as np

from crowdsim.crowd.kernels.layout import (
    ACTION,
    COHORT,
    LENGTH,
    NEXT,
    NEXT_OPPONENT,
    NUMBER,
    PHASE,
    SPEED,
    STRIKES,
    THROWN,
    THROWN_UNTIL,
    VARIETY,
)
from crowdsim.jit import kernel

TWICE, TOGETHER = 4.0, 9  # what such a strike costs, in normalised values; frames within which both end


@kernel(inline=True)
def mirrors_opponent(model, avatars, world, now, own, observed, q, action):
    """Return what an action costs whose strikes the opponent throws too, or their mirror image; 0 for others.

    Motion of the same strike is simultaneous where it ends at about the same time; of two avatars that decide in the
    same frame each may take half of the strikes.
    """
    whole, actions = avatars.whole, model.actions
    opponent = whole[NEXT_OPPONENT, own]
    strikes = actions[action + 1, STRIKES] - actions[action, STRIKES]
    if strikes == 0 or opponent < 0 or world.cohorts[whole[COHORT, own], VARIETY] <= 0.0:
        return 0.0
    j, piece = avatars.slot_of[opponent], np.int64(model.twins[actions[action, NEXT]])
    ends = now.frame + np.int64(actions[action, LENGTH] / avatars.real[SPEED, own])
    if piece == whole[THROWN, j] and abs(ends - whole[THROWN_UNTIL, j]) < TOGETHER:
        return TWICE
    half = ((piece * 40503 + now.frame * 30011) >> 7) & 1
    decides = avatars.real[PHASE, j] >= actions[whole[ACTION, j], LENGTH]
    return TWICE if decides and half != (whole[NUMBER, own] > opponent) else 0.0

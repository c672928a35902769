"""Variety: what actions cost whose motion was shown lately, by the avatar itself or by others around."""

import math

import numpy as np

from crowdsim.crowd.kernels.prefetch import prefetch
from crowdsim.crowd.kernels.shown_motion import LATEST, NONE, age_of, cell_at
from crowdsim.jit import kernel

OTHERS, LATELY = 0.5, 30  # what motion costs that others showed lately, in normalised values; frames that this means
ONE_STANCE = 0.5  # how much that counts for avatars with a stance, for whom there is half as much motion
OWN = 0.25  # what motion costs that is among the avatar's own latest actions
FACING, NEAR = 0.6, 1.2  # where opponents are while variety counts: cosine of the bearing, distance [m]


@kernel(inline=True)
def avoid_repetition(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions whose motion was shown lately, unless the avatar pursues its opponent."""
    actions, marks = model.actions, avatars.marks
    mask = marks.shape[0] - 1
    variety = world.cohorts[avatars.playback[own].cohort].variety
    if variety <= 0.0 or scratch.states[q] < 0 or avatars.fight[own].next_opponent < 0:
        return
    if avatars.conditions.shape[0] > 0 and avatars.conditions[avatars.number[own]].stance > 0.0:
        variety *= ONE_STANCE
    x, z = scratch.situations[q].x, scratch.situations[q].z
    far = math.sqrt(x * x + z * z)
    if z < FACING * far or far > NEAR:
        return  # it turns and pursues by whatever motion there is
    offset = model.offsets[scratch.states[q]]
    n = model.offsets[scratch.states[q] + 1] - offset
    cell, latest = cell_at(avatars, own, 0.0, 0.0), avatars.shown[avatars.number[own]]
    others, mine = variety * OTHERS, variety * OWN
    for k in range(np.uint64(n)):
        state = np.int64(model.twins[actions[np.uint64(offset) + k].next])
        charge = others if age_of(marks[np.uint64((cell + state) & mask)], now.frame) < LATELY else 0.0
        low, again = np.uint8(state % NONE), False
        for m in range(np.uint64(LATEST)):
            again |= latest[m] == low
        scratch.values[q, k] -= charge + (mine if again else 0.0)


@kernel(inline=True)
def prefetch_repetition(model, avatars, world, own, state):
    """Prefetch what ``avoid_repetition`` will read for an avatar that ends its action in a state."""
    if state < 0 or world.cohorts[avatars.playback[own].cohort].variety <= 0.0:
        return
    number, cell = avatars.number[own], cell_at(avatars, own, 0.0, 0.0)
    prefetch(avatars.shown, number)
    for action in range(model.offsets[state], model.offsets[state + 1]):
        prefetch(avatars.marks, (cell + model.twins[model.actions[action].next]) & (avatars.marks.shape[0] - 1))

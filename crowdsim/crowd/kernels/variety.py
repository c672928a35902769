"""Variety: what actions cost whose motion was shown lately, by the avatar itself or by others around.

Actions that end in the same state show the same motion, so motion is known by that state, and a mirror image by that
of what it mirrors. Avatars are not noted: a table has a mark for each cell of the ground and each state, by a hash,
with the frame in which an avatar around last started for it. An avatar reads the marks of its own cell, and makes marks
in the four cells that are nearest. All avatars read marks before any makes one, and those of a frame are equal, so that
their order does not matter. Frames are kept modulo 2 ** 16.
"""

import math

import numpy as np

from crowdsim.crowd.kernels.layout import (
    ACTION,
    AHEAD,
    COHORT,
    DECISIONS,
    LENGTH,
    NEXT,
    NEXT_OPPONENT,
    NUMBER,
    PHASE,
    SPEED,
    STANCE,
    STRIKES,
    TARGET_X,
    TARGET_Z,
    THROWN,
    THROWN_UNTIL,
    VARIETY,
    X,
    Z,
)
from crowdsim.crowd.kernels.prefetch import ask_for
from crowdsim.jit import kernel

OTHERS, LATELY = 0.5, 30  # what motion costs that others showed lately, in normalised values; frames that this means
ONE_STANCE = 0.5  # how much that counts for avatars with a stance, for whom there is half as much motion
OWN, LATEST = 0.25, 16  # what motion costs that is among the avatar's own latest actions; how many these are
CELL = 3.0  # side of a cell [m]
FACING, NEAR = 0.6, 1.2  # where opponents are while variety counts: cosine of the bearing, distance [m]
TWICE, TOGETHER = 4.0, 9  # what a strike costs that the opponent throws too; frames within which it does
FRAMES, NONE = 0xFFFF, 0xFFFF  # frames and states are kept in 16 bits; instead of a state


@kernel(inline=True)
def is_varied(world):
    """Return whether any avatar cares for variety."""
    varied = False
    for cohort in range(world.cohorts.shape[0]):
        varied |= world.cohorts[cohort, VARIETY] > 0.0
    return varied


@kernel(inline=True)
def charge_repetition(model, avatars, world, now, due, count, scratch):
    """Lower the values of actions whose motion was shown lately.

    For avatars ``due[:count]``, with which values run along; those who pursue a target are not concerned.
    """
    whole, actions, marks = avatars.whole, model.actions, avatars.marks
    mask = marks.shape[0] - 1
    if not is_varied(world):
        return
    for q in range(count):
        if q + AHEAD < count:
            _ask_for_charges(model, avatars, due[q + AHEAD], scratch.states[q + AHEAD])
        own = due[q]
        variety = world.cohorts[whole[COHORT, own], VARIETY]
        if variety <= 0.0 or scratch.states[q] < 0 or whole[NEXT_OPPONENT, own] < 0:
            continue
        if avatars.conditions.shape[0] > 0 and avatars.conditions[whole[NUMBER, own], STANCE] > 0.0:
            variety *= ONE_STANCE
        offset = model.offsets[scratch.states[q]]
        n = model.offsets[scratch.states[q] + 1] - offset
        values = scratch.values[q]
        x, z = scratch.situations[q, TARGET_X], scratch.situations[q, TARGET_Z]
        far = math.sqrt(x * x + z * z)
        if z < FACING * far or far > NEAR:
            continue  # it turns and pursues by whatever motion there is
        cell, latest = _cell_at(avatars.real, own, 0.0, 0.0), avatars.shown[whole[NUMBER, own]]
        others, mine = variety * OTHERS, variety * OWN
        for k in range(np.uint64(n)):
            state = np.int64(model.twins[actions[np.uint64(offset) + k, NEXT]])
            age = (now.frame - np.int64(marks[np.uint64((cell + state) & mask)])) & FRAMES
            charge = others if age < LATELY else 0.0
            low, again = np.uint16(state), False
            for m in range(np.uint64(LATEST)):
                again |= latest[m] == low
            values[k] -= charge + (mine if again else 0.0)


@kernel(inline=True)
def _ask_for_charges(model, avatars, own, state):
    """Ask memory for what the actions of a state will be charged by."""
    if state < 0:
        return
    number, cell = avatars.whole[NUMBER, own], _cell_at(avatars.real, own, 0.0, 0.0)
    ask_for(avatars.shown, LATEST * np.int64(number))
    for action in range(model.offsets[state], model.offsets[state + 1]):
        ask_for(avatars.marks, (cell + model.twins[model.actions[action, NEXT]]) & (avatars.marks.shape[0] - 1))


@kernel(inline=True)
def note_shown(model, avatars, frame, i, action):
    """Note the motion of an action that an avatar starts, and its strikes."""
    whole, actions = avatars.whole, model.actions
    state, number = np.int64(model.twins[actions[action, NEXT]]), whole[NUMBER, i]
    mask = avatars.marks.shape[0] - 1
    for corner in range(4):
        cell = _cell_at(avatars.real, i, (corner & 1) - 0.5, (corner >> 1) - 0.5)
        avatars.marks[(cell + state) & mask] = frame & FRAMES
    avatars.shown[number, whole[DECISIONS, i] & (LATEST - 1)] = state & FRAMES
    if actions[action + 1, STRIKES] > actions[action, STRIKES]:
        whole[THROWN, i] = state
        whole[THROWN_UNTIL, i] = frame + np.int64(actions[action, LENGTH] / avatars.real[SPEED, i])


@kernel(inline=True)
def ask_for_marks(model, avatars, i, action):
    """Ask memory for where ``note_shown`` will write."""
    state, number = np.int64(model.twins[model.actions[action, NEXT]]), np.int64(avatars.whole[NUMBER, i])
    ask_for(avatars.shown, LATEST * number + (avatars.whole[DECISIONS, i] & (LATEST - 1)))
    for corner in range(4):
        cell = _cell_at(avatars.real, i, (corner & 1) - 0.5, (corner >> 1) - 0.5)
        ask_for(avatars.marks, (cell + state) & (avatars.marks.shape[0] - 1))


@kernel(inline=True)
def _cell_at(real, i, aside, onwards):
    """Return where the marks of the cell begin that an avatar is in, or that so many sides of a cell from it."""
    column, row = math.floor(real[X, i] / CELL + aside), math.floor(real[Z, i] / CELL + onwards)
    return np.int64(column) * 73856093 ^ np.int64(row) * 19349663


@kernel(inline=True)
def throws_too(model, avatars, world, frame, own, action):
    """Return whether an avatar should leave the strikes of an action to its opponent, which throws them too.

    Or which throws their mirror image. Motion of the same strike is simultaneous where it ends at about the same time;
    of two that decide in the same frame each may take half of the strikes.
    """
    whole, actions = avatars.whole, model.actions
    opponent = whole[NEXT_OPPONENT, own]
    strikes = actions[action + 1, STRIKES] - actions[action, STRIKES]
    if strikes == 0 or opponent < 0 or world.cohorts[whole[COHORT, own], VARIETY] <= 0.0:
        return False
    j, piece = avatars.slot_of[opponent], np.int64(model.twins[actions[action, NEXT]])
    ends = frame + np.int64(actions[action, LENGTH] / avatars.real[SPEED, own])
    if piece == whole[THROWN, j] and abs(ends - whole[THROWN_UNTIL, j]) < TOGETHER:
        return True
    half = ((piece * 40503 + frame * 30011) >> 7) & 1
    return avatars.real[PHASE, j] >= actions[whole[ACTION, j], LENGTH] and half != (whole[NUMBER, own] > opponent)

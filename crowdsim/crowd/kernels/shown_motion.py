"""Which motion was shown lately: by each avatar itself, and by others around.

Actions that end in the same state show the same motion, so motion is known by that state, and a mirror image by that
of what it mirrors. Avatars are not noted: a table has a mark for each cell of the ground and each state, by a hash,
with the frame in which an avatar around last started for it. An avatar reads the marks of its own cell, and makes marks
in the four cells that are nearest. All avatars read marks before any makes one, and those of a frame are equal, so that
their order does not matter. Frames are kept modulo 256, and marks that are too old to be told from new ones then are
renewed, a few in each frame.
"""

import math

import numpy as np

from crowdsim.crowd.kernels.prefetch import prefetch
from crowdsim.jit import kernel

LATEST = 16  # how many of an avatar's own latest actions are known
CELL = 3.0  # side of a cell [m]
NONE = 0xFF  # an avatar's own states are kept modulo this, in 8 bits; instead of a state
THROWN = 0x7FFF  # states of strikes are kept in 15 bits
FRAMES = 0xFF  # frames are kept in 8 bits
LONG_AGO, RENEWED = 128, 64  # age of marks that are not known any more; in how many frames all of them are looked at


@kernel(inline=True)
def is_varied(world):
    """Return whether any avatar cares for variety."""
    varied = False
    for cohort in range(world.cohorts.shape[0]):
        varied |= world.cohorts[cohort].variety > 0.0
    return varied


@kernel(inline=True)
def age_of(mark, frame):
    """Return how many frames ago a mark was made; ``RENEWED`` or more for long ago."""
    return (frame - np.int64(mark)) & FRAMES


@kernel(inline=True)
def marks_of(marks, frame):
    """Return the range of marks whose turn it is in a frame."""
    count = marks.shape[0] // RENEWED
    return (frame % RENEWED) * count, (frame % RENEWED + 1) * count


@kernel(inline=True)
def renew(marks, frame, k):
    """Let a mark stay old that is."""
    marks[k] = (frame - LONG_AGO) & FRAMES if age_of(marks[k], frame) >= RENEWED else np.int64(marks[k])


@kernel
def renew_marks(marks, frame):
    """Renew the marks whose turn it is in a frame."""
    first, last = marks_of(marks, frame)
    for k in range(np.uint64(first), np.uint64(last)):  # no index from the end, so that the loop vectorises
        renew(marks, frame, k)


@kernel(inline=True)
def note_shown(model, avatars, frame, i, action):
    """Note the motion of an action that an avatar starts, and its strikes."""
    fight = avatars.fight
    actions = model.actions
    state, number = np.int64(model.twins[actions[action].next]), avatars.number[i]
    mask = avatars.marks.shape[0] - 1
    for corner in range(4):
        cell = cell_at(avatars, i, (corner & 1) - 0.5, (corner >> 1) - 0.5)
        avatars.marks[(cell + state) & mask] = frame & FRAMES
    avatars.shown[number, fight[i].decisions & (LATEST - 1)] = state % NONE
    if actions[action + 1].strikes > actions[action].strikes:
        fight[i].thrown = state & THROWN
        fight[i].thrown_until = frame + np.int64(actions[action].length / avatars.motion[i].speed)


@kernel(inline=True)
def prefetch_marks(model, avatars, i, action):
    """Prefetch where ``note_shown`` will write."""
    state, number = np.int64(model.twins[model.actions[action].next]), np.int64(avatars.number[i])
    prefetch(avatars.shown, number)
    for corner in range(4):
        cell = cell_at(avatars, i, (corner & 1) - 0.5, (corner >> 1) - 0.5)
        prefetch(avatars.marks, (cell + state) & (avatars.marks.shape[0] - 1))


@kernel(inline=True)
def cell_at(avatars, i, aside, onwards):
    """Return where the marks of the cell begin that an avatar is in, or that so many sides of a cell from it."""
    column, row = math.floor(avatars.x[i] / CELL + aside), math.floor(avatars.z[i] / CELL + onwards)
    return np.int64(column) * 73856093 ^ np.int64(row) * 19349663

"""Backs: what actions cost that let an avatar be backed into an obstacle by its opponent.

Those that lead along the obstacle, or around the opponent, are worth more: an avatar turns out of the corner.
"""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.layout import FIGHTS
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.crowd.kernels.travelling import travels
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import cell_at, may_be_near, part_gap, stands

BACKED = 3.0  # what it costs to have an obstacle right behind, and the opponent ahead, in normalised values
BEHIND = 1.1  # how far from obstacles that costs nothing, for a scale of 1 [m]
NEAR = 2.5  # how far away the opponent is at most, for a scale of 1 [m]


@kernel(inline=True)
def turn_out(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions that end between an obstacle and an opponent near by."""
    opponent, size = avatars.fight[own].next_opponent, np.float64(avatars.playback[own].scale)
    if world.places.parts.shape[0] == 0 or opponent < 0 or travels(avatars, own):
        return
    if avatars.conditions.shape[0] > 0 and avatars.conditions[avatars.number[own]].does_next != FIGHTS:
        return
    x, z = position_of(avatars, own)
    other = avatars.slot_of[opponent]
    dx, dz = avatars.x[other] - x, avatars.z[other] - z
    if dx * dx + dz * dz > (NEAR * size) ** 2:
        return
    state = model.actions[avatars.motion[own].action].next
    if may_be_near(world.places, x, z, model.reaches[state] * size + BEHIND * size):
        _add_backs(model, avatars, world.places, now.frame, own, state, dx, dz, scratch.values[q])


@kernel
def _add_backs(model, avatars, places, frame, own, state, dx, dz, values):
    """Lower the values of actions that end before the nearest obstacle behind; the opponent is at (dx, dz)."""
    x, z = position_of(avatars, own)
    size = np.float64(avatars.playback[own].scale)
    least, nx, nz, cell = (model.reaches[state] + BEHIND) * size, 0.0, 0.0, cell_at(places.grid, x, z)
    for m in range(places.offsets[cell], places.offsets[cell + 1]):
        if places.gaps[m] >= least:
            break
        part = places.parts[places.listed[m]]
        if stands(part, frame):
            gap, px, pz = part_gap(part, x, z)
            if gap < least and px * dx + pz * dz > 0.0:
                least, nx, nz = gap, px, pz
    if nx == 0.0 and nz == 0.0:
        return
    cos, sin = cos_sin(avatars.heading[own])
    cos, sin = cos * size, sin * size
    offset = np.uint64(model.offsets[state])
    # Without branches: the processor cannot predict which actions end near the obstacle. Unsigned, since numba adds a
    # branch for indices that may be negative.
    for k in range(np.uint64(model.offsets[state + 1]) - offset):
        move = model.moves[offset + k]
        ex, ez = move.x * cos + move.z * sin, move.z * cos - move.x * sin
        near = max(1.0 - max(least + ex * nx + ez * nz, 0.0) / (BEHIND * size), 0.0)
        to_x, to_z = dx - ex, dz - ez
        ahead = max(to_x * nx + to_z * nz, 0.0)
        values[k] -= BACKED * near * ahead / max(math.sqrt(to_x * to_x + to_z * to_z), 1e-6)

"""Facing: what actions cost that end turned away from an opponent near by.

Learned values know that too, but in a throng what collisions cost outweighs them.
"""

import math

from crowdsim.crowd.kernels.layout import FIGHTS, NOTICES, RESTS, WATCHES
from crowdsim.jit import kernel

TURNED = 5.0  # what a unit of the cosine costs, in normalised values
FROM = 0.3  # cosine of the bearing of the opponent from which on it costs something
THRONG = 2  # how many neighbours make a throng
NEAR = 3.0  # distance of an opponent up to which an avatar faces it [m]


@kernel(inline=True)
def face_opponent(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions that end turned away from an opponent near by, in a throng or noticed."""
    if avatars.fight[own].next_opponent < 0:
        return
    does = FIGHTS
    if avatars.conditions.shape[0] > 0:
        row = avatars.conditions[avatars.number[own]]
        # An avatar that steps back to rest faces its opponent as one that notices does.
        does = NOTICES if row.mode == RESTS and row.does_next == WATCHES else row.does_next
    if does != NOTICES and (does != FIGHTS or observed.counts[q] < THRONG or world.crowding.end_cost == 0.0):
        return
    seen = scratch.situations[q]
    if seen.x * seen.x + seen.z * seen.z > NEAR * NEAR:
        return
    state = model.actions[avatars.motion[own].action].next
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        action = model.offsets[state] + k
        move = model.moves[action]
        frames = min(float(model.actions[action].length), seen.lasts)
        dx, dz = seen.x + seen.vx * frames - move.x, seen.z + seen.vz * frames - move.z
        far = math.sqrt(dx * dx + dz * dz)
        away = FROM - (dx * move.sin + dz * move.cos) / max(far, 1e-6)
        scratch.values[q, k] -= TURNED * max(away, 0.0)

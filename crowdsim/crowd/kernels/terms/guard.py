"""Guard: what actions cost near an opponent in which hands hang that are up where strikes are thrown."""

from crowdsim.crowd.kernels.layout import FIGHTS, NOTICES
from crowdsim.jit import kernel

DROPPED = 2.0  # what a second without guard costs, in normalised values
NEAR = 2.0  # distance of an opponent up to which an avatar keeps its guard [m]


@kernel(inline=True)
def keep_guard(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions by how long hands hang in and behind them, near an opponent fought or noticed."""
    if avatars.fight[own].next_opponent < 0:
        return
    if avatars.conditions.shape[0] > 0:
        does = avatars.conditions[avatars.number[own]].does_next
        if does not in (FIGHTS, NOTICES):
            return
    x, z = scratch.situations[q].x, scratch.situations[q].z
    if x * x + z * z <= NEAR * NEAR:
        state = model.actions[avatars.motion[own].action].next
        for k in range(model.offsets[state + 1] - model.offsets[state]):
            scratch.values[q, k] -= DROPPED * model.unguarded[model.offsets[state] + k]

"""The way to a rest: what it costs an avatar that is to rest to be further from where one begins."""

from crowdsim.crowd.kernels.layout import RESTS
from crowdsim.jit import kernel

TOWARDS = 1.0  # what an action more until a rest begins costs, in normalised values


@kernel(inline=True)
def seek_rest(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions by how many more lead to a rest, where the avatar is to rest."""
    if avatars.conditions.shape[0] == 0 or model.ways_to_rest.shape[0] == 0:
        return
    if avatars.conditions[avatars.number[own]].does_next != RESTS:
        return
    state = model.actions[avatars.motion[own].action].next
    for k in range(model.offsets[state + 1] - model.offsets[state]):
        until = model.ways_to_rest[model.actions[model.offsets[state] + k].next].until
        scratch.values[q, k] -= TOWARDS * until

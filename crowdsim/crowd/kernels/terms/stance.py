"""Stance: what actions cost an avatar that lead away from its stance."""

from crowdsim.jit import kernel

ASTRAY = 1.0  # what it costs an avatar to be an action further from its stance, in normalised values


@kernel(inline=True)
def keep_stance(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions by how many more lead to the avatar's stance."""
    if avatars.conditions.shape[0] == 0:
        return
    stance = int(avatars.conditions[avatars.number[own]].stance)
    if stance > 0:
        state = model.actions[avatars.motion[own].action].next
        for k in range(model.offsets[state + 1] - model.offsets[state]):
            scratch.values[q, k] -= ASTRAY * model.stances[model.actions[model.offsets[state] + k].next, stance - 1]

"""What actions are worth by the policy's tables; of avatars without an opponent, that captured motion continues."""

from crowdsim.crowd.kernels.values import value_actions
from crowdsim.jit import kernel

SORTED = 256  # from this many deciding avatars on, actions are evaluated in the order of states


@kernel(inline=True)
def look_up(model, avatars, world, due, count, scratch):
    """Write what actions are worth to avatars ``due[:count]``, where other terms add to it.

    Situations are written in the order of storage, in which neighbours lie together; where there are many, actions are
    evaluated in the order of states.
    """
    if count >= SORTED:
        order_by_state(scratch.states, count, scratch.starts, scratch.order)
    else:
        for q in range(count):
            scratch.order[q] = q
    value_actions(model, world.weights, scratch, 0, count)
    for q in range(count):
        if scratch.states[q] < 0:
            state = model.actions[avatars.motion[due[q]].action].next
            for k in range(model.offsets[state + 1] - model.offsets[state]):
                scratch.values[q, k] = -model.moves[model.offsets[state] + k].cost


@kernel
def order_by_state(states, count, starts, out_order):
    """List the places of ``states[:count]`` by state; ``starts`` (S + 2,) is scratch.

    Avatars that choose among the same actions come one after another, so that these are read from memory once.
    """
    for state in range(starts.shape[0]):
        starts[state] = 0
    for q in range(count):
        starts[states[q] + 2] += 1
    for state in range(1, starts.shape[0]):
        starts[state] += starts[state - 1]
    for q in range(count):
        place = states[q] + 1
        out_order[starts[place]] = q
        starts[place] += 1

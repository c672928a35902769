"""The decisions of avatars: each observes, evaluates its next actions, and chooses one."""

from crowdsim.crowd.kernels.choose import choose
from crowdsim.crowd.kernels.evaluate import evaluate, evaluate_by_terms
from crowdsim.crowd.kernels.observe import observe
from crowdsim.jit import kernel


@kernel(inline=True)
def decide(model, avatars, world, now, due, count, observed, scratch, out_chosen):
    """Choose an opponent and the next action for avatars ``due[:count]``, at most as many as ``scratch`` has room for.

    Observations run along with ``due``, as the chosen actions do. Returns -1, or the slot of an avatar whose values are
    not numbers.
    """
    observe(model, avatars, world, now, due, count, observed, scratch)
    evaluate(model, avatars, world, now, due, count, observed, scratch)
    return choose(model, avatars, world, now, due, count, observed, scratch, out_chosen)


@kernel
def explain(model, avatars, world, now, due, count, observed, scratch, out_chosen, notes):
    """Do what ``decide`` does, and note what actions are worth (``evaluate_by_terms``)."""
    observe(model, avatars, world, now, due, count, observed, scratch)
    evaluate_by_terms(model, avatars, world, now, due, count, observed, scratch, notes)
    return choose(model, avatars, world, now, due, count, observed, scratch, out_chosen)

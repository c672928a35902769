"""What the next actions of avatars are worth: the sum of the value terms, which are listed here."""

from crowdsim.crowd.kernels.layout import AHEAD
from crowdsim.crowd.kernels.terms.collision_avoidance import avoid_collisions
from crowdsim.crowd.kernels.terms.defence import defend
from crowdsim.crowd.kernels.terms.facing import face_opponent
from crowdsim.crowd.kernels.terms.guard import keep_guard
from crowdsim.crowd.kernels.terms.look_up import look_up
from crowdsim.crowd.kernels.terms.pace import keep_pace
from crowdsim.crowd.kernels.terms.rest import seek_rest
from crowdsim.crowd.kernels.terms.stance import keep_stance
from crowdsim.crowd.kernels.terms.stillness import favour_stillness
from crowdsim.crowd.kernels.terms.strikes import weigh_strikes
from crowdsim.crowd.kernels.terms.stunned import hold_strikes
from crowdsim.crowd.kernels.terms.variety import avoid_repetition, prefetch_repetition
from crowdsim.jit import kernel

TERMS = (
    "learned", "collisions", "repetition", "defence", "rest", "strikes", "stun", "stillness", "facing", "guard",
    "stance", "pace",
)  # fmt: skip
"""Names of the terms, in the order in which they are noted."""


@kernel(inline=True)
def evaluate(model, avatars, world, now, due, count, observed, scratch):
    """Write into ``scratch.values`` what the next actions of avatars ``due[:count]`` are worth to them."""
    look_up(model, avatars, world, due, count, scratch)
    for q in range(count):
        if q + AHEAD < count:
            prefetch_repetition(model, avatars, world, due[q + AHEAD], scratch.states[q + AHEAD])
        own = due[q]
        noted = _note(scratch, 0, q)
        avoid_collisions(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        avoid_repetition(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        defend(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        seek_rest(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        weigh_strikes(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        hold_strikes(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        favour_stillness(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        face_opponent(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        keep_guard(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        keep_stance(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)
        keep_pace(model, avatars, world, now, own, observed, q, scratch)
        noted = _note(scratch, noted, q)


@kernel(inline=True)
def _note(scratch, noted, q):
    """Note what actions are worth by the terms so far, where that is asked for; return how many have been noted."""
    if scratch.notes.shape[0] > 0:
        for k in range(scratch.values.shape[1]):
            scratch.notes[noted, q, k] = scratch.values[q, k]
    return noted + 1

"""What the next actions of avatars are worth: the sum of the value terms, which are listed here."""

from crowdsim.crowd.kernels.layout import AHEAD
from crowdsim.crowd.kernels.terms.backs import turn_out
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
    "stance", "pace", "backs",
)  # fmt: skip
"""Names of the terms, by their numbers."""


@kernel(inline=True)
def evaluate(model, avatars, world, now, due, count, observed, scratch):
    """Write into ``scratch.values`` what the next actions of avatars ``due[:count]`` are worth to them."""
    look_up(model, avatars, world, due, count, scratch)
    for q in range(count):
        if q + AHEAD < count:
            prefetch_repetition(model, avatars, world, due[q + AHEAD], scratch.states[q + AHEAD])
        _add_terms(model, avatars, world, now, due[q], observed, q, scratch, 1, len(TERMS))


@kernel(inline=True)
def evaluate_by_terms(model, avatars, world, now, due, count, observed, scratch, notes):
    """Do what ``evaluate`` does, and write into ``notes[t, q]`` what the terms up to the t-th make of it."""
    look_up(model, avatars, world, due, count, scratch)
    for q in range(count):
        for term in range(len(TERMS)):
            _add_terms(model, avatars, world, now, due[q], observed, q, scratch, term, term + 1)
            for k in range(scratch.values.shape[1]):
                notes[term, q, k] = scratch.values[q, k]


@kernel(inline=True)
def _add_terms(model, avatars, world, now, own, observed, q, scratch, first, stop):
    """Add the terms from number ``first`` to before ``stop``; where these are constants nothing is compared."""
    if first <= 1 < stop:
        avoid_collisions(model, avatars, world, now, own, observed, q, scratch)
    if first <= 2 < stop:
        avoid_repetition(model, avatars, world, now, own, observed, q, scratch)
    if first <= 3 < stop:
        defend(model, avatars, world, now, own, observed, q, scratch)
    if first <= 4 < stop:
        seek_rest(model, avatars, world, now, own, observed, q, scratch)
    if first <= 5 < stop:
        weigh_strikes(model, avatars, world, now, own, observed, q, scratch)
    if first <= 6 < stop:
        hold_strikes(model, avatars, world, now, own, observed, q, scratch)
    if first <= 7 < stop:
        favour_stillness(model, avatars, world, now, own, observed, q, scratch)
    if first <= 8 < stop:
        face_opponent(model, avatars, world, now, own, observed, q, scratch)
    if first <= 9 < stop:
        keep_guard(model, avatars, world, now, own, observed, q, scratch)
    if first <= 10 < stop:
        keep_stance(model, avatars, world, now, own, observed, q, scratch)
    if first <= 11 < stop:
        keep_pace(model, avatars, world, now, own, observed, q, scratch)
    if first <= 12 < stop:
        turn_out(model, avatars, world, now, own, observed, q, scratch)

"""What the next actions of avatars are worth: the sum of the value terms, which are listed here."""

import numpy as np

from crowdsim.crowd.kernels.layout import AHEAD
from crowdsim.crowd.kernels.terms.aim import aim_at_target
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

ADDED = (
    ("collisions", avoid_collisions),
    ("repetition", avoid_repetition),
    ("defence", defend),
    ("rest", seek_rest),
    ("strikes", weigh_strikes),
    ("aim", aim_at_target),
    ("stun", hold_strikes),
    ("stillness", favour_stillness),
    ("facing", face_opponent),
    ("guard", keep_guard),
    ("stance", keep_stance),
    ("pace", keep_pace),
    ("backs", turn_out),
)
"""The terms that are added to what is learned, in their order: the name of each, and its kernel."""
TERMS = ("learned", *(name for name, _ in ADDED))
"""Names of all terms, by their numbers."""


def _followed(before, number, name, term):
    """Return a kernel that adds a term after those before it, if it is among ``first`` to before ``stop``.

    Where these are constants nothing is compared.
    """

    def add(model, avatars, world, now, own, observed, q, scratch, first, stop):
        before(model, avatars, world, now, own, observed, q, scratch, first, stop)
        if first <= number < stop:
            term(model, avatars, world, now, own, observed, q, scratch)

    return kernel(add, inline=True, name=f"add_up_to_{name}")


@kernel(inline=True)
def _add_none(model, avatars, world, now, own, observed, q, scratch, first, stop):
    """Add no term."""


_add_terms = _add_none
for _number, (_name, _term) in enumerate(ADDED, start=1):
    _add_terms = _followed(_add_terms, _number, _name, _term)


@kernel(inline=True)
def evaluate(model, avatars, world, now, due, count, observed, scratch):
    """Write into ``scratch.values`` what the next actions of avatars ``due[:count]`` are worth to them."""
    look_up(model, avatars, world, due, count, scratch)
    for q in range(count):
        if q + AHEAD < count:
            prefetch_repetition(model, avatars, world, due[q + AHEAD], scratch.states[q + AHEAD])
        _add_terms(model, avatars, world, now, np.int64(due[q]), observed, q, scratch, 1, len(TERMS))


@kernel(inline=True)
def evaluate_by_terms(model, avatars, world, now, due, count, observed, scratch, notes):
    """Do what ``evaluate`` does, and write into ``notes[t, q]`` what the terms up to the t-th make of it."""
    look_up(model, avatars, world, due, count, scratch)
    for q in range(count):
        for term in range(len(TERMS)):
            _add_terms(model, avatars, world, now, np.int64(due[q]), observed, q, scratch, term, term + 1)
            for k in range(scratch.values.shape[1]):
                notes[term, q, k] = scratch.values[q, k]

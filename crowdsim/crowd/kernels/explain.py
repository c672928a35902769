"""What the next actions of avatars are worth, term by term: ``evaluate``, with notes in between."""

from crowdsim.crowd.kernels.observe import observe
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
from crowdsim.crowd.kernels.terms.variety import avoid_repetition
from crowdsim.jit import kernel

NAMES = (
    "learned", "collisions", "repetition", "defence", "rest", "strikes", "stun", "stillness", "facing", "guard",
    "stance", "pace",
)  # fmt: skip
"""Names of the terms, in the order of ``evaluate``."""


@kernel
def explain(model, avatars, world, now, due, count, observed, scratch, sums):
    """Write into ``sums[t, q]`` what actions of avatars ``due[:count]`` are worth by all terms up to the t-th.

    It observes for them, too. Shape of ``sums``: (length of ``NAMES``, count, most actions of a state).
    """
    observe(model, avatars, world, now, due, count, observed, scratch)
    look_up(model, avatars, world, due, count, scratch)
    for q in range(count):
        own = due[q]
        sums[0, q] = scratch.values[q]
        avoid_collisions(model, avatars, world, now, own, observed, q, scratch)
        sums[1, q] = scratch.values[q]
        avoid_repetition(model, avatars, world, now, own, observed, q, scratch)
        sums[2, q] = scratch.values[q]
        defend(model, avatars, world, now, own, observed, q, scratch)
        sums[3, q] = scratch.values[q]
        seek_rest(model, avatars, world, now, own, observed, q, scratch)
        sums[4, q] = scratch.values[q]
        weigh_strikes(model, avatars, world, now, own, observed, q, scratch)
        sums[5, q] = scratch.values[q]
        hold_strikes(model, avatars, world, now, own, observed, q, scratch)
        sums[6, q] = scratch.values[q]
        favour_stillness(model, avatars, world, now, own, observed, q, scratch)
        sums[7, q] = scratch.values[q]
        face_opponent(model, avatars, world, now, own, observed, q, scratch)
        sums[8, q] = scratch.values[q]
        keep_guard(model, avatars, world, now, own, observed, q, scratch)
        sums[9, q] = scratch.values[q]
        keep_stance(model, avatars, world, now, own, observed, q, scratch)
        sums[10, q] = scratch.values[q]
        keep_pace(model, avatars, world, now, own, observed, q, scratch)
        sums[11, q] = scratch.values[q]

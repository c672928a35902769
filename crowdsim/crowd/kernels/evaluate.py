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


@kernel(inline=True)
def evaluate(model, avatars, world, now, due, count, observed, scratch):
    """Write into ``scratch.values`` what the next actions of avatars ``due[:count]`` are worth to them."""
    look_up(model, avatars, world, due, count, scratch)
    for q in range(count):
        if q + AHEAD < count:
            prefetch_repetition(model, avatars, world, due[q + AHEAD], scratch.states[q + AHEAD])
        own = due[q]
        avoid_collisions(model, avatars, world, now, own, observed, q, scratch)
        avoid_repetition(model, avatars, world, now, own, observed, q, scratch)
        defend(model, avatars, world, now, own, observed, q, scratch)
        seek_rest(model, avatars, world, now, own, observed, q, scratch)
        weigh_strikes(model, avatars, world, now, own, observed, q, scratch)
        hold_strikes(model, avatars, world, now, own, observed, q, scratch)
        favour_stillness(model, avatars, world, now, own, observed, q, scratch)
        face_opponent(model, avatars, world, now, own, observed, q, scratch)
        keep_guard(model, avatars, world, now, own, observed, q, scratch)
        keep_stance(model, avatars, world, now, own, observed, q, scratch)
        keep_pace(model, avatars, world, now, own, observed, q, scratch)

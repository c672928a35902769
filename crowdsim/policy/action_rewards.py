"""The reward of one action: slow and plain, the meaning of the compiled version in ``kernels/rewards.py``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.motion import ground
from crowdsim.policy.rewards import (
    WASTED,
    ProximityTerm,
    StrikeTerm,
    TargetBody,
    Term,
    TransitionTerm,
    comes_through,
    lands,
    surface_distance,
    unknown_term,
)

if TYPE_CHECKING:
    from crowdsim.policy.actions import Actions


def action_reward(
    actions: Actions,
    action: int,
    target: ArrayLike,
    terms: tuple[Term, ...],
    body: TargetBody,
    discount: float,
    velocity: ArrayLike = (0.0, 0.0),
    lasts: float = math.inf,
) -> float:
    """Return r(e, a) for a target (3,) in the ground frame of the action's state: the sum that ``rewards.py`` defines.

    Args:
        actions: All actions.
        action: Which one.
        target: Centre of the target's head [m].
        terms: The terms of the behaviour.
        body: The target's sizes.
        discount: gamma, a control frame.
        velocity: How far the target moves over the ground, along x and z [m a control frame].
        lasts: For how many control frames it moves on.

    Raises:
        RecipeError: A term is none of those.
    """
    start = np.asarray(target, dtype=float)
    step = np.array([velocity[0], 0.0, velocity[1]])  # type: ignore[index]
    total = 0.0
    for term in terms:
        if isinstance(term, StrikeTerm):
            found, spent = [0.0], 0.0
            for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
                t = float(actions.strike_times[strike])
                place = start + min(t, lasts) * step
                away = actions.strike_positions[strike].astype(float) - place
                spent += discount**t * (term.effort + term.waste * (math.hypot(away[0], away[2]) > WASTED))
                through = comes_through(actions.strike_positions[strike], actions.strike_origins[strike], place)
                gap = surface_distance(actions.strike_positions[strike], place, body)
                if lands(gap, term.tolerance) and not through:
                    found.append(discount**t * float(actions.strike_speeds[strike]) ** term.speed_weight)
            total += term.weight * ((max(found) if term.form == "max" else sum(found)) - spent)
        elif isinstance(term, ProximityTerm):
            path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]].astype(float)
            values = []
            for t, place in enumerate(path, start=1):
                x, _, z = ground.to_local(place, start + min(t, lasts) * step)
                ahead = z if term.facing else math.hypot(x, z)
                gap = ahead - min(max(ahead, term.between[0]), term.between[1])
                if term.facing:
                    gap = math.hypot(gap, max(abs(x) - term.aside, 0.0))
                gap = abs(gap)
                values.append(discount**t * math.exp(-gap / term.sigma))
            total += term.weight * (sum(values) if term.form == "sum" else max(values))
        elif isinstance(term, TransitionTerm):
            cost = float(actions.costs[action])
            total -= term.weight * cost + (term.each if cost > 0.0 else 0.0)
        else:
            raise unknown_term(term)
    return total

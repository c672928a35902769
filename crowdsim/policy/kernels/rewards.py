"""Compiled rewards of single actions, in double precision: loops over the moments of an action.

``tables`` is a ``LookupTables`` and ``target`` a ``Target``.
"""

import math

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.terms.registry import ONCE, STRIKE, for_frame_terms
from crowdsim.policy.terms.strike import is_wasted, lands, read_surface
from crowdsim.policy.terms.term import Seen

# Columns of ``Actions.paths``.
X, Z, HEADING = range(3)


@kernel
def find_landed(actions, strike, target, surface):
    """Return whether a strike lands on a target, where the fist is then, and where the target's head is."""
    t, fists, origins = actions.strike_times[strike], actions.strike_positions, actions.strike_origins
    fist = fists[strike, 0], fists[strike, 1], fists[strike, 2]
    moved = min(t, target.lasts)
    head = target.x + moved * target.vx, target.y, target.z + moved * target.vz
    return lands(fist, (origins[strike, 0], origins[strike, 1]), head, surface), fist, head


@kernel
def earned_by_strikes(actions, action, target, term, log_discount):
    """Return what the strikes of an action earn that land, for the weight 1."""
    best, total, surface = 0.0, 0.0, read_surface(term)
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        if find_landed(actions, strike, target, surface)[0]:
            faded = math.exp(actions.strike_times[strike] * log_discount)
            earned = faded * actions.strike_speeds[strike] ** term.speed_weight
            best = max(best, earned)
            total += earned
    return best if term.greatest != 0.0 else total


@kernel
def _spent_on_strikes(actions, action, target, term, log_discount):
    """Return what the strikes of an action cost, for the weight 1."""
    spent, surface = 0.0, read_surface(term)
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        _, fist, head = find_landed(actions, strike, target, surface)
        faded = math.exp(actions.strike_times[strike] * log_discount)
        spent += faded * (term.effort + (term.waste if is_wasted(fist, head, term) else 0.0))
    return spent


def _build_frames(name, read, gap):
    """Return a kernel that evaluates a term of one kind along the path of an action."""

    def worth(actions, action, target, term, log_discount):
        wanted = read(term, np.float64)
        total, best, factor, discount = 0.0, 0.0, 1.0, math.exp(log_discount)
        facing_sin, facing_cos = math.sin(target.heading), math.cos(target.heading)
        start = actions.path_offsets[action]
        for t in range(1, actions.lengths[action] + 1):
            factor *= discount
            row = start + t - 1
            moved = min(t, target.lasts)
            dx = target.x + moved * target.vx - actions.paths[row, X]
            dz = target.z + moved * target.vz - actions.paths[row, Z]
            heading = np.float64(actions.paths[row, HEADING])
            seen = Seen(dx, dz, math.sin(heading), math.cos(heading), facing_sin, facing_cos, target.impact - t)
            value = factor * math.exp(-gap(seen, wanted))
            total += value
            best = max(best, value)
        return best if term.greatest != 0.0 else total

    return kernel(worth, name=f"worth_of_{name}")


_worth_along_path = for_frame_terms(_build_frames)


@kernel
def action_reward(tables, behaviour, action, target):
    """Return r(e, a): the sum of the terms of a behaviour."""
    actions, row = tables.actions, tables.behaviours[behaviour]
    total, log_discount = tables.once[behaviour, action], math.log(row.discount)
    for index in range(row.first_term, row.end_term):
        term = tables.terms[index]
        if term.kind == STRIKE:
            earned = earned_by_strikes(actions, action, target, term, log_discount)
            total += term.weight * (earned - _spent_on_strikes(actions, action, target, term, log_discount))
        elif term.kind != ONCE:
            total += term.weight * _worth_along_path(term.kind, actions, action, target, term, log_discount)
    return total

"""The draw of an action among those that are nearly as good as the best one."""

import math
from typing import NamedTuple

from crowdsim.core.mathematics import exp
from crowdsim.jit import kernel


class CandidateRules(NamedTuple):
    """Which actions are candidates, and how they are drawn.

    Attributes:
        margin: How much less than the best one a candidate may be worth.
        most: How many candidates there are at most.
        temperature: The chance of a candidate is proportional to exp((value - best) / temperature); 0 takes the best.
    """

    margin: float
    most: float
    temperature: float


@kernel(inline=True)
def draw_candidate(values, count, rules, number, chances):
    """Return one of the candidates, drawn by ``number`` in [0, 1); -1 where the best value is no finite number.

    Where there are too many, those of the least values drop out, the later ones among equals.

    Args:
        values: Value of each action.
        count: Number of actions.
        rules: ``CandidateRules``.
        number: Random number.
        chances: Scratch space, as long as ``values``.
    """
    top = values[0]
    for k in range(1, count):
        top = values[k] if values[k] > top else top
    if not math.isfinite(top):
        return -1
    first = rules.temperature <= 0.0 or rules.most <= 1
    floor = top if first else top - rules.margin
    near = 0
    for k in range(count):  # without a branch, which could not be predicted
        chances[near] = values[k]
        near += values[k] >= floor
    if near == 1 or first:
        return _nth_candidate(values, count, top, 0)
    if near <= rules.most:
        total = 0.0
        for c in range(near):
            chances[c] = exp((chances[c] - top) / rules.temperature)
            total += chances[c]
        return _nth_candidate(values, count, floor, draw_chance(chances, near, number * total))
    return _draw_among_best(values, count, top, rules, number, chances)


@kernel(inline=True)
def _draw_among_best(values, count, top, rules, number, chances):
    """Return one of the ``rules.most`` best actions, the earlier ones among equals."""
    held = 0
    for k in range(count):
        value = values[k]
        if held < rules.most or value > chances[held - 1]:
            m = held if held < rules.most else held - 1
            while m > 0 and chances[m - 1] < value:
                chances[m] = chances[m - 1]
                m -= 1
            chances[m] = value
            held = min(held + 1, int(rules.most))
    floor = chances[held - 1]
    total = 0.0
    left = held
    for k in range(count):
        chosen = values[k] > floor or (values[k] == floor and _is_among_first(values, count, floor, k, held))
        chances[k] = exp((values[k] - top) / rules.temperature) if chosen else 0.0
        total += chances[k]
        left -= chosen
        if left == 0:
            for m in range(k + 1, count):
                chances[m] = 0.0
            break
    return draw_chance(chances, count, number * total)


@kernel(inline=True)
def _is_among_first(values, count, floor, k, most):
    """Return whether action ``k``, which is worth ``floor``, is among the ``most`` best, earlier ones first."""
    before = 0
    for m in range(count):
        before += values[m] > floor
    for m in range(k):
        before += values[m] == floor
    return before < most


@kernel(inline=True)
def draw_chance(chances, count, wanted):
    """Return the first chance above 0 up to which they add up to more than is wanted, or the last one above 0."""
    picked = 0
    for k in range(count):
        if chances[k] > 0.0:
            picked = k
            wanted -= chances[k]
            if wanted < 0.0:
                break
    return picked


@kernel(inline=True)
def _nth_candidate(values, count, floor, place):
    """Return the action that comes ``place``-th, counted from 0, among those worth ``floor`` or more."""
    for k in range(count):
        if values[k] >= floor:
            if place == 0:
                return k
            place -= 1
    return -1

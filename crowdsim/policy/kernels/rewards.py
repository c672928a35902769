"""Compiled rewards of single actions; ``rewards.py`` of the policy package defines them.

``actions`` is an ``Actions``, ``target`` a ``Target``, and ``terms`` are what ``rewards.pack_terms`` returns.
"""

import math
from typing import NamedTuple

from crowdsim.core.bodies import BodySizes, comes_through, lands_on_upright_body
from crowdsim.jit import kernel

# Columns of the terms; those behind the weight depend on the term.
CODE, WEIGHT = range(2)
STRIKE, PROXIMITY, TRANSITION = range(3)
TOLERANCE, SPEED_WEIGHT, HEAD_RADIUS, TORSO_RADIUS, NECK_DROP, PELVIS_DROP = range(2, 8)
EFFORT, WASTE, GREATEST_STRIKE, WASTED = range(9, 13)
LEAST, SIGMA, GREATEST_PROXIMITY, FACING, MOST, ASIDE = range(2, 8)
EACH = 2

# Columns of ``Actions.paths``.
X, Z, HEADING = range(3)


class Target(NamedTuple):
    """A target in the avatar's ground frame.

    Attributes:
        x: Where its head is, to the left [m].
        y: Upwards.
        z: Ahead.
        vx: How far it moves in a control frame, to the left [m].
        vz: Ahead.
    """

    x: float
    y: float
    z: float
    vx: float
    vz: float


@kernel(allocates=False)
def strike_lands(fist, origin, head, terms, row):
    """Return whether a strike lands on a target with its head at a point (``rewards.lands``).

    ``origin`` is where a kick comes from over the ground; of a punch, the fist's own position.
    """
    if comes_through(fist[0], fist[2], origin[0], origin[1], head[0], head[2]):
        return False
    sizes = BodySizes(terms[row, HEAD_RADIUS], terms[row, TORSO_RADIUS], terms[row, NECK_DROP], terms[row, PELVIS_DROP])
    return lands_on_upright_body(fist, head, sizes, terms[row, TOLERANCE])


@kernel(allocates=False)
def spent_on_strike(px, pz, x, z, terms, row):
    """Return what a strike costs whose fist ends over (px, pz) when the target is over (x, z)."""
    far = (px - x) ** 2 + (pz - z) ** 2 > terms[row, WASTED] * terms[row, WASTED]
    return terms[row, EFFORT] + (terms[row, WASTE] if far else 0.0)


@kernel(allocates=False)
def strike_reward(actions, action, target, terms, row, log_discount):
    """Return the strike term of one action."""
    best, total, spent = 0.0, 0.0, 0.0
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        t = actions.strike_times[strike]
        fists = actions.strike_positions
        fist = fists[strike, 0], fists[strike, 1], fists[strike, 2]
        origin = actions.strike_origins[strike, 0], actions.strike_origins[strike, 1]
        x, z = target.x + t * target.vx, target.z + t * target.vz
        faded = math.exp(t * log_discount)
        spent += faded * spent_on_strike(fist[0], fist[2], x, z, terms, row)
        if strike_lands(fist, origin, (x, target.y, z), terms, row):
            earned = faded * actions.strike_speeds[strike] ** terms[row, SPEED_WEIGHT]
            best = max(best, earned)
            total += earned
    return terms[row, WEIGHT] * ((best if terms[row, GREATEST_STRIKE] != 0.0 else total) - spent)


@kernel(allocates=False)
def proximity_reward(actions, action, target, terms, row, log_discount):
    """Return the proximity term of one action."""
    total = 0.0
    best = 0.0
    factor = 1.0
    discount = math.exp(log_discount)
    start = actions.path_offsets[action]
    for t in range(1, actions.lengths[action] + 1):
        factor *= discount
        dx = target.x + t * target.vx - actions.paths[start + t - 1, X]
        dz = target.z + t * target.vz - actions.paths[start + t - 1, Z]
        aside = 0.0
        if terms[row, FACING] != 0.0:
            heading = actions.paths[start + t - 1, HEADING]
            ahead = dx * math.sin(heading) + dz * math.cos(heading)
            aside = max(abs(dx * math.cos(heading) - dz * math.sin(heading)) - terms[row, ASIDE], 0.0)
        else:
            ahead = math.sqrt(dx * dx + dz * dz)
        ahead -= min(max(ahead, terms[row, LEAST]), terms[row, MOST])
        gap = math.sqrt(ahead * ahead + aside * aside)
        value = factor * math.exp(-gap / terms[row, SIGMA])
        total += value
        best = max(best, value)
    return terms[row, WEIGHT] * (best if terms[row, GREATEST_PROXIMITY] != 0.0 else total)


@kernel(allocates=False)
def transition_price(cost, terms, row):
    """Return what a transition of a cost above 0 costs by a transition term."""
    return terms[row, WEIGHT] * cost + terms[row, EACH]


@kernel(allocates=False)
def term_reward(actions, action, target, terms, row, log_discount):
    """Return the value of one term for an action; NaN for a term without a branch here.

    ``rewards.COMPILED`` lists the terms that have one.
    """
    code = int(terms[row, CODE])
    if code == STRIKE:
        return strike_reward(actions, action, target, terms, row, log_discount)
    if code == PROXIMITY:
        return proximity_reward(actions, action, target, terms, row, log_discount)
    if code == TRANSITION:
        cost = actions.costs[action]
        return -(terms[row, WEIGHT] * cost + (terms[row, EACH] if cost > 0.0 else 0.0))
    return math.nan


@kernel(allocates=False)
def action_reward(actions, action, target, terms, first, end, log_discount):
    """Return r(e, a): the sum of the terms ``first`` to ``end``."""
    total = 0.0
    for row in range(first, end):
        total += term_reward(actions, action, target, terms, row, log_discount)
    return total

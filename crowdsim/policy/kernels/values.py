"""Compiled values of actions (``policy.action_values``).

``tables`` is a ``LookupTables``, ``target`` a ``Target``, and ``corners`` are ``Corners``.
"""

import math

from crowdsim.core.tables import interpolate
from crowdsim.jit import kernel
from crowdsim.policy.kernels.axes import fade_on_axes, find_corners
from crowdsim.policy.kernels.rewards import CODE, HEADING, TRANSITION, X, Z, action_reward, transition_price

# Columns of ``LookupTables.behaviours``.
FIRST_AXIS, END_AXIS, FIRST_TERM, END_TERM, LOOKS_AHEAD, CELLS, TABLE, SCALE, DISCOUNT, LOW, STEP = range(11)
# Entries of ``LookupTables.leads``.
LEAD_NOW, LEAD_LATER = range(2)


@kernel(allocates=False)
def after_action(actions, action, x, z):
    """Return where a target at (x, z) is seen once the action has been done."""
    last = actions.path_offsets[action + 1] - 1
    heading = actions.paths[last, HEADING]
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dz = x - actions.paths[last, X], z - actions.paths[last, Z]
    return dx * cos - dz * sin, dx * sin + dz * cos


@kernel(allocates=False)
def state_value(tables, behaviour, state, x, y, z, corners):
    """Return V(s, e) by a behaviour's table of the look-up v."""
    row = tables.behaviours[behaviour]
    count = find_corners(tables.axes, int(row[FIRST_AXIS]), int(row[END_AXIS]), x, y, z, corners)
    entry = int(row[TABLE]) + state * int(row[CELLS])
    return row[LOW] + row[STEP] * interpolate(tables.table, entry, corners.cells, corners.weights, count)


@kernel(allocates=False)
def fade_of(tables, behaviour, target):
    """Return how much a behaviour counts for a target."""
    first, end = int(tables.behaviours[behaviour, FIRST_AXIS]), int(tables.behaviours[behaviour, END_AXIS])
    return fade_on_axes(tables.axes, first, end, target.x, target.y, target.z)


@kernel(allocates=False)
def add_stored_values(tables, behaviour, state, target, factor, corners, out):
    """Add ``factor`` times Q(e, a) by a behaviour's table of the look-up q to ``out`` for every action of the state."""
    row = tables.behaviours[behaviour]
    first = tables.actions.offsets[state]
    n = tables.actions.offsets[state + 1] - first
    x, z = target.x + tables.leads[LEAD_NOW] * target.vx, target.z + tables.leads[LEAD_NOW] * target.vz
    count = find_corners(tables.axes, int(row[FIRST_AXIS]), int(row[END_AXIS]), x, target.y, z, corners)
    base = int(row[TABLE]) + first * int(row[CELLS])
    for k in range(n):
        out[k] += factor * row[LOW]
    for corner in range(count):
        if corners.weights[corner] != 0.0:
            entry = base + corners.cells[corner] * n
            share = corners.weights[corner] * factor * row[STEP]
            for k in range(n):
                out[k] += share * tables.table[entry + k]


@kernel(allocates=False)
def add_values_ahead(tables, behaviour, state, target, factor, corners, out):
    """Add ``factor`` times Q(e, a) by a behaviour of the look-up v to ``out`` for every action of the state."""
    actions = tables.actions
    row = tables.behaviours[behaviour]
    first = actions.offsets[state]
    log_discount = math.log(row[DISCOUNT])
    for k in range(actions.offsets[state + 1] - first):
        a = first + k
        earned = action_reward(actions, a, target, tables.terms, int(row[FIRST_TERM]), int(row[END_TERM]), log_discount)
        t = actions.lengths[a] + tables.leads[LEAD_LATER]
        x, z = after_action(actions, a, target.x + t * target.vx, target.z + t * target.vz)
        later = state_value(tables, behaviour, actions.next[a], x, target.y, z, corners)
        out[k] += factor * (earned + math.exp(log_discount * actions.lengths[a]) * later)


@kernel(allocates=False)
def count_price_once(tables, behaviour_weights, state, target, out):
    """Let a transition cost what it costs the behaviour that it costs most, where each has counted its own price."""
    first = tables.actions.offsets[state]
    for k in range(tables.actions.offsets[state + 1] - first):
        cost = tables.actions.costs[first + k]
        if cost <= 0.0:
            continue
        total, most = 0.0, 0.0
        for behaviour in range(len(behaviour_weights)):
            row = tables.behaviours[behaviour]
            if behaviour_weights[behaviour] == 0.0 or row[SCALE] == 0.0:
                continue
            price = 0.0
            for term in range(int(row[FIRST_TERM]), int(row[END_TERM])):
                if tables.terms[term, CODE] == TRANSITION:
                    price += transition_price(cost, tables.terms, term)
            price *= behaviour_weights[behaviour] * fade_of(tables, behaviour, target) / row[SCALE]
            total += price
            most = max(most, price)
        out[k] += total - most


@kernel(allocates=False)
def evaluate_actions(tables, behaviour_weights, state, target, corners, out):
    """Write the values of the actions of a state (``policy.action_values``); return how many there are.

    Args:
        tables: ``LookupTables``.
        behaviour_weights: Weight of each behaviour. Shape (B,).
        state: The avatar's state.
        target: ``Target``.
        corners: Scratch space, ``Corners``.
        out: Written: the values, float64, at least as long as the state has actions.
    """
    n = tables.actions.offsets[state + 1] - tables.actions.offsets[state]
    active = 0
    for k in range(n):
        out[k] = 0.0
    for behaviour in range(len(behaviour_weights)):
        if behaviour_weights[behaviour] != 0.0:
            fade = fade_of(tables, behaviour, target)
            scale = tables.behaviours[behaviour, SCALE]
            factor = behaviour_weights[behaviour] * fade / scale if scale > 0.0 else 0.0
            if factor != 0.0:
                if tables.behaviours[behaviour, LOOKS_AHEAD] == 0.0:
                    add_stored_values(tables, behaviour, state, target, factor, corners, out)
                else:
                    add_values_ahead(tables, behaviour, state, target, factor, corners, out)
                active += 1
    if active > 1:
        count_price_once(tables, behaviour_weights, state, target, out)
    return n

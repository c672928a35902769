"""Compiled values of actions.

Values of behaviours are divided by their scale, multiplied by their weight and by how much they count at the target
(``fade_on_axes``), and added (paper, section 5). What a transition costs is in the values of every behaviour that
prices it; here it is counted once, at the highest of their prices.

``tables`` is a ``LookupTables``, ``target`` a ``Target``, and ``corners`` are ``Corners``.
"""

import math

import numpy as np

from crowdsim.core.tables import interpolate
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import End, Target
from crowdsim.policy.kernels.axes import fade_on_axes, find_corners, find_corners_after
from crowdsim.policy.kernels.rewards import HEADING, X, Z, action_reward


@kernel
def moved(target, frames):
    """Return a target some control frames later."""
    return Target(
        target.x + min(frames, target.lasts) * target.vx, target.y, target.z + min(frames, target.lasts) * target.vz,
        target.vx, target.vz, target.heading, target.impact, target.lasts,
    )  # fmt: skip


@kernel
def after_action(actions, action, target):
    """Return how a target is seen once an action has been done, from where the avatar is then; it does not move on."""
    last = actions.path_offsets[action + 1] - 1
    heading = actions.paths[last, HEADING]
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dz = target.x - actions.paths[last, X], target.z - actions.paths[last, Z]
    vx, vz = target.vx * cos - target.vz * sin, target.vx * sin + target.vz * cos
    impact, lasts = target.impact - actions.lengths[action], max(target.lasts - actions.lengths[action], 0.0)
    return Target(dx * cos - dz * sin, target.y, dx * sin + dz * cos, vx, vz, target.heading - heading, impact, lasts)


@kernel
def value_behind(tables, behaviour, action, before, corners):
    """Return V(s, e) behind an action by a behaviour's table of the look-up v, for a target as it is seen before it."""
    row, actions = tables.behaviours[behaviour], tables.actions
    length = actions.lengths[action]
    later = after_action(actions, action, moved(before, length + row.lead_later))
    turn = np.float64(actions.paths[actions.path_offsets[action + 1] - 1, HEADING])
    end = End(turn, np.float64(length), 1.0)
    count = find_corners_after(tables.axes, row.first_axis, row.end_axis, before, later, end, corners)
    entry = row.table + actions.next[action] * row.cells
    return row.low + row.step * interpolate(tables.table, entry, corners.cells, corners.weights, count)


@kernel
def fade_of(tables, behaviour, target):
    """Return how much a behaviour counts for a target."""
    row = tables.behaviours[behaviour]
    return fade_on_axes(tables.axes, row.first_axis, row.end_axis, target)


@kernel
def add_stored_values(tables, behaviour, state, target, factor, corners, out):
    """Add ``factor`` times Q(e, a) by a behaviour's table of the look-up q to ``out`` for every action of the state."""
    row = tables.behaviours[behaviour]
    first = tables.actions.offsets[state]
    n = tables.actions.offsets[state + 1] - first
    soon = moved(target, row.lead_now)
    count = find_corners(tables.axes, row.first_axis, row.end_axis, soon, corners)
    base = row.table + first * row.cells
    for k in range(n):
        out[k] += factor * row.low
    for corner in range(count):
        if corners.weights[corner] != 0.0:
            entry = base + corners.cells[corner] * n
            share = corners.weights[corner] * factor * row.step
            for k in range(n):
                out[k] += share * tables.table[entry + k]


@kernel
def add_values_ahead(tables, behaviour, state, target, factor, corners, out):
    """Add ``factor`` times Q(e, a) by a behaviour of the look-up v to ``out`` for every action of the state."""
    actions = tables.actions
    first, log_discount = actions.offsets[state], math.log(tables.behaviours[behaviour].discount)
    for k in range(actions.offsets[state + 1] - first):
        a = first + k
        earned = action_reward(tables, behaviour, a, target)
        value = value_behind(tables, behaviour, a, target, corners)
        out[k] += factor * (earned + math.exp(log_discount * actions.lengths[a]) * value)


@kernel
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
            if behaviour_weights[behaviour] == 0.0 or row.scale == 0.0:
                continue
            price = row.price * cost + row.each
            price *= behaviour_weights[behaviour] * fade_of(tables, behaviour, target) / row.scale
            total += price
            most = max(most, price)
        out[k] += total - most


@kernel
def evaluate_actions(tables, behaviour_weights, state, target, corners, out):
    """Write the values of the actions of a state ; return how many there are.

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
            scale = tables.behaviours[behaviour].scale
            factor = behaviour_weights[behaviour] * fade / scale if scale > 0.0 else 0.0
            if factor != 0.0:
                if not tables.behaviours[behaviour].looks_ahead:
                    add_stored_values(tables, behaviour, state, target, factor, corners, out)
                else:
                    add_values_ahead(tables, behaviour, state, target, factor, corners, out)
                active += 1
    if active > 1:
        count_price_once(tables, behaviour_weights, state, target, out)
    return n

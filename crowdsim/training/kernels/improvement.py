"""Bellman sweeps over V: every action of every state is backed up in every cell, and the best one counts."""

import numpy as np

from crowdsim.jit import kernel
from crowdsim.training.kernels.backup import back_up_action
from crowdsim.training.kernels.successors import (
    DISTANCE,
    corners_of,
    empty_successors,
    find_successors,
    see_layers,
    weights_of,
)


@kernel(allocates=True)
def improve(low, high, model, layers, values, first, every, out, changes):
    """Do a Bellman sweep over some states: V'(s, c) = max over a of Q(a, c).

    All of them read the table of before, so the result does not depend on how they are shared out.

    Args:
        low: First of the rows to write.
        high: One past the last.
        model: ``SweepModel``.
        layers: Layers of the grid.
        values: V. Flat, float32.
        first: The state of row 0.
        every: How far the states of rows are apart.
        out: Written: V' of these states, one after another. Shape (at least as many, C), float32.
        changes: Written: by how much the values of each of these states change at most. Shape (S,).
    """
    cells = len(model.xs) * layers
    row, later, found = np.empty(cells, np.float32), np.empty(cells, np.float32), empty_successors(len(model.xs))
    over_ground = model.near.shape[2] <= len(model.xs) and len(model.layered.runs) == 0
    for i in range(low, high):
        s = first + i * every
        best = out[i]
        for c in range(cells):
            best[c] = -np.inf
        for action in range(model.offsets[s], model.offsets[s + 1]):
            if len(model.probabilities) == 1 and over_ground:
                _raise_to_action(model, layers, values, np.int64(action), found, later, best)
            else:
                back_up_action(model, layers, values, np.int64(action), found, later, row)
                _raise(best, row)
        changes[s] = _greatest_change(values[s * cells : (s + 1) * cells], best)


@kernel
def _raise_to_action(model, layers, values, action, found, later, best):
    """Raise the best values to Q(action, .) where that is greater, for a target at rest.

    What lands earns more than 0, so cells where strikes land are done once more. The values of the next state are
    copied to the scratch space ``later`` first: they are read crosswise, which takes longer from far memory.
    """
    find_successors(model.axes, model.ends[0, action], model.xs, model.zs, found)
    start = np.int64(model.next[action]) * len(best)
    if len(model.layered.axes) > 0:
        row = values[start : start + len(best)]
        see_layers(model.layered, model.ends[0, action], layers, row, found.corners, later)
    else:
        for i in range(len(best)):
            c = np.uint64(i)
            later[c] = values[np.uint64(start) + c]
    near = model.near[0, action]
    across, discount = np.int64(model.axes[DISTANCE].stride), model.discounts[action]
    if layers < 4:
        _raise_layers(found, across, layers, later, discount, near, best)
    else:
        _raise_by_four(found, across, layers, later, discount, near, best)
    for entry in range(model.landed[action], model.landed[action + 1]):
        c = np.uint64(model.landed_cells[entry])
        m = c // np.uint64(layers)
        h = c - m * np.uint64(layers)
        value = _value_between(later, corners_of(found, m, across), weights_of(found, m, discount), h)
        value += (near[m] if len(near) > 1 else near[0]) + model.landed_rewards[entry]
        best[c] = max(value, best[c])


@kernel(inline=True)
def _value_between(later, corners, weights, h):
    """Return the weighted sum of the values at four corners, in layer ``h``."""
    e0, e1, e2, e3 = corners
    w0, w1, w2, w3 = weights
    return w0 * later[e0 + h] + w1 * later[e1 + h] + w2 * later[e2 + h] + w3 * later[e3 + h]


@kernel
def _raise_layers(found, across, layers, later, discount, near, best):
    """Do what ``_raise_to_action`` does where no strike lands.

    Indices are unsigned, because compiled code would check whether signed ones count from the end.
    """
    wide = len(near) > 1
    for i in range(len(found.lowers)):
        m = np.uint64(i)
        corners, weights = corners_of(found, m, across), weights_of(found, m, discount)
        earned = near[m] if wide else near[0]
        at = m * np.uint64(layers)
        for lane in range(layers):
            h = np.uint64(lane)
            best[at + h] = max(_value_between(later, corners, weights, h) + earned, best[at + h])


@kernel
def _raise_by_four(found, across, layers, later, discount, near, best):
    """Do the same for four layers at a time, which is faster; the last four may overlap with those before."""
    wide, last = len(near) > 1, np.uint64(layers - 4)
    for i in range(len(found.lowers)):
        m = np.uint64(i)
        corners, weights = corners_of(found, m, across), weights_of(found, m, discount)
        earned = near[m] if wide else near[0]
        for four in range((layers + 3) // 4):
            h = min(np.uint64(4 * four), last)
            c = m * np.uint64(layers) + h
            v0 = _value_between(later, corners, weights, h) + earned
            v1 = _value_between(later, corners, weights, h + np.uint64(1)) + earned
            v2 = _value_between(later, corners, weights, h + np.uint64(2)) + earned
            v3 = _value_between(later, corners, weights, h + np.uint64(3)) + earned
            b0, b1, b2, b3 = best[c], best[c + np.uint64(1)], best[c + np.uint64(2)], best[c + np.uint64(3)]
            best[c] = v0 if v0 > b0 else b0
            best[c + np.uint64(1)] = v1 if v1 > b1 else b1
            best[c + np.uint64(2)] = v2 if v2 > b2 else b2
            best[c + np.uint64(3)] = v3 if v3 > b3 else b3


@kernel
def _raise(best, row):
    """Raise the best values to others where those are greater."""
    for i in range(len(best)):
        c = np.uint64(i)
        best[c] = row[c] if row[c] > best[c] else best[c]


@kernel
def _greatest_change(before, after):
    """Return the greatest difference of two rows."""
    change = np.float32(0.0)
    for c in range(len(before)):
        change = max(change, abs(after[c] - before[c]))
    return change

"""Bellman sweeps over V: every action of every state is backed up in every cell, and the best one counts.

Every sweep reads the table of the sweep before and writes another, so its result does not depend on the number of
threads.
"""

import numpy as np
from numba import prange

from crowdsim.jit import kernel
from crowdsim.training.kernels.backup import back_up_action


@kernel(parallel=True)
def improve(model, layers, values, out, best, residuals):
    """Do one Bellman sweep: V'(s, c) = max over a of Q(a, c).

    Args:
        model: ``SweepModel``.
        layers: Layers of the grid.
        values: V. Flat.
        out: Written: V'. Flat.
        best: Written: which action is best, uint16, flat; or empty.
        residuals: Written: by how much the values of each state change at most. Shape (S,).
    """
    cells = model.lowers.shape[2] * layers
    simple = len(model.probabilities) == 1 and model.steps.shape[1] == 4
    steps = model.steps.astype(np.uint64)
    for i in prange(len(model.offsets) - 1):
        s = np.int64(i)
        state_out, state_best = out[s * cells : (s + 1) * cells], best[s * cells : (s + 1) * cells]
        for c in range(cells):
            state_out[c] = -np.inf
        if simple:
            _improve_still(model, steps, layers, values, s, state_out, state_best)
        else:
            weights, row = np.empty(model.steps.shape[1], values.dtype), np.empty(cells, values.dtype)
            _improve_state(model, layers, values, s, weights, row, state_out, state_best)
        residual = 0.0
        for c in range(cells):
            residual = max(residual, abs(state_out[c] - values[s * cells + c]))
        residuals[s] = residual


@kernel(allocates=False)
def _improve_state(model, layers, values, state, weights, row, out, best):
    """Improve one state; ``weights`` and ``row`` are scratch space."""
    first = model.offsets[state]
    for k in range(model.offsets[state + 1] - first):
        back_up_action(model, values, first + k, layers, weights, row)
        for c in range(len(best)):
            best[c] = k if row[c] > out[c] else best[c]
        for c in range(len(out)):
            out[c] = max(row[c], out[c])


@kernel(allocates=False)
def _improve_still(model, steps, layers, values, state, out, best):
    """Improve one state, for a target that stands still and two moving axes.

    The number of layers is part of a type for those numbers that the shipped recipes have, so that compiled code
    unrolls the loops over them.
    """
    first = model.offsets[state]
    for k in range(model.offsets[state + 1] - first):
        if layers == 1:
            _raise_to_action(model, steps, (0,), values, first + k, k, out, best)
        elif layers == 3:
            _raise_to_action(model, steps, (0, 0, 0), values, first + k, k, out, best)
        elif layers == 4:
            _raise_to_action(model, steps, (0, 0, 0, 0), values, first + k, k, out, best)
        else:
            _raise_to_action(model, steps, range(layers), values, first + k, k, out, best)


@kernel(allocates=False)
def _raise_to_action(model, steps, lanes, values, action, k, out, best):
    """Raise ``out`` to Q(action, .) where that is greater, and set ``best``, unless it is empty, to k there.

    Everything in one pass over the cells; those where strikes land, which earns more than 0, are done once more.
    Indices are unsigned, because compiled code would check whether signed ones count from the end. ``lanes`` has as
    many items as the grid has layers.
    """
    layers, keep = np.uint64(len(lanes)), len(best) > 0
    start = np.int64(model.next[action]) * len(out)
    later = values[start : start + len(out)]
    discount = model.discounts[action]
    lowers, shares, near = model.lowers[0, action], model.shares[0, action], model.near[0, action]
    wide = len(near) > 1
    for i in range(len(lowers)):
        m, lower = np.uint64(i), np.uint64(lowers[i])
        w0, w1, w2, w3 = _four_weights(discount, shares, m)
        earned = near[m] if wide else near[0]
        at, e0 = m * layers, lower * layers
        e1, e2, e3 = e0 + steps[lower, 1], e0 + steps[lower, 2], e0 + steps[lower, 3]
        if keep:
            for lane in range(len(lanes)):
                h = np.uint64(lane)
                value = w0 * later[e0 + h] + w1 * later[e1 + h] + w2 * later[e2 + h] + w3 * later[e3 + h]
                value += earned
                best[at + h] = k if value > out[at + h] else best[at + h]
                out[at + h] = max(value, out[at + h])
        else:
            for lane in range(len(lanes)):
                h = np.uint64(lane)
                value = w0 * later[e0 + h] + w1 * later[e1 + h] + w2 * later[e2 + h] + w3 * later[e3 + h]
                out[at + h] = max(value + earned, out[at + h])
    for entry in range(model.landed[action], model.landed[action + 1]):
        c = np.uint64(model.landed_cells[entry])
        m = c // layers
        h, lower = c - m * layers, np.uint64(lowers[m])
        w0, w1, w2, w3 = _four_weights(discount, shares, m)
        e0 = lower * layers
        e1, e2, e3 = e0 + steps[lower, 1], e0 + steps[lower, 2], e0 + steps[lower, 3]
        value = w0 * later[e0 + h] + w1 * later[e1 + h] + w2 * later[e2 + h] + w3 * later[e3 + h]
        value += (near[m] if wide else near[0]) + model.landed_rewards[entry]
        if keep:
            best[c] = k if value > out[c] else best[c]
        out[c] = max(value, out[c])


@kernel(inline=True)
def _four_weights(discount, shares, m):
    """Return the discounted weights of the four corners around the successor of moving cell ``m``."""
    w1 = discount * shares[m, 0]
    w3 = w1 * shares[m, 1]
    w2 = discount * shares[m, 1] - w3
    w0 = discount - w1 - w2
    return w0, w1 - w3, w2, w3

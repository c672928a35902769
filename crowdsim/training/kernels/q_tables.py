"""Bellman sweeps over Q by the paper's backup, ``max_of_interpolated``."""

import numpy as np

from crowdsim.jit import kernel
from crowdsim.training.kernels.successors import DISTANCE, corners_of, empty_successors, find_successor, weights_of


@kernel
def earned_in(model, outcome, action, m, cell):
    """Return r(a, c, o) of one cell, which is in the moving cell ``m``."""
    row = outcome * len(model.next) + action
    low, end = model.landed[row], model.landed[row + 1]
    near = model.near[outcome, action]
    earned = near[0] if len(near) == 1 else (near[m] if len(near) == len(model.xs) else near[cell])
    if low == end:
        return earned
    high = end
    while low < high:
        middle = (low + high) // 2
        if model.landed_cells[middle] < cell:
            low = middle + 1
        else:
            high = middle
    return earned + model.landed_rewards[low] if low < end and model.landed_cells[low] == cell else earned


@kernel
def expected_reward(model, action, m, cell):
    """Return r(a, c), averaged over the velocities of the target."""
    total = model.probabilities[0] * earned_in(model, 0, action, m, cell)
    for outcome in range(1, len(model.probabilities)):
        total += model.probabilities[outcome] * earned_in(model, outcome, action, m, cell)
    return total


@kernel(fastmath={"nnan", "nsz", "reassoc", "contract"})
def _greatest_between(q, n, corners, weights):
    """Return the greatest interpolated Q of a state from the first entries of four cells and their weights."""
    w0, w1, w2, w3 = weights
    e0, e1, e2, e3 = corners
    q0, q1, q2, q3 = q[e0 : e0 + n], q[e1 : e1 + n], q[e2 : e2 + n], q[e3 : e3 + n]
    best = w0 * q0[0] + w1 * q1[0] + w2 * q2[0] + w3 * q3[0]
    for k in range(1, n):
        best = max(best, w0 * q0[k] + w1 * q1[k] + w2 * q2[k] + w3 * q3[k])
    return best


@kernel
def best_after(model, layers, q, outcome, action, m, h, found):
    """Return gamma^T max over a' of interpolated Q(a', e) behind an action in cell (m, h).

    ``found`` is scratch space for one cell (``Successors``).
    """
    find_successor(model, outcome, action, m, found)
    after = model.next[action]
    n = np.int64(model.offsets[after + 1] - model.offsets[after])
    start = np.int64(model.offsets[after]) * len(model.xs) * layers + h * n
    e0, e1, e2, e3 = corners_of(found, 0, np.int64(model.axes[DISTANCE].stride))
    corners = start + np.int64(e0) * n, start + np.int64(e1) * n, start + np.int64(e2) * n, start + np.int64(e3) * n
    return _greatest_between(q, n, corners, weights_of(found, 0, np.float32(1.0)))


@kernel
def best_entry(q, first, n):
    """Return the entry of the greatest of ``n`` values from entry ``first`` on, the first among equals."""
    best = 0
    for k in range(1, n):
        best = k if q[first + k] > q[first + best] else best
    return first + best


@kernel
def _back_up_q(model, layers, q, action, m, h, found):
    """Return the paper's backup of one entry: r + gamma^T max over a' of interpolated Q(a', e), over all outcomes."""
    total = expected_reward(model, action, m, m * layers + h)
    for outcome in range(len(model.probabilities)):
        best = best_after(model, layers, q, outcome, action, m, h, found)
        total += model.discounts[action] * model.probabilities[outcome] * best
    return total


@kernel(allocates=True)
def improve_q(low, high, model, layers, q, out, residuals):
    """Do one sweep of the paper's backup over every action of states ``low`` to ``high`` and every cell."""
    moving, found = len(model.xs), empty_successors(1)
    for s in range(low, high):
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        residual = 0.0
        for k in range(n):
            for m in range(moving):
                for h in range(layers):
                    entry = first * moving * layers + (m * layers + h) * n + k
                    out[entry] = _back_up_q(model, layers, q, first + k, m, h, found)
                    residual = max(residual, abs(out[entry] - q[entry]))
        residuals[s] = residual


@kernel(allocates=True)
def improve_best_q(low, high, model, layers, q, entries, values):
    """Back up only the action that is best so far in every cell of states ``low`` to ``high``.

    Writes which entries change, and to what.
    """
    cells, found = len(model.xs) * layers, empty_successors(1)
    for s in range(low, high):
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for c in range(cells):
            row = first * cells + c * n
            entry = best_entry(q, row, n)
            action = first + entry - row
            entries[s * cells + c] = entry
            values[s * cells + c] = _back_up_q(model, layers, q, action, c // layers, c % layers, found)


@kernel
def values_from_q(low, high, offsets, cells, q, out):
    """Write V(s, c) = max over a of Q(a, c) of states ``low`` to ``high``."""
    for s in range(low, high):
        first = offsets[s]
        n = offsets[s + 1] - first
        for c in range(cells):
            entry = first * cells + c * n
            best = q[entry]
            for k in range(1, n):
                best = max(best, q[entry + k])
            out[s * cells + c] = best


@kernel
def put(low, high, q, entries, values):
    """Write values ``low`` to ``high`` to entries, no two of which are the same."""
    for place in range(low, high):
        q[entries[place]] = values[place]

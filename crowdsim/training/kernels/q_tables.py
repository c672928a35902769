"""Bellman sweeps over Q by the paper's backup, ``max_of_interpolated``."""

import numpy as np
from numba import prange

from crowdsim.jit import kernel
from crowdsim.training.kernels.model import corner_weights, expected_reward


@kernel(fastmath={"nnan", "nsz", "reassoc", "contract"}, allocates=False)
def _greatest_between(q, entry, n, lower, layers, steps, weights):
    """Return the greatest interpolated Q of a state, the table of whose layer starts at ``entry``."""
    corners = len(weights)
    low = entry + lower * layers * n
    if corners == 4:
        q0, q1 = q[low : low + n], q[low + steps[lower, 1] * n : low + steps[lower, 1] * n + n]
        q2 = q[low + steps[lower, 2] * n : low + steps[lower, 2] * n + n]
        q3 = q[low + steps[lower, 3] * n : low + steps[lower, 3] * n + n]
        w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
        best = w0 * q0[0] + w1 * q1[0] + w2 * q2[0] + w3 * q3[0]
        for k in range(n):
            best = max(best, w0 * q0[k] + w1 * q1[k] + w2 * q2[k] + w3 * q3[k])
        return best
    best = weights[0] * q[low]
    for corner in range(1, corners):
        best += weights[corner] * q[low + steps[lower, corner] * n]
    for k in range(1, n):
        value = weights[0] * q[low + k]
        for corner in range(1, corners):
            value += weights[corner] * q[low + steps[lower, corner] * n + k]
        best = max(best, value)
    return best


@kernel(allocates=False)
def best_after(model, layers, q, outcome, action, m, h, weights):
    """Return gamma^T max over a' of interpolated Q(a', e) behind an action in cell (m, h); ``weights`` is scratch."""
    cells = model.lowers.shape[2] * layers
    corner_weights(model.shares, outcome, action, m, weights)
    after = model.next[action]
    n = model.offsets[after + 1] - model.offsets[after]
    start = model.offsets[after] * cells + h * n
    lower = np.int64(model.lowers[outcome, action, m])
    return _greatest_between(q, start, n, lower, layers, model.steps, weights)


@kernel(allocates=False)
def best_entry(q, first, n):
    """Return the entry of the greatest of ``n`` values from entry ``first`` on, the first among equals."""
    best = 0
    for k in range(1, n):
        best = k if q[first + k] > q[first + best] else best
    return first + best


@kernel(allocates=False)
def _back_up_q(model, layers, q, action, m, h, weights):
    """Return the paper's backup of one entry: r + gamma^T max over a' of interpolated Q(a', e), over all outcomes."""
    total = expected_reward(model, action, m, m * layers + h)
    for outcome in range(len(model.probabilities)):
        best = best_after(model, layers, q, outcome, action, m, h, weights)
        total += model.discounts[action] * model.probabilities[outcome] * best
    return total


@kernel(parallel=True)
def improve_q(model, layers, q, out, residuals):
    """Do one sweep of the paper's backup over every action of every state and every cell."""
    moving = model.lowers.shape[2]
    for i in prange(len(model.offsets) - 1):
        s = np.int64(i)
        weights = np.empty(model.steps.shape[1], q.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        residual = 0.0
        for k in range(n):
            for m in range(moving):
                for h in range(layers):
                    entry = first * moving * layers + (m * layers + h) * n + k
                    out[entry] = _back_up_q(model, layers, q, first + k, m, h, weights)
                    residual = max(residual, abs(out[entry] - q[entry]))
        residuals[s] = residual


@kernel(parallel=True)
def improve_best_q(model, layers, q, entries, values):
    """Back up only the action that is best so far in every state and cell; write which entries change, and to what."""
    cells = model.lowers.shape[2] * layers
    for i in prange(len(model.offsets) - 1):
        s = np.int64(i)
        weights = np.empty(model.steps.shape[1], q.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for c in range(cells):
            row = first * cells + c * n
            entry = best_entry(q, row, n)
            action = first + entry - row
            entries[s * cells + c] = entry
            values[s * cells + c] = _back_up_q(model, layers, q, action, c // layers, c % layers, weights)


@kernel(parallel=True)
def values_from_q(offsets, cells, q, out):
    """Write V(s, c) = max over a of Q(a, c)."""
    for s in prange(len(offsets) - 1):
        first = offsets[s]
        n = offsets[s + 1] - first
        for c in range(cells):
            entry = first * cells + c * n
            best = q[entry]
            for k in range(1, n):
                best = max(best, q[entry + k])
            out[s * cells + c] = best


@kernel(parallel=True)
def put(q, entries, values):
    """Write values to entries, no two of which are the same."""
    for place in prange(len(entries)):
        q[entries[place]] = values[place]

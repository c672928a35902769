"""Policy evaluation over V: only the action that is best so far is backed up; and the Q-table of values V."""

import numpy as np
from numba import prange

from crowdsim.jit import kernel
from crowdsim.training.kernels.backup import back_up_action
from crowdsim.training.kernels.model import corner_weights, expected_reward


@kernel(parallel=True)
def gather_best(model, layers, best, earned, entries, weights):
    """Write what ``follow`` needs of the best actions: reward, entries of V behind them, their discounted weights."""
    corners = model.steps.shape[1]
    for i in prange(len(model.offsets) - 1):
        share = np.empty(corners, weights.dtype)
        _gather_state(model, layers, np.int64(i), best, earned, entries, weights, share)


@kernel(allocates=False)
def _gather_state(model, layers, state, best, earned, entries, weights, share):
    """Do what ``gather_best`` does for one state; ``share`` is scratch space."""
    cells = model.lowers.shape[2] * layers
    for c in range(cells):
        at = state * cells + c
        m, h = c // layers, c % layers
        action = model.offsets[state] + best[at]
        earned[at] = expected_reward(model, action, m, c)
        for outcome in range(len(model.probabilities)):
            corner_weights(model.shares, outcome, action, m, share)
            lower = np.int64(model.lowers[outcome, action, m])
            factor = model.discounts[action] * model.probabilities[outcome]
            for corner in range(len(share)):
                place = outcome * len(share) + corner
                entries[at, place] = model.next[action] * cells + lower * layers + model.steps[lower, corner] + h
                weights[at, place] = factor * share[corner]


@kernel(parallel=True)
def follow(earned, entries, weights, values, out):
    """Do one sweep of policy evaluation: V'(s, c) = Q(best action, c)."""
    for at in prange(len(out)):
        total = earned[at]
        for place in range(entries.shape[1]):
            total += weights[at, place] * values[entries[at, place]]
        out[at] = total


@kernel(parallel=True)
def q_from_values(model, layers, values, out):
    """Write Q(a, c) of every action by interpolated V, in the layout of a Q-table."""
    cells = model.lowers.shape[2] * layers
    for i in prange(len(model.offsets) - 1):
        s = np.int64(i)
        weights, row = np.empty(model.steps.shape[1], values.dtype), np.empty(cells, values.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for k in range(n):
            back_up_action(model, values, first + k, layers, weights, row)
            for c in range(cells):
                out[first * cells + c * n + k] = row[c]

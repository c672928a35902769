"""Q-values of one action in all cells, by interpolated V.

A loop over one layer would cost more than its work, hence the branches for a single one.
"""

import numpy as np

from crowdsim.jit import kernel
from crowdsim.training.kernels.model import corner_weights


@kernel(allocates=False)
def back_up_action(model, values, action, layers, weights, row):
    """Write Q(action, .) for all cells to ``row``, by interpolated V; ``weights`` is scratch space."""
    row[: model.lowers.shape[2] * layers] = 0.0
    for outcome in range(model.lowers.shape[0]):
        _add_rewards(model, outcome, action, layers, row)
        if model.steps.shape[1] == 4:
            _add_values_of_four(model, values, outcome, action, layers, row)
        else:
            _add_values(model, values, outcome, action, layers, weights, row)


@kernel(allocates=False)
def _add_rewards(model, outcome, action, layers, row):
    """Add what an action earns, times the probability of an outcome."""
    probability = model.probabilities[outcome]
    wide = model.near.shape[2] > 1
    for m in range(model.lowers.shape[2]):
        earned = probability * model.near[outcome, action, m if wide else 0]
        if layers == 1:
            row[m] += earned
        else:
            for h in range(layers):
                row[m * layers + h] += earned
    at = outcome * len(model.next) + action
    for entry in range(model.landed[at], model.landed[at + 1]):
        row[model.landed_cells[entry]] += probability * model.landed_rewards[entry]


@kernel(allocates=False)
def _add_values_of_four(model, values, outcome, action, layers, row):
    """Add what follows an action on a grid of two moving axes, discounted, times the probability of an outcome."""
    factor = model.discounts[action] * model.probabilities[outcome]
    base = model.next[action] * model.lowers.shape[2] * layers
    one = np.float32(1.0)
    for m in range(model.lowers.shape[2]):
        lower = np.int64(model.lowers[outcome, action, m])
        entry = base + lower * layers
        u, v = model.shares[outcome, action, m, 0], model.shares[outcome, action, m, 1]
        w0, w1 = factor * (one - u) * (one - v), factor * u * (one - v)
        w2, w3 = factor * (one - u) * v, factor * u * v
        e1, e2, e3 = entry + model.steps[lower, 1], entry + model.steps[lower, 2], entry + model.steps[lower, 3]
        if layers == 1:
            row[m] += w0 * values[entry] + w1 * values[e1] + w2 * values[e2] + w3 * values[e3]
        else:
            for h in range(layers):
                later = w0 * values[entry + h] + w1 * values[e1 + h] + w2 * values[e2 + h] + w3 * values[e3 + h]
                row[m * layers + h] += later


@kernel(allocates=False)
def _add_values(model, values, outcome, action, layers, weights, row):
    """Do the same on a grid of any number of moving axes."""
    factor = model.discounts[action] * model.probabilities[outcome]
    base = model.next[action] * model.lowers.shape[2] * layers
    for m in range(model.lowers.shape[2]):
        lower = np.int64(model.lowers[outcome, action, m])
        entry = base + lower * layers
        first = m * layers
        corner_weights(model.shares, outcome, action, m, weights)
        for corner in range(model.steps.shape[1]):
            at = entry + model.steps[lower, corner]
            weight = factor * weights[corner]
            for h in range(layers):
                row[first + h] += weight * values[at + h]

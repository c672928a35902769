"""Q-values of one action in all cells, by interpolated V."""

import numpy as np

from crowdsim.jit import kernel
from crowdsim.training.kernels.successors import (
    DISTANCE,
    corners_of,
    find_moved,
    find_successors,
    see_layers,
    weights_of,
)


@kernel
def back_up_action(model, layers, values, action, found, changed, row):
    """Write Q(action, .) for all cells to ``row``, by interpolated V.

    ``found`` (``Successors``) and ``changed`` (C,) are scratch space.
    """
    for c in range(len(row)):
        row[c] = np.float32(0.0)
    later = values[np.int64(model.next[action]) * len(row) : (np.int64(model.next[action]) + 1) * len(row)]
    if len(model.layered.axes) > 0:
        see_layers(model.layered, model.ends[0, action], layers, later, found.corners, changed)
        later = changed
    for outcome in range(len(model.probabilities)):
        end, probability = model.ends[outcome, action], model.probabilities[outcome]
        near, runs = model.near[outcome, action], model.layered.runs
        across, factor = np.int64(model.axes[DISTANCE].stride), model.discounts[action] * probability
        if len(runs) == 0:
            find_successors(model.axes, end, model.xs, model.zs, found)
            _add_values(found, across, layers, 0, layers, later, factor, probability, near, row)
        for run in range(len(runs) - 1):
            find_moved(model, layers, runs[run], end, found)
            _add_values(found, across, layers, runs[run], runs[run + 1], later, factor, probability, near, row)
        if model.near.shape[2] > len(model.xs):
            for c in range(len(row)):
                row[c] += probability * model.near[outcome, action, c]
        at = outcome * len(model.next) + action
        for entry in range(model.landed[at], model.landed[at + 1]):
            row[model.landed_cells[entry]] += probability * model.landed_rewards[entry]


@kernel
def _add_values(found, across, layers, low, high, later, factor, probability, near, row):
    """Add what an action earns and what follows it in layers ``low`` to ``high``, landed strikes left out.

    Indices are unsigned, because compiled code would check whether signed ones count from the end.
    """
    wide, once = len(near) == len(found.lowers), near[0] if len(near) == 1 else np.float32(0.0)
    for i in range(len(found.lowers)):
        m = np.uint64(i)
        e0, e1, e2, e3 = corners_of(found, m, across)
        w0, w1, w2, w3 = weights_of(found, m, factor)
        earned = probability * (near[m] if wide else once)
        at = m * np.uint64(layers)
        for lane in range(low, high):
            h = np.uint64(lane)
            value = w0 * later[e0 + h] + w1 * later[e1 + h] + w2 * later[e2 + h] + w3 * later[e3 + h]
            row[at + h] += value + earned

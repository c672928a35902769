"""What decisions are worth: how much actions of a state differ, and which of them are worth keeping."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, Target
from crowdsim.policy.kernels.axes import find_layers_after
from crowdsim.training.kernels.rewards import earned_where, write_near
from crowdsim.training.kernels.successors import DISTANCE, corners_of, empty_successors, find_successors, weights_of

WORST = -1e30  # below all values


class Learned(NamedTuple):
    """What a behaviour has learned, and N targets by which its decisions are judged.

    Attributes:
        axes: The axes over the ground of its grid (``Model.axes``).
        ends: Where each action ends (``Model.ends``), for a target at rest. Shape (A,).
        layered: What its layers see, where that changes (``Model.layered``).
        discounts: gamma^T of each action. Shape (A,), float32.
        values: V. Shape (S, C), float32.
        terms: The terms of its reward (``rewards.pack_terms``).
        once: What each action earns wherever the target is. Shape (A,).
        log_discount: log gamma.
        heights: How high their heads are [m]. Shape (N,).
        measures: What the axes of the layers measure of them. Shape (N, axes).
        layers: Layers of the grid around each target. Shape (E, N), int64.
        shares: Their shares. Shape (E, N), float32.
        lead: How many frames after the end of an action its V is read for where a target will be.
    """

    axes: Any
    ends: Any
    layered: Any
    discounts: Any
    values: Any
    terms: Any
    once: Any
    log_discount: float
    heights: Any
    measures: Any
    layers: Any
    shares: Any
    lead: float


class Judged(NamedTuple):
    """What transitions are judged by, for B behaviours and N targets.

    Attributes:
        values: Q of each behaviour, action and target. Shape (B, A, N), float32.
        factors: How much each behaviour counts for a target, over its scale. Shape (B, N).
        prices: What the transition into each action costs each behaviour, 0 where there is none. Shape (B, A).
    """

    values: Any
    factors: Any
    prices: Any


@kernel(allocates=True)
def fill_action_values(low, high, actions, learned, places, out):
    """Write Q of actions ``low`` to ``high`` for each target, by looking one action ahead.

    Args:
        low: First action.
        high: One past the last.
        actions: ``Actions``.
        learned: ``Learned``.
        places: Where the targets are, and how they move (``Places``).
        out: Written: Q. Shape (A, N), float32.
    """
    count = out.shape[1]
    best, found = np.empty(count, np.float32), empty_successors(count)
    xs, zs = np.empty(count, np.float32), np.empty(count, np.float32)
    layers, shares = learned.layers.copy(), learned.shares.copy()
    for action in range(low, high):
        total = out[action]
        once = learned.once[action]
        write_near(actions, action, places, learned.terms, once, learned.log_discount, best, total)
        _add_landed(actions, action, learned, places, total)
        time = min(np.float32(actions.lengths[action] + learned.lead), places.lasts)
        for m in range(count):
            xs[m] = places.xs[m] + time * places.vxs[m]
            zs[m] = places.zs[m] + time * places.vzs[m]
        find_successors(learned.axes, learned.ends[action], xs, zs, found)
        if len(learned.layered.axes) > 0:
            _change_layers(learned, action, found.corners, layers, shares)
        _add_values_behind(learned, action, actions.next[action], found, layers, shares, total)


@kernel
def _add_landed(actions, action, learned, places, total):
    """Add what the strikes of an action earn that land on the targets."""
    if actions.strike_offsets[action] < actions.strike_offsets[action + 1]:
        for m in range(len(total)):
            target = Target(
                places.xs[m],
                learned.heights[m],
                places.zs[m],
                places.vxs[m],
                places.vzs[m],
                0.0,
                UNSEEN_STRIKE,
                places.lasts,
            )
            total[m] += earned_where(actions, action, target, learned.terms, learned.log_discount)


@kernel
def _change_layers(learned, action, corners, layers, shares):
    """Write the layers around each target as it is seen after an action, and their shares."""
    for m in range(layers.shape[1]):
        find_layers_after(learned.layered.axes, learned.measures[m], learned.ends[action], corners)
        for corner in range(len(layers)):
            layers[corner, m], shares[corner, m] = corners.cells[corner], corners.weights[corner]


@kernel
def _add_values_behind(learned, action, state, found, layers, shares, total):
    """Add the discounted V of the state behind an action, where ``found`` says that targets are seen."""
    values, across = learned.values[state], np.int64(learned.axes[DISTANCE].stride)
    for m in range(len(total)):
        e0, e1, e2, e3 = corners_of(found, m, across)
        w0, w1, w2, w3 = weights_of(found, m, learned.discounts[action])
        for side in range(len(layers)):
            h = np.uint64(layers[side, m])
            value = w0 * values[e0 + h] + w1 * values[e1 + h] + w2 * values[e2 + h] + w3 * values[e3 + h]
            total[m] += shares[side, m] * value


@kernel(allocates=True)
def action_spreads(low, high, offsets, values, out):
    """Write by how much the best action of each state is better than the median one; NaN where there is only one.

    Args:
        low: First state.
        high: One past the last.
        offsets: CSR: the actions of each state. Shape (S + 1,).
        values: Q of each action for N targets. Shape (A, N), float32.
        out: Written: the spreads. Shape (S, N).
    """
    for s in range(low, high):
        n = offsets[s + 1] - offsets[s]
        row = np.empty(n)
        for m in range(out.shape[1]):
            for k in range(n):
                row[k] = values[offsets[s] + k, m]
            out[s, m] = spread_of(row, n) if n > 1 else np.nan


@kernel
def spread_of(values, n):
    """Return the greatest of ``n`` values less their median; the values are reordered."""
    upper = _nth_smallest(values, n, n // 2)  # those before it are not greater, those behind it not smaller
    greatest, lower = upper, -math.inf
    for k in range(n):
        if k < n // 2:
            lower = max(lower, values[k])
        greatest = max(greatest, values[k])
    return greatest - (upper if n % 2 == 1 else (lower + upper) / 2)


@kernel
def _nth_smallest(values, n, place):
    """Return the value that comes ``place``-th, counted from 0, in ascending order of the first ``n``; reorder them."""
    low, high = 0, n - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            break
    return values[place]


@kernel(allocates=True)
def judge_transitions(low, high, offsets, jumps, judged, most, keep, gains):
    """Mark the actions of each state that are worth keeping, and write what each adds (``pruning.judge_transitions``).

    Args:
        low: First state.
        high: One past the last.
        offsets: CSR: the actions of each state. Shape (S + 1,).
        jumps: Whether each action begins with a transition; the others are always kept. Shape (A,).
        judged: ``Judged``.
        most: Most actions with a transition that a state keeps.
        keep: Written: 1 where an action is kept. Shape (A,), uint8.
        gains: Written: by how much each of them, when it was taken, raised the best value on the average. Shape (A,).
    """
    behaviours, _, targets = judged.values.shape
    count = (behaviours + 1 if behaviours > 1 else 1) * targets
    for s in range(low, high):
        first, end = np.int64(offsets[s]), np.int64(offsets[s + 1])
        values, best = np.empty((end - first, count)), np.full(count, WORST)
        for k in range(end - first):
            _weigh_action(judged, first + k, values[k])
            if not jumps[first + k]:
                keep[first + k] = 1
                _raise(best, values[k])
        _keep_best(values, best, most, keep[first:end], gains[first:end])


@kernel
def _weigh_action(judged, action, out):
    """Write what an action is worth to each behaviour, target by target, and then to all of them together.

    Together a transition costs what it costs the behaviour that it costs most, as in ``policy.kernels.values``.
    """
    behaviours, _, targets = judged.values.shape
    for m in range(targets):
        total, prices, highest, active = 0.0, 0.0, 0.0, 0
        for b in range(behaviours):
            factor = judged.factors[b, m]
            worth, price = factor * judged.values[b, action, m], factor * judged.prices[b, action]
            out[b * targets + m] = worth
            total += worth
            prices += price
            highest = max(highest, price)
            active += 1 if factor != 0.0 else 0
        if behaviours > 1:
            out[behaviours * targets + m] = total + (prices - highest if active > 1 else 0.0)


@kernel
def _raise(best, values):
    """Raise the best values to others where those are greater."""
    for m in range(len(best)):
        best[m] = max(best[m], values[m])


@kernel
def _keep_best(values, best, most, keep, gains):
    """Keep the actions of one state one by one, always the one that adds most to the best values."""
    for _ in range(most):
        chosen, most_gained = -1, 0.0
        for k in range(len(keep)):
            if keep[k] == 0:
                gained = 0.0
                for m in range(len(best)):
                    gained += max(values[k, m] - best[m], 0.0)
                if gained > most_gained:
                    chosen, most_gained = k, gained
        if chosen < 0:
            break
        # Where no captured frame follows, the first transition adds the whole value, as much as the spread of the
        # state's values.
        gains[chosen] = min(most_gained / len(best), 1.0)
        keep[chosen] = 1
        _raise(best, values[chosen])

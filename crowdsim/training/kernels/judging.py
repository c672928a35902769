"""What decisions are worth: how much actions of a state differ, and which of them are worth keeping."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.rewards import Target
from crowdsim.policy.kernels.values import evaluate_actions, fade_of

# Columns of targets.
X, Y, Z, VX, VZ = range(5)

WORST = -1e30  # below all values


class Situations(NamedTuple):
    """What actions are judged by.

    Attributes:
        tables: ``LookupTables``.
        weights: Weights of the behaviours. Shape (M, B).
        targets: Where the target is and how far it moves in a control frame along x and z. Shape (N, 5).
    """

    tables: Any
    weights: Any
    targets: Any


@kernel
def action_spreads(tables, targets, out):
    """Write by how much the best action of each state is better than the median one, by the first behaviour.

    NaN where there is one action, or the behaviour counts for nothing. ``out``: shape (S, N) for N targets (N, 5).
    """
    corners = Corners(np.empty(64, np.int64), np.empty(64))
    one = np.ones(1)
    most = 0
    for s in range(out.shape[0]):
        most = max(most, tables.actions.offsets[s + 1] - tables.actions.offsets[s])
    values = np.empty(most)
    for s in range(out.shape[0]):
        for m in range(len(targets)):
            target = _target(targets, m)
            if fade_of(tables, 0, target) > 0.0:
                n = evaluate_actions(tables, one, s, target, corners, values)
                if n > 1:
                    out[s, m] = spread_of(values, n)


@kernel(allocates=False)
def _target(targets, m):
    """Return a row of targets."""
    return Target(targets[m, X], targets[m, Y], targets[m, Z], targets[m, VX], targets[m, VZ])


@kernel(allocates=False)
def spread_of(values, n):
    """Return the greatest of ``n`` values less their median; the values are reordered."""
    upper = _nth_smallest(values, n, n // 2)  # those before it are not greater, those behind it not smaller
    greatest, lower = upper, -math.inf
    for k in range(n):
        if k < n // 2:
            lower = max(lower, values[k])
        greatest = max(greatest, values[k])
    return greatest - (upper if n % 2 == 1 else (lower + upper) / 2)


@kernel(allocates=False)
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


@kernel
def judge_ways(situations, cuts, most, first_state, last_state, keep, gains):
    """Mark the actions of each state that are worth keeping, and write what each adds (``pruning.judge_ways``).

    Args:
        situations: ``Situations``.
        cuts: Whether each action begins with a cut; those that do not are always kept. Shape (A,).
        most: How many others are kept at most.
        first_state: First of the states.
        last_state: One after the last.
        keep: Written: 1 where an action is kept. Shape (A,), uint8.
        gains: Written: by how much each of them, when it was taken, raised the best value on the average. Shape (A,).
    """
    offsets = situations.tables.actions.offsets
    count = len(situations.weights) * len(situations.targets)
    corners = Corners(np.empty(64, np.int64), np.empty(64))
    best = np.empty(count)
    for s in range(first_state, last_state):
        first, end = offsets[s], offsets[s + 1]
        values, row = np.empty((end - first, count)), np.empty(end - first)
        _evaluate_situations(situations, s, corners, row, values)
        for m in range(count):
            best[m] = WORST
        for k in range(end - first):
            if not cuts[first + k]:
                keep[first + k] = 1
                _raise(best, values[k])
        _keep_best(values, best, most, keep[first:end], gains[first:end])


@kernel(allocates=False)
def _evaluate_situations(situations, state, corners, row, out):
    """Write the values of the actions of a state in every situation, shape (n, M * N); ``row`` is scratch space."""
    targets = situations.targets
    for m in range(out.shape[1]):
        weights = situations.weights[m // len(targets)]
        evaluate_actions(situations.tables, weights, state, _target(targets, m % len(targets)), corners, row)
        for k in range(out.shape[0]):
            out[k, m] = row[k]


@kernel(allocates=False)
def _raise(best, values):
    """Raise the best values to others where those are greater."""
    for m in range(len(best)):
        best[m] = max(best[m], values[m])


@kernel(allocates=False)
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
        # Where no captured frame follows, the first way out adds all there is: as much as a state's whole spread.
        gains[chosen] = min(most_gained / len(best), 1.0)
        keep[chosen] = 1
        _raise(best, values[chosen])

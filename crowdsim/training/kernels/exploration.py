"""Q-learning: rounds of trials, of everything and of the best actions (``q_learning.q_learning``)."""

from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel
from crowdsim.training.kernels.draws import draw_number
from crowdsim.training.kernels.q_tables import best_after, best_entry, earned_in
from crowdsim.training.kernels.successors import empty_successors

GOLDEN = 0.6180339887498949
"""Draws of one entry follow one another by this, so that all velocities of the target are drawn evenly in few
visits."""

OFFSET = 0x2545F4914F6CDD1D
"""Tells these draws from others with the same seed."""


class Learning(NamedTuple):
    """How entries of a Q-table learn.

    Attributes:
        visits: Trials that each entry has had, counted on. Flat, uint16.
        step_sizes: alpha by the number of visits; the last one stays. Flat, float32.
        seed: Of the draws.
    """

    visits: Any
    step_sizes: Any
    seed: Any


@kernel
def _first_draw(learning, entry):
    """Return the number at which the draws of an entry begin."""
    return draw_number(learning.seed, entry, np.uint64(OFFSET))


@kernel
def _step_size(learning, entry):
    """Return alpha of an entry."""
    return learning.step_sizes[min(learning.visits[entry], len(learning.step_sizes) - 1)]


@kernel
def _observe(model, layers, q, action, m, h, draw, found):
    """Do one trial of an action with the target in cell (m, h); return r + gamma^T max over a' of Q(a', e)."""
    outcome = 0
    while outcome < len(model.probabilities) - 1 and draw >= model.probabilities[outcome]:
        draw -= model.probabilities[outcome]
        outcome += 1
    earned = earned_in(model, outcome, action, m, m * layers + h)
    return earned + model.discounts[action] * best_after(model, layers, q, outcome, action, m, h, found)


@kernel(allocates=True)
def try_everything(low, high, model, layers, q, out, learning, changes):
    """Do one round of exploration: every action of states ``low`` to ``high`` is tried once in every cell.

    Q := Q + alpha (observed - Q), where what is observed reads the table of the round before; ``learning`` is a
    ``Learning``, and ``changes`` get the sum of the errors of each state.
    """
    moving, found = len(model.xs), empty_successors(1)
    visits = learning.visits
    for s in range(low, high):
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        change = 0.0
        for k in range(n):
            for m in range(moving):
                for h in range(layers):
                    entry = first * moving * layers + (m * layers + h) * n + k
                    draw = _first_draw(learning, entry) + visits[entry] * GOLDEN
                    error = _observe(model, layers, q, first + k, m, h, draw % 1.0, found) - q[entry]
                    out[entry] = q[entry] + _step_size(learning, entry) * error
                    visits[entry] += 1
                    change += abs(error)
        changes[s] = change


@kernel(allocates=True)
def try_best(low, high, model, layers, q, entries, values, learning, tries):
    """Do one round of exploitation: the action that is best so far in a cell is tried a few times.

    That is done in every cell of states ``low`` to ``high``.
    Writes which entries change, and to what, so that all trials read the table of the round before. The entry moves by
    the mean of its trials: one that is tried until it is no longer the best would else end too low.
    """
    cells, found = len(model.xs) * layers, empty_successors(1)
    visits = learning.visits
    for s in range(low, high):
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for c in range(cells):
            row = first * cells + c * n
            entry = best_entry(q, row, n)
            action = first + entry - row
            observed = np.float32(0.0)
            for trial in range(tries):
                draw = (_first_draw(learning, entry) + (visits[entry] + trial) * GOLDEN) % 1.0
                observed += _observe(model, layers, q, action, c // layers, c % layers, draw, found)
            error = observed / np.float32(tries) - q[entry]
            entries[s * cells + c] = entry
            values[s * cells + c] = q[entry] + _step_size(learning, entry) * error
            visits[entry] += tries

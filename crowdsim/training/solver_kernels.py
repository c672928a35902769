"""Compiled sweeps over the model of ``model.py``, which says what the arrays are.

Values V lie flat at ``state * cells + cell``, Q-values at ``offsets[state] * cells + cell * n + k``. Every sweep reads
the table of the sweep before and writes another, so its result does not depend on the number of threads.
"""

import numpy as np
from numba import prange

from crowdsim.jit import kernel

GOLDEN = 0.6180339887498949
"""Draws of one entry follow one another by this, so that all ways of the target come up evenly in few visits."""


@kernel
def corner_weights(shares, outcome, action, cell, weights):
    """Write the multilinear weights of the corners of one successor, in the order of ``model.corner_steps``."""
    weights[0] = 1.0
    count = 1
    for d in range(shares.shape[3]):
        share = shares[outcome, action, cell, d]
        for corner in range(count):
            weights[count + corner] = weights[corner] * share
            weights[corner] *= np.float32(1.0) - share
        count *= 2


@kernel
def earned_in(model, outcome, action, m, cell):
    """Return r(a, c, o) of one cell, which is in the moving cell ``m``."""
    row = outcome * len(model.next) + action
    low, end = model.landed[row], model.landed[row + 1]
    earned = model.near[outcome, action, m if model.near.shape[2] > 1 else 0]
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
    """Return r(a, c), averaged over the ways in which the target moves."""
    total = model.probabilities[0] * earned_in(model, 0, action, m, cell)
    for outcome in range(1, len(model.probabilities)):
        total += model.probabilities[outcome] * earned_in(model, outcome, action, m, cell)
    return total


@kernel
def back_up_action(model, values, action, layers, weights, row):
    """Write Q(action, .) for all cells to ``row``, by interpolated V."""
    ways, moving = model.lowers.shape[0], model.lowers.shape[2]
    cells = moving * layers
    base = model.next[action] * cells
    corners = model.steps.shape[1]
    discount = model.discounts[action]
    wide = model.near.shape[2] > 1
    row[:cells] = 0.0
    for outcome in range(ways):
        probability = model.probabilities[outcome]
        factor = discount * probability
        for m in range(moving):
            earned = probability * model.near[outcome, action, m if wide else 0]
            for h in range(layers):
                row[m * layers + h] += earned
        at = outcome * len(model.next) + action
        for entry in range(model.landed[at], model.landed[at + 1]):
            row[model.landed_cells[entry]] += probability * model.landed_rewards[entry]
        for m in range(moving):
            lower = np.int64(model.lowers[outcome, action, m])
            entry = base + lower * layers
            first = m * layers
            if corners == 4:
                u, v = model.shares[outcome, action, m, 0], model.shares[outcome, action, m, 1]
                one = np.float32(1.0)
                w0, w1 = factor * (one - u) * (one - v), factor * u * (one - v)
                w2, w3 = factor * (one - u) * v, factor * u * v
                e1, e2, e3 = entry + model.steps[lower, 1], entry + model.steps[lower, 2], entry + model.steps[lower, 3]
                for h in range(layers):
                    later = w0 * values[entry + h] + w1 * values[e1 + h] + w2 * values[e2 + h] + w3 * values[e3 + h]
                    row[first + h] += later
            else:
                corner_weights(model.shares, outcome, action, m, weights)
                for corner in range(corners):
                    at = entry + model.steps[lower, corner]
                    weight = factor * weights[corner]
                    for h in range(layers):
                        row[first + h] += weight * values[at + h]


@kernel
def improve_by_action(values, lowers, shares, steps, discount, near, cells, landed, k, lanes, out, best):
    """Raise ``out``, the V of a state in each cell, to Q(action, .) where that is greater, and set ``best`` to k there.

    For a target that stands still and two moving axes: everything in one pass over the cells. ``values`` are those of
    the next state alone. The length of ``lanes`` is known when the kernel is compiled, so that loops over it unroll;
    indices are unsigned, since compiled code would look whether signed ones count from the end. ``near`` is what is
    earned in each moving cell, or everywhere; ``cells`` and ``landed`` say where strikes land and what that earns,
    which is above 0, so that these few cells can be done once more. ``best`` may be None, where nobody asks which
    action it is.
    """
    layers = np.uint64(len(lanes))
    wide = len(near) > 1
    for i in range(len(lowers)):
        m, lower = np.uint64(i), np.uint64(lowers[i])
        at = m * layers
        w1 = discount * shares[m, 0]
        w3 = w1 * shares[m, 1]
        w2 = discount * shares[m, 1] - w3
        w0 = discount - w1 - w2
        w1 -= w3
        earned = near[m] if wide else near[0]
        e0 = lower * layers
        e1, e2, e3 = e0 + steps[lower, 1], e0 + steps[lower, 2], e0 + steps[lower, 3]
        for lane in range(len(lanes)):
            h = np.uint64(lane)
            value = w0 * values[e0 + h] + w1 * values[e1 + h] + w2 * values[e2 + h] + w3 * values[e3 + h]
            value += earned
            if best is not None:
                best[at + h] = k if value > out[at + h] else best[at + h]
            out[at + h] = max(value, out[at + h])
    for i in range(len(cells)):
        c = np.uint64(cells[i])
        m = c // layers
        h, lower = c - m * layers, np.uint64(lowers[m])
        w1 = discount * shares[m, 0]
        w3 = w1 * shares[m, 1]
        w2 = discount * shares[m, 1] - w3
        w0 = discount - w1 - w2
        w1 -= w3
        e0 = lower * layers
        e1, e2, e3 = e0 + steps[lower, 1], e0 + steps[lower, 2], e0 + steps[lower, 3]
        value = w0 * values[e0 + h] + w1 * values[e1 + h] + w2 * values[e2 + h] + w3 * values[e3 + h]
        value += (near[m] if wide else near[0]) + landed[i]
        if best is not None:
            best[c] = k if value > out[c] else best[c]
        out[c] = max(value, out[c])


@kernel(parallel=True)
def improve(model, lanes, values, out, best, residuals):
    """Do one Bellman sweep: V'(s, c) = max over a of Q(a, c); write which action is best, and each state's change.

    ``lanes`` is a tuple of as many numbers as the grid has layers; ``best`` may be None.
    """
    cells = model.lowers.shape[2] * len(lanes)
    simple = len(model.probabilities) == 1 and model.steps.shape[1] == 4
    steps = model.steps.astype(np.uint64)
    for s in prange(len(model.offsets) - 1):
        first = model.offsets[s]
        state_out = out[s * cells : (s + 1) * cells]
        state_best = None if best is None else best[s * cells : (s + 1) * cells]
        state_out[:] = -np.inf
        if simple:
            for k in range(model.offsets[s + 1] - first):
                a = first + k
                base = model.next[a] * cells
                later = values[base : base + cells]
                lowers, shares = model.lowers[0, a], model.shares[0, a]
                some = slice(model.landed[a], model.landed[a + 1])
                improve_by_action(
                    later, lowers, shares, steps, model.discounts[a], model.near[0, a], model.landed_cells[some],
                    model.landed_rewards[some], k, lanes, state_out, state_best,
                )  # fmt: skip
        else:
            weights = np.empty(model.steps.shape[1], values.dtype)
            row_values = np.empty(cells, values.dtype)
            for k in range(model.offsets[s + 1] - first):
                back_up_action(model, values, first + k, len(lanes), weights, row_values)
                for c in range(cells):
                    if state_best is not None:
                        state_best[c] = k if row_values[c] > state_out[c] else state_best[c]
                    state_out[c] = max(row_values[c], state_out[c])
        residual = 0.0
        for c in range(cells):
            residual = max(residual, abs(state_out[c] - values[s * cells + c]))
        residuals[s] = residual


@kernel(parallel=True)
def apply_along_axis(operator, values, out):
    """Write a matrix (n, m) times values (S, before, m, after), along their third axis, to ``out``."""
    for s in prange(len(values)):
        row = np.empty(values.shape[3])
        for b in range(values.shape[1]):
            for i in range(operator.shape[0]):
                row[:] = 0.0
                for j in range(operator.shape[1]):
                    weight = operator[i, j]
                    if abs(weight) > 1e-6:
                        for h in range(len(row)):
                            row[h] += weight * values[s, b, j, h]
                out[s, b, i] = row


@kernel(parallel=True)
def gather_best(model, layers, best, earned, entries, weights):
    """Write what ``follow`` needs of the best actions: reward, entries of V behind them, their discounted weights."""
    moving, corners = model.lowers.shape[2], model.steps.shape[1]
    cells = moving * layers
    for s in prange(len(model.offsets) - 1):
        share = np.empty(corners, weights.dtype)
        for c in range(cells):
            at = s * cells + c
            m, h = c // layers, c % layers
            a = model.offsets[s] + best[at]
            earned[at] = expected_reward(model, a, m, c)
            for outcome in range(len(model.probabilities)):
                corner_weights(model.shares, outcome, a, m, share)
                lower = np.int64(model.lowers[outcome, a, m])
                factor = model.discounts[a] * model.probabilities[outcome]
                for corner in range(corners):
                    place = outcome * corners + corner
                    entries[at, place] = model.next[a] * cells + lower * layers + model.steps[lower, corner] + h
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
    for s in prange(len(model.offsets) - 1):
        weights = np.empty(model.steps.shape[1], values.dtype)
        row = np.empty(cells, values.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for k in range(n):
            back_up_action(model, values, first + k, layers, weights, row)
            for c in range(cells):
                out[first * cells + c * n + k] = row[c]


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


@kernel(fastmath={"nnan", "nsz", "reassoc", "contract"})
def greatest_between(q, entry, n, lower, layers, steps, weights, corners):
    """Return the greatest interpolated Q of a state, the table of whose layer starts at ``entry``."""
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


@kernel
def back_up_q(model, layers, q, action, m, h, weights):
    """Return the paper's backup of one entry: r + gamma^T max over a' of interpolated Q(a', e), over all outcomes."""
    cells = model.lowers.shape[2] * layers
    total = expected_reward(model, action, m, m * layers + h)
    after = model.next[action]
    n = model.offsets[after + 1] - model.offsets[after]
    start = model.offsets[after] * cells + h * n
    for outcome in range(len(model.probabilities)):
        corner_weights(model.shares, outcome, action, m, weights)
        lower = np.int64(model.lowers[outcome, action, m])
        best = greatest_between(q, start, n, lower, layers, model.steps, weights, len(weights))
        total += model.discounts[action] * model.probabilities[outcome] * best
    return total


@kernel(parallel=True)
def improve_q(model, layers, q, out, residuals):
    """Do one sweep of the paper's backup over every action of every state and every cell."""
    moving = model.lowers.shape[2]
    for s in prange(len(model.offsets) - 1):
        weights = np.empty(model.steps.shape[1], q.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        residual = 0.0
        for k in range(n):
            for m in range(moving):
                for h in range(layers):
                    entry = first * moving * layers + (m * layers + h) * n + k
                    out[entry] = back_up_q(model, layers, q, first + k, m, h, weights)
                    residual = max(residual, abs(out[entry] - q[entry]))
        residuals[s] = residual


@kernel(parallel=True)
def improve_best_q(model, layers, q, entries, values):
    """Back up only the action that is best so far in every state and cell; write which entries change, and to what."""
    cells = model.lowers.shape[2] * layers
    for s in prange(len(model.offsets) - 1):
        weights = np.empty(model.steps.shape[1], q.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for c in range(cells):
            entry = first * cells + c * n
            best = 0
            for k in range(1, n):
                best = k if q[entry + k] > q[entry + best] else best
            entries[s * cells + c] = entry + best
            values[s * cells + c] = back_up_q(model, layers, q, first + best, c // layers, c % layers, weights)


@kernel
def hash_uniform(seed, index):
    """Return a number in 0..1 that depends on two whole numbers alone (splitmix64's finisher)."""
    mixed = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15)
    mixed += np.uint64(index) * np.uint64(0x8CB92BA72F3D8DD7) + np.uint64(0x2545F4914F6CDD1D)
    for _ in range(2):
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed = mixed ^ (mixed >> np.uint64(31))
    return float(mixed >> np.uint64(11)) / 9007199254740992.0


@kernel
def observe(model, layers, q, action, m, h, draw, weights):
    """Do one trial of an action with the target in cell (m, h); return r + gamma^T max over a' of Q(a', e)."""
    cells = model.lowers.shape[2] * layers
    outcome = 0
    while outcome < len(model.probabilities) - 1 and draw >= model.probabilities[outcome]:
        draw -= model.probabilities[outcome]
        outcome += 1
    earned = earned_in(model, outcome, action, m, m * layers + h)
    corner_weights(model.shares, outcome, action, m, weights)
    after = model.next[action]
    n = model.offsets[after + 1] - model.offsets[after]
    start = model.offsets[after] * cells + h * n
    lower = np.int64(model.lowers[outcome, action, m])
    best = greatest_between(q, start, n, lower, layers, model.steps, weights, len(weights))
    return earned + model.discounts[action] * best


@kernel(parallel=True)
def try_everything(model, layers, q, out, visits, step_sizes, seed, changes):
    """Do one round of exploration: every action of every state is tried once in every cell.

    Q := Q + alpha (observed - Q), where what is observed reads the table of the round before, and alpha is
    ``step_sizes`` at the number of visits that the entry has had.
    """
    moving = model.lowers.shape[2]
    for s in prange(len(model.offsets) - 1):
        weights = np.empty(model.steps.shape[1], q.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        change = 0.0
        for k in range(n):
            for m in range(moving):
                for h in range(layers):
                    entry = first * moving * layers + (m * layers + h) * n + k
                    draw = hash_uniform(seed, entry) + visits[entry] * GOLDEN
                    error = observe(model, layers, q, first + k, m, h, draw % 1.0, weights) - q[entry]
                    out[entry] = q[entry] + step_sizes[min(visits[entry], len(step_sizes) - 1)] * error
                    visits[entry] += 1
                    change += abs(error)
        changes[s] = change


@kernel(parallel=True)
def try_best(model, layers, q, entries, values, visits, step_sizes, seed, tries):
    """Do one round of exploitation: in every state and cell the action that is best so far is tried a few times.

    Writes which entries change, and to what, so that all trials read the table of the round before. The entry moves by
    the mean of its trials: one that is tried until it is no longer the best would else end too low.
    """
    cells = model.lowers.shape[2] * layers
    for s in prange(len(model.offsets) - 1):
        weights = np.empty(model.steps.shape[1], q.dtype)
        first = model.offsets[s]
        n = model.offsets[s + 1] - first
        for c in range(cells):
            entry = first * cells + c * n
            best = 0
            for k in range(1, n):
                best = k if q[entry + k] > q[entry + best] else best
            entry += best
            observed = np.float32(0.0)
            for trial in range(tries):
                draw = (hash_uniform(seed, entry) + (visits[entry] + trial) * GOLDEN) % 1.0
                observed += observe(model, layers, q, first + best, c // layers, c % layers, draw, weights)
            error = observed / np.float32(tries) - q[entry]
            entries[s * cells + c] = entry
            values[s * cells + c] = q[entry] + step_sizes[min(visits[entry], len(step_sizes) - 1)] * error
            visits[entry] += tries


@kernel(parallel=True)
def put(q, entries, values):
    """Write values to entries, no two of which are the same."""
    for place in prange(len(entries)):
        q[entries[place]] = values[place]

"""Compiled look-ups, rewards and successors; ``environment.py``, ``rewards.py``, ``policy.py`` say what they mean.

``tables`` is a ``LookupTables`` and ``actions`` an ``Actions``; both are named tuples of flat arrays.
"""

import math

from numba import njit, prange


@njit(cache=True)
def measure(kind, x, y, z):
    """Return what an axis of this kind measures of a target (``environment.measure``)."""
    if kind == 0:
        return math.sqrt(x * x + z * z)
    if kind == 1:
        return math.atan2(x, z)
    return y


@njit(cache=True)
def place_on_axis(axes, row, x, y, z):
    """Return the grid point below a target on one axis, the one above, the share of the latter, and the fade."""
    minimum, step, count = axes[row, 1], axes[row, 2], int(axes[row, 3])
    value = measure(int(axes[row, 0]), x, y, z)
    place = (value - minimum) / step
    if axes[row, 4] != 0.0:
        place -= count * math.floor(place / count)
        lower = min(int(place), count - 1)
        upper = lower + 1 if lower + 1 < count else 0
        return lower, upper, place - lower, 1.0
    fade = 1.0
    if axes[row, 6] > 0.0:
        beyond = max(-place, place - (count - 1.0), 0.0) * step
        fade = max(0.0, 1.0 - beyond / axes[row, 6])
    place = min(max(place, 0.0), count - 1.0)
    lower = max(min(int(place), count - 2), 0)
    upper = min(lower + 1, count - 1)
    return lower, upper, place - lower, fade


@njit(cache=True)
def find_corners(axes, first, end, x, y, z, cells, weights):
    """Write the cells around a target and their weights; return how many there are, and the fade."""
    count = 1
    cells[0] = 0
    weights[0] = 1.0
    fade = 1.0
    for row in range(first, end):
        lower, upper, share, axis_fade = place_on_axis(axes, row, x, y, z)
        stride = int(axes[row, 5])
        fade *= axis_fade
        for corner in range(count):
            cells[count + corner] = cells[corner] + upper * stride
            weights[count + corner] = weights[corner] * share
            cells[corner] += lower * stride
            weights[corner] *= 1.0 - share
        count *= 2
    return count, fade


@njit(cache=True)
def strike_lands(px, py, pz, x, y, z, terms, row):
    """Return whether a fist at (px, py, pz) is near enough to the surface of a target whose head is at (x, y, z)."""
    tolerance = terms[row, 2]
    dx, dy, dz = px - x, py - y, pz - z
    if abs(math.sqrt(dx * dx + dy * dy + dz * dz) - terms[row, 4]) <= tolerance:
        return True
    dy = py - min(max(py, y - terms[row, 7]), y - terms[row, 6])
    return abs(math.sqrt(dx * dx + dy * dy + dz * dz) - terms[row, 5]) <= tolerance


@njit(cache=True)
def strike_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount):
    """Return the strike term of one action for a target that moves by (vx, vz) a frame."""
    best = 0.0
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        t = actions.strike_times[strike]
        px, py, pz = actions.strike_places[strike]
        if strike_lands(px, py, pz, x + t * vx, y, z + t * vz, terms, row):
            speed = actions.strike_speeds[strike]
            best = max(best, math.exp(t * log_discount) * speed ** terms[row, 3])
    return terms[row, 1] * best


@njit(cache=True)
def proximity_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount):
    """Return the proximity term of one action for a target that moves by (vx, vz) a frame."""
    total = 0.0
    best = 0.0
    factor = 1.0
    discount = math.exp(log_discount)
    start = actions.path_offsets[action]
    for t in range(1, actions.lengths[action] + 1):
        factor *= discount
        dx = x + t * vx - actions.paths[start + t - 1, 0]
        dz = z + t * vz - actions.paths[start + t - 1, 1]
        if terms[row, 5] != 0.0:
            heading = actions.paths[start + t - 1, 2]
            ahead = dx * math.sin(heading) + dz * math.cos(heading) - terms[row, 2]
            aside = dx * math.cos(heading) - dz * math.sin(heading)
            gap = math.sqrt(ahead * ahead + aside * aside)
        else:
            gap = abs(math.sqrt(dx * dx + dz * dz) - terms[row, 2])
        value = factor * math.exp(-gap / terms[row, 3])
        total += value
        best = max(best, value)
    return terms[row, 1] * (best if terms[row, 4] != 0.0 else total)


@njit(cache=True)
def reward(actions, action, x, y, z, vx, vz, terms, first, end, log_discount):
    """Return r(e, a): rows ``first`` to ``end`` of the terms, for a target that moves by (vx, vz) a frame."""
    total = 0.0
    for row in range(first, end):
        code = int(terms[row, 0])
        if code == 0:
            total += strike_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount)
        elif code == 1:
            total += proximity_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount)
        elif code == 2:
            cost = actions.costs[action]
            total -= terms[row, 1] * cost + (terms[row, 2] if cost > 0.0 else 0.0)
    return total


@njit(cache=True)
def after_action(actions, action, x, z):
    """Return where a target at (x, z) is seen once the action has been done."""
    last = actions.path_offsets[action + 1] - 1
    heading = actions.paths[last, 2]
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dz = x - actions.paths[last, 0], z - actions.paths[last, 1]
    return dx * cos - dz * sin, dx * sin + dz * cos


@njit(cache=True)
def behaviour_values(tables, behaviour, state, x, y, z, factor, cells, weights, out):
    """Add ``factor`` times Q(e, a) of one behaviour to ``out`` for every action a of the state."""
    actions = tables.actions
    numbers = tables.behaviours[behaviour]
    axis_first, axis_end = int(numbers[0]), int(numbers[1])
    cell_count, start = int(numbers[5]), int(numbers[6])
    first = actions.offsets[state]
    n = actions.offsets[state + 1] - first
    if numbers[4] == 0.0:
        corners, _ = find_corners(tables.axes, axis_first, axis_end, x, y, z, cells, weights)
        base = start + first * cell_count
        for corner in range(corners):
            if weights[corner] != 0.0:
                entry = base + cells[corner] * n
                share = weights[corner] * factor
                for k in range(n):
                    out[k] += share * tables.table[entry + k]
        return
    log_discount = math.log(numbers[8])
    for k in range(n):
        a = first + k
        value = reward(actions, a, x, y, z, 0.0, 0.0, tables.terms, int(numbers[2]), int(numbers[3]), log_discount)
        later_x, later_z = after_action(actions, a, x, z)
        corners, _ = find_corners(tables.axes, axis_first, axis_end, later_x, y, later_z, cells, weights)
        entry = start + actions.next[a] * cell_count
        later = 0.0
        for corner in range(corners):
            later += weights[corner] * tables.table[entry + cells[corner]]
        out[k] += factor * (value + math.exp(log_discount * actions.lengths[a]) * later)


@njit(cache=True)
def fade_of(tables, behaviour, x, y, z):
    """Return how much a behaviour counts for a target (``environment.fade_factor``)."""
    fade = 1.0
    for row in range(int(tables.behaviours[behaviour, 0]), int(tables.behaviours[behaviour, 1])):
        fade *= place_on_axis(tables.axes, row, x, y, z)[3]
    return fade


@njit(cache=True)
def evaluate_actions(tables, behaviour_weights, state, x, y, z, cells, corner_weights, out):
    """Write what each action of a state is worth (``policy.action_values``); return how many there are.

    Args:
        tables: ``LookupTables``.
        behaviour_weights: Weight of each behaviour. Shape (B,).
        state: The avatar's state.
        x: Target's place in the avatar's ground frame, to the left [m].
        y: Upwards.
        z: Ahead.
        cells: Scratch, int64, shape (2^D,) for the largest number of axes D.
        corner_weights: Scratch, float64, the same shape.
        out: Where the values go, float64, at least as long as the state has actions.
    """
    n = tables.actions.offsets[state + 1] - tables.actions.offsets[state]
    for k in range(n):
        out[k] = 0.0
    for behaviour in range(len(behaviour_weights)):
        if behaviour_weights[behaviour] != 0.0:
            fade = fade_of(tables, behaviour, x, y, z)
            factor = behaviour_weights[behaviour] * fade / tables.behaviours[behaviour, 7]
            if factor != 0.0:
                behaviour_values(tables, behaviour, state, x, y, z, factor, cells, corner_weights, out)
    return n


@njit(cache=True, parallel=True)
def fill_successors(actions, axes, targets, velocities, lowers, shares):
    """Write where each moving cell of a grid is seen after each action: the lower corner, and the share of the upper.

    Args:
        actions: ``Actions``.
        axes: The grid's moving axes, with strides in moving cells. Shape (D, 7).
        targets: The target of each moving cell. Shape (M, 3).
        velocities: How the target may move [m a frame]. Shape (O, 2).
        lowers: Written: lower corner. Shape (O, A, M).
        shares: Written: share of the next grid point on each axis. Shape (O, A, M, D).
    """
    for a in prange(lowers.shape[1]):
        length = actions.lengths[a]
        for outcome in range(lowers.shape[0]):
            vx, vz = velocities[outcome, 0] * length, velocities[outcome, 1] * length
            for m in range(lowers.shape[2]):
                x, z = after_action(actions, a, targets[m, 0] + vx, targets[m, 2] + vz)
                cell = 0
                for row in range(len(axes)):
                    lower, _, share, _ = place_on_axis(axes, row, x, 0.0, z)
                    cell += lower * int(axes[row, 5])
                    shares[outcome, a, m, row] = share
                lowers[outcome, a, m] = cell


@njit(cache=True, parallel=True)
def fill_rewards(actions, chosen, targets, velocities, terms, log_discount, out):
    """Write r(e, a) for the ``chosen`` actions, every cell and every way the target may move. Shape (O, R, C)."""
    for place in prange(len(chosen)):
        for outcome in range(out.shape[0]):
            vx, vz = velocities[outcome]
            for c in range(len(targets)):
                x, y, z = targets[c]
                out[outcome, place, c] = reward(
                    actions, chosen[place], x, y, z, vx, vz, terms, 0, len(terms), log_discount
                )

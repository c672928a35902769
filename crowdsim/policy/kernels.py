"""Compiled look-ups, rewards and successors; ``environment.py``, ``rewards.py``, ``policy.py`` say what they mean.

``tables`` is a ``LookupTables`` and ``actions`` an ``Actions``; both are named tuples of flat arrays.
"""

import math

import numpy as np
from numba import prange

from crowdsim.jit import kernel


@kernel
def measure(kind, x, y, z):
    """Return what an axis of this kind measures of a target (``environment.measure``).

    ``environment.COMPILED`` lists the axes that have a branch here.
    """
    if kind == 0:
        return math.sqrt(x * x + z * z)
    if kind == 1:
        return math.atan2(x, z)
    return y


@kernel
def place_on_axis(axes, row, x, y, z):
    """Return the grid point below a target on one axis, the one above, the share of the latter, and the fade."""
    first, step, count = axes[row, 1], axes[row, 2], int(axes[row, 3])
    value = measure(int(axes[row, 0]), x, y, z)
    place = (value / (1.0 + axes[row, 8] * value) - first) / step
    if axes[row, 4] != 0.0:
        place -= count * math.floor(place / count)
        lower = min(int(place), count - 1)
        upper = lower + 1 if lower + 1 < count else 0
        return lower, upper, place - lower, 1.0
    fade = 1.0
    if axes[row, 6] > 0.0:
        last = first + (count - 1.0) * step
        beyond = max(axes[row, 7] - value, value - last / (1.0 - axes[row, 8] * last), 0.0)
        fade = max(0.0, 1.0 - beyond / axes[row, 6])
    place = min(max(place, 0.0), count - 1.0)
    lower = max(min(int(place), count - 2), 0)
    upper = min(lower + 1, count - 1)
    return lower, upper, place - lower, fade


@kernel
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


@kernel
def strike_lands(px, py, pz, x, y, z, terms, row):
    """Return whether a fist at (px, py, pz) lands on a target whose head is at (x, y, z) (``rewards.lands``)."""
    tolerance = terms[row, 2]
    dx, dz = px - x, pz - z
    aside = dx * dx + dz * dz
    reach = max(terms[row, 4], terms[row, 5]) + tolerance
    if aside > 1.0001 * reach * reach:
        return False  # most targets are: nothing else need be worked out
    dy = py - y
    distance = math.sqrt(aside + dy * dy) - terms[row, 4]
    dy = py - min(max(py, y - terms[row, 7]), y - terms[row, 6])
    distance = min(distance, math.sqrt(aside + dy * dy) - terms[row, 5])
    return -tolerance <= distance <= tolerance


@kernel
def spent_on_strike(px, pz, x, z, terms, row):
    """Return what a strike costs whose fist ends over (px, pz) when the target is over (x, z)."""
    far = (px - x) ** 2 + (pz - z) ** 2 > terms[row, 12] * terms[row, 12]
    return terms[row, 9] + (terms[row, 10] if far else 0.0)


@kernel
def strike_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount):
    """Return the strike term of one action for a target that moves by (vx, vz) a frame."""
    best, total, spent = 0.0, 0.0, 0.0
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        t = actions.strike_times[strike]
        places = actions.strike_places
        px, py, pz = places[strike, 0], places[strike, 1], places[strike, 2]
        faded = math.exp(t * log_discount)
        spent += faded * spent_on_strike(px, pz, x + t * vx, z + t * vz, terms, row)
        if strike_lands(px, py, pz, x + t * vx, y, z + t * vz, terms, row):
            earned = faded * actions.strike_speeds[strike] ** terms[row, 3]
            best = max(best, earned)
            total += earned
    return terms[row, 1] * ((best if terms[row, 11] != 0.0 else total) - spent)


@kernel
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
        aside = 0.0
        if terms[row, 5] != 0.0:
            heading = actions.paths[start + t - 1, 2]
            ahead = dx * math.sin(heading) + dz * math.cos(heading)
            aside = max(abs(dx * math.cos(heading) - dz * math.sin(heading)) - terms[row, 7], 0.0)
        else:
            ahead = math.sqrt(dx * dx + dz * dz)
        ahead -= min(max(ahead, terms[row, 2]), terms[row, 6])
        gap = math.sqrt(ahead * ahead + aside * aside)
        value = factor * math.exp(-gap / terms[row, 3])
        total += value
        best = max(best, value)
    return terms[row, 1] * (best if terms[row, 4] != 0.0 else total)


@kernel
def term_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount):
    """Return what one term says of an action, for a target that moves by (vx, vz) a frame.

    ``rewards.COMPILED`` lists the terms that have a branch here.
    """
    code = int(terms[row, 0])
    if code == 0:
        return strike_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount)
    if code == 1:
        return proximity_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount)
    if code == 2:
        cost = actions.costs[action]
        return -(terms[row, 1] * cost + (terms[row, 2] if cost > 0.0 else 0.0))
    return math.nan


@kernel
def reward(actions, action, x, y, z, vx, vz, terms, first, end, log_discount):
    """Return r(e, a): rows ``first`` to ``end`` of the terms, for a target that moves by (vx, vz) a frame."""
    total = 0.0
    for row in range(first, end):
        total += term_reward(actions, action, x, y, z, vx, vz, terms, row, log_discount)
    return total


@kernel
def after_action(actions, action, x, z):
    """Return where a target at (x, z) is seen once the action has been done."""
    last = actions.path_offsets[action + 1] - 1
    heading = actions.paths[last, 2]
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dz = x - actions.paths[last, 0], z - actions.paths[last, 1]
    return dx * cos - dz * sin, dx * sin + dz * cos


@kernel
def behaviour_values(tables, behaviour, state, x, y, z, vx, vz, factor, cells, weights, out):
    """Add ``factor`` times Q(e, a) of one behaviour to ``out`` for every action a of the state."""
    actions = tables.actions
    numbers = tables.behaviours[behaviour]
    axis_first, axis_end = int(numbers[0]), int(numbers[1])
    cell_count, start = int(numbers[5]), int(numbers[6])
    first = actions.offsets[state]
    n = actions.offsets[state + 1] - first
    if numbers[4] == 0.0:
        soon_x, soon_z = x + tables.leads[0] * vx, z + tables.leads[0] * vz
        corners, _ = find_corners(tables.axes, axis_first, axis_end, soon_x, y, soon_z, cells, weights)
        base = start + first * cell_count
        for k in range(n):
            out[k] += factor * numbers[9]
        for corner in range(corners):
            if weights[corner] != 0.0:
                entry = base + cells[corner] * n
                share = weights[corner] * factor * numbers[10]
                for k in range(n):
                    out[k] += share * tables.table[entry + k]
        return
    log_discount = math.log(numbers[8])
    for k in range(n):
        a = first + k
        value = reward(actions, a, x, y, z, vx, vz, tables.terms, int(numbers[2]), int(numbers[3]), log_discount)
        t = actions.lengths[a] + tables.leads[1]
        later_x, later_z = after_action(actions, a, x + t * vx, z + t * vz)
        corners, _ = find_corners(tables.axes, axis_first, axis_end, later_x, y, later_z, cells, weights)
        entry = start + actions.next[a] * cell_count
        later = 0.0
        for corner in range(corners):
            later += weights[corner] * tables.table[entry + cells[corner]]
        later = numbers[9] + numbers[10] * later
        out[k] += factor * (value + math.exp(log_discount * actions.lengths[a]) * later)


@kernel
def fade_of(tables, behaviour, x, y, z):
    """Return how much a behaviour counts for a target (``environment.fade_factor``)."""
    fade = 1.0
    for row in range(int(tables.behaviours[behaviour, 0]), int(tables.behaviours[behaviour, 1])):
        fade *= place_on_axis(tables.axes, row, x, y, z)[3]
    return fade


@kernel
def count_price_once(tables, behaviour_weights, state, x, y, z, out):
    """Let a transition cost what it costs the behaviour that it costs most, where each has counted its own price."""
    first = tables.actions.offsets[state]
    for k in range(tables.actions.offsets[state + 1] - first):
        cost = tables.actions.costs[first + k]
        if cost <= 0.0:
            continue
        total, most = 0.0, 0.0
        for behaviour in range(len(behaviour_weights)):
            scale = tables.behaviours[behaviour, 7]
            if behaviour_weights[behaviour] == 0.0 or scale == 0.0:
                continue
            price = 0.0
            for row in range(int(tables.behaviours[behaviour, 2]), int(tables.behaviours[behaviour, 3])):
                if tables.terms[row, 0] == 2.0:
                    price += tables.terms[row, 1] * cost + tables.terms[row, 2]
            price *= behaviour_weights[behaviour] * fade_of(tables, behaviour, x, y, z) / scale
            total += price
            most = max(most, price)
        out[k] += total - most


@kernel
def evaluate_actions(tables, behaviour_weights, state, x, y, z, vx, vz, cells, corner_weights, out):
    """Write what each action of a state is worth (``policy.action_values``); return how many there are.

    Args:
        tables: ``LookupTables``.
        behaviour_weights: Weight of each behaviour. Shape (B,).
        state: The avatar's state.
        x: Target's place in the avatar's ground frame, to the left [m].
        y: Upwards.
        z: Ahead.
        vx: How far it moves in a control frame, to the left [m].
        vz: Ahead.
        cells: Scratch, int64, shape (2^D,) for the largest number of axes D.
        corner_weights: Scratch, float64, the same shape.
        out: Where the values go, float64, at least as long as the state has actions.
    """
    n = tables.actions.offsets[state + 1] - tables.actions.offsets[state]
    active = 0
    for k in range(n):
        out[k] = 0.0
    for behaviour in range(len(behaviour_weights)):
        if behaviour_weights[behaviour] != 0.0:
            fade = fade_of(tables, behaviour, x, y, z)
            scale = tables.behaviours[behaviour, 7]
            factor = behaviour_weights[behaviour] * fade / scale if scale > 0.0 else 0.0
            if factor != 0.0:
                behaviour_values(tables, behaviour, state, x, y, z, vx, vz, factor, cells, corner_weights, out)
                active += 1
    if active > 1:
        count_price_once(tables, behaviour_weights, state, x, y, z, out)
    return n


@kernel
def action_spreads(tables, targets, out):
    """Write by how much the best action of each state is better than the median one, by the first behaviour.

    NaN where there is one action, or the behaviour counts for nothing. ``out``: shape (S, N) for N targets (N, 5).
    """
    cells, weights = np.empty(64, np.int64), np.empty(64)
    one = np.ones(1)
    most = 0
    for s in range(out.shape[0]):
        most = max(most, tables.actions.offsets[s + 1] - tables.actions.offsets[s])
    values = np.empty(most)
    for s in range(out.shape[0]):
        for m in range(len(targets)):
            x, y, z, vx, vz = targets[m]
            if fade_of(tables, 0, x, y, z) > 0.0:
                n = evaluate_actions(tables, one, s, x, y, z, vx, vz, cells, weights, values)
                if n > 1:
                    out[s, m] = values[:n].max() - np.median(values[:n])


@kernel
def judge_ways(tables, moods, targets, cuts, most, first_state, last_state, keep, gains):
    """Mark the actions of each state that are worth keeping, and write what each adds (``pruning.judge_ways``).

    Args:
        tables: ``LookupTables``.
        moods: Weights of the behaviours. Shape (M, B).
        targets: Where the target is and how far it moves in a control frame along x and z. Shape (N, 5).
        cuts: Whether each action begins with a cut; those that do not are always kept. Shape (A,).
        most: How many others are kept at most.
        first_state: First of the states.
        last_state: One after the last.
        keep: Written: 1 where an action is kept. Shape (A,), uint8.
        gains: Written: by how much each of them, when it was taken, raised the best value on the average. Shape (A,).
    """
    offsets = tables.actions.offsets
    count = len(moods) * len(targets)
    for s in range(first_state, last_state):
        first = offsets[s]
        n = offsets[s + 1] - first
        cells, weights = np.empty(64, np.int64), np.empty(64)
        values, best, row = np.empty((n, count)), np.full(count, -1e30), np.empty(n)
        for m in range(count):
            x, y, z, vx, vz = targets[m % len(targets)]
            evaluate_actions(tables, moods[m // len(targets)], s, x, y, z, vx, vz, cells, weights, row)
            for k in range(n):
                values[k, m] = row[k]
        held = 0
        for k in range(n):
            if not cuts[first + k]:
                keep[first + k] = 1
                for m in range(count):
                    best[m] = max(best[m], values[k, m])
        while held < most:
            chosen, most_gained = -1, 0.0
            for k in range(n):
                if keep[first + k] == 0:
                    gained = 0.0
                    for m in range(count):
                        gained += max(values[k, m] - best[m], 0.0)
                    if gained > most_gained:
                        chosen, most_gained = k, gained
            if chosen < 0:
                break
            # Where no captured frame follows, the first way out adds all there is: as much as a state's whole spread.
            gains[first + chosen] = min(most_gained / count, 1.0)
            keep[first + chosen] = 1
            for m in range(count):
                best[m] = max(best[m], values[chosen, m])
            held += 1


@kernel(parallel=True)
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
        last = actions.path_offsets[a + 1] - 1
        cos, sin = math.cos(actions.paths[last, 2]), math.sin(actions.paths[last, 2])
        for outcome in range(lowers.shape[0]):
            left = velocities[outcome, 0] * length - actions.paths[last, 0]
            ahead = velocities[outcome, 1] * length - actions.paths[last, 1]
            for m in range(lowers.shape[2]):
                dx, dz = targets[m, 0] + left, targets[m, 2] + ahead
                x, z = dx * cos - dz * sin, dx * sin + dz * cos
                cell = 0
                for row in range(len(axes)):
                    lower, _, share, _ = place_on_axis(axes, row, x, 0.0, z)
                    cell += lower * int(axes[row, 5])
                    shares[outcome, a, m, row] = share
                lowers[outcome, a, m] = cell


@kernel
def exponential(value):
    """Return the exponential of a number up to 0, to 1e-9 of it; what lies below -32 counts as -32.

    exp(v) = exp(v / 1024) ^ 1024: the polynomial that is best for so small a number, and ten squarings, which
    vectorise, as library functions do not.
    """
    y = max(value, -32.0) * (1.0 / 1024.0)
    v = 0.9999999999995212 + y * (
        0.9999999992338505 + y * (0.49999980375826153 + y * (0.16664906210443037 + y * 0.04102110216102971))
    )
    for _ in range(10):
        v *= v
    return v


@kernel
def add_proximity(path, xs, zs, vx, vz, terms, row, log_discount, best, total):
    """Add what ``proximity_reward`` says of one action's path to the total of many targets over (xs, zs)."""
    weight, least, shrink = terms[row, 1], terms[row, 2], -1.0 / terms[row, 3]
    greatest, facing, most, wide = terms[row, 4] != 0.0, terms[row, 5] != 0.0, terms[row, 6], terms[row, 7]
    best[:] = 0.0
    for t in range(1, len(path) + 1):
        factor = weight * math.exp(t * log_discount)
        sin, cos = math.sin(path[t - 1, 2]), math.cos(path[t - 1, 2])
        left, ahead_of = path[t - 1, 0] - t * vx, path[t - 1, 1] - t * vz
        for m in range(len(xs)):
            dx, dz = xs[m] - left, zs[m] - ahead_of
            aside = max(abs(dx * cos - dz * sin) - wide, 0.0) if facing else 0.0
            ahead = dx * sin + dz * cos if facing else math.sqrt(dx * dx + dz * dz)
            ahead -= min(max(ahead, least), most)
            value = factor * exponential(math.sqrt(ahead * ahead + aside * aside) * shrink)
            best[m] = max(best[m], value) if greatest else best[m] + value
    for m in range(len(xs)):
        total[m] += best[m]


@kernel(parallel=True)
def fill_near(actions, xs, zs, velocities, terms, log_discount, out):
    """Write what each action earns for targets over (xs, zs) but for strikes that land. Shape (O, A, M), or (O, A, 1).

    Where it is the same everywhere there is room for the first target alone.
    """
    count = out.shape[2]
    for action in prange(out.shape[1]):
        path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]]
        best, total = np.empty(count), np.empty(count)
        for outcome in range(out.shape[0]):
            vx, vz = velocities[outcome, 0], velocities[outcome, 1]
            total[:] = 0.0
            for row in range(len(terms)):
                if terms[row, 0] == 1.0:
                    add_proximity(path, xs[:count], zs[:count], vx, vz, terms, row, log_discount, best, total)
                elif terms[row, 0] == 0.0:
                    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
                        t = actions.strike_times[strike]
                        px, pz = actions.strike_places[strike, 0], actions.strike_places[strike, 2]
                        factor = terms[row, 1] * math.exp(t * log_discount)
                        for m in range(count):
                            total[m] -= factor * spent_on_strike(px, pz, xs[m] + t * vx, zs[m] + t * vz, terms, row)
                else:
                    for m in range(count):
                        x, z = xs[m], zs[m]
                        total[m] += term_reward(actions, action, x, 0.0, z, vx, vz, terms, row, log_discount)
            out[outcome, action] = total


@kernel(parallel=True)
def fill_landed(actions, targets, layers, velocities, terms, log_discount, offsets, cells, rewards):
    """Write the cells in which strikes of each action land and what the best one earns there (``model.Model``).

    Without room in ``cells`` it only counts: ``offsets[o * A + a + 1]`` gets the number of them.
    """
    count = len(actions.next)
    for action in prange(count):
        first, last = actions.strike_offsets[action], actions.strike_offsets[action + 1]
        if first == last:
            continue
        found = np.empty(layers)
        for outcome in range(len(velocities)):
            vx, vz = velocities[outcome, 0], velocities[outcome, 1]
            held, at = 0, offsets[outcome * count + action]
            for m in range(len(targets) // layers):
                found[:] = 0.0
                for row in range(len(terms)):
                    if terms[row, 0] != 0.0:
                        continue
                    for h in range(layers):
                        best, total = 0.0, 0.0
                        x, y, z = targets[m * layers + h]
                        for strike in range(first, last):
                            t = actions.strike_times[strike]
                            px, py, pz = actions.strike_places[strike]
                            if strike_lands(px, py, pz, x + t * vx, y, z + t * vz, terms, row):
                                fast = actions.strike_speeds[strike] ** terms[row, 3]
                                earned = math.exp(t * log_discount) * fast
                                best = max(best, earned)
                                total += earned
                        found[h] += terms[row, 1] * (best if terms[row, 11] != 0.0 else total)
                for h in range(layers):
                    if found[h] > 0.0:
                        if len(cells) > 0:
                            cells[at + held], rewards[at + held] = m * layers + h, found[h]
                        held += 1
            if len(cells) == 0:
                offsets[outcome * count + action + 1] = held


@kernel
def table_value(tables, behaviour, state, x, y, z, cells, weights):
    """Return V(s, e) by a behaviour's table of the look-up v."""
    numbers = tables.behaviours[behaviour]
    corners, _ = find_corners(tables.axes, int(numbers[0]), int(numbers[1]), x, y, z, cells, weights)
    entry = int(numbers[6]) + state * int(numbers[5])
    value = 0.0
    for corner in range(corners):
        value += weights[corner] * tables.table[entry + cells[corner]]
    return numbers[9] + numbers[10] * value


@kernel
def best_by_search(tables, behaviour, state, x, y, z, width, depth, scratch):
    """Return the best action of a state by beam search: exact rewards, and V behind the leaves.

    Of all actions of all nodes the ``width`` with the highest reward so far and V behind it go on, ``depth`` times.

    Args:
        tables: ``LookupTables``; the behaviour's look-up is v.
        behaviour: Its row.
        state: The avatar's state.
        x: Target's place in the avatar's ground frame [m].
        y: Likewise.
        z: Likewise.
        width: Nodes that go on.
        depth: Actions on the way to a leaf.
        scratch: Nodes: first action, state, x, z, discount and reward so far, worth. Shape (2, enough, 7), float64.
    """
    actions = tables.actions
    numbers = tables.behaviours[behaviour]
    log_discount = math.log(numbers[8])
    cells, weights = np.empty(64, np.int64), np.empty(64)
    now, later = scratch[0], scratch[1]
    now[0, 0], now[0, 1], now[0, 2], now[0, 3], now[0, 4], now[0, 5] = -1.0, state, x, z, 1.0, 0.0
    count = 1
    for _ in range(depth):
        found = 0
        for node in range(count):
            s = int(now[node, 1])
            for a in range(actions.offsets[s], actions.offsets[s + 1]):
                nx, nz = now[node, 2], now[node, 3]
                earned = reward(
                    actions, a, nx, y, nz, 0.0, 0.0, tables.terms, int(numbers[2]), int(numbers[3]), log_discount
                )
                px, pz = after_action(actions, a, nx, nz)
                factor = now[node, 4] * math.exp(log_discount * actions.lengths[a])
                total = now[node, 5] + now[node, 4] * earned
                behind = table_value(tables, behaviour, actions.next[a], px, y, pz, cells, weights)
                later[found, 0] = a if now[node, 0] < 0.0 else now[node, 0]
                later[found, 1], later[found, 2], later[found, 3] = actions.next[a], px, pz
                later[found, 4], later[found, 5], later[found, 6] = factor, total, total + factor * behind
                found += 1
        order = np.argsort(-later[:found, 6])
        count = min(width, found)
        for node in range(count):
            now[node] = later[order[node]]
    return int(now[0, 0])


@kernel
def lot(seed, index):
    """Return a number in 0..1 that depends on two whole numbers alone (splitmix64's finisher)."""
    mixed = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(index) * np.uint64(0x8CB92BA72F3D8DD7)
    for _ in range(2):
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed = mixed ^ (mixed >> np.uint64(31))
    return float(mixed >> np.uint64(11)) / 9007199254740992.0


@kernel
def run_episodes(
    tables, weights, judge, choice, states, targets, velocity, horizon, width, depth, within, seed, numbers, out, used
):
    """Let one avatar after another do its best to a target; write what came of it.

    Args:
        tables: ``LookupTables`` of the behaviours that choose.
        weights: Their weights. Shape (B,).
        judge: ``LookupTables`` over the same actions; its first behaviour says what is rewarded, and is the one whose
            values stand behind the leaves of a search.
        choice: 0 by the tables, 1 at random, 2 by beam search.
        states: State in which each starts. Shape (N,).
        targets: Target in the avatar's ground frame at the start [m]. Shape (N, 3).
        velocity: Speed of the target [m a frame], in a direction drawn for every action; 0 is still.
        horizon: Control frames that count.
        width: Of the beam.
        depth: Of the beam.
        within: Distance over the ground at which an avatar has arrived [m].
        seed: Of the draws.
        numbers: Number of each episode, on which its draws depend. Shape (N,).
        out: Written: discounted return; least distance over the ground within the horizon [m]; frame of the first
            strike that lands, or -1; strikes landed; cuts; frames; decisions; frame of first being ``within``, or
            -1; return without the price of transitions. Shape (N, 9).
        used: Written: 1 for every action that was done. Shape (A,).
    """
    actions, terms = judge.actions, judge.terms
    facts = judge.behaviours[0]
    first_term, end_term = int(facts[2]), int(facts[3])
    log_discount = math.log(facts[8])
    most = 0
    for s in range(len(actions.offsets) - 1):
        most = max(most, actions.offsets[s + 1] - actions.offsets[s])
    for i in range(len(states)):
        cells, corner_weights, values = np.empty(64, np.int64), np.empty(64), np.empty(most)
        scratch = np.empty((2, max(1, width) * most if choice == 2 else 1, 7))
        state = states[i]
        x, y, z = targets[i, 0], targets[i, 1], targets[i, 2]
        out[i] = 0.0
        out[i, 1], out[i, 2], out[i, 7] = math.sqrt(x * x + z * z), -1.0, -1.0
        frame = 0
        while frame < horizon:
            first = actions.offsets[state]
            n = actions.offsets[state + 1] - first
            decision = int(out[i, 6])
            if choice == 0:
                evaluate_actions(tables, weights, state, x, y, z, 0.0, 0.0, cells, corner_weights, values)
                a = first + np.argmax(values[:n])
            elif choice == 1:
                a = first + min(int(lot(seed, numbers[i] * 100003 + 2 * decision) * n), n - 1)
            else:
                a = best_by_search(judge, 0, state, x, y, z, width, depth, scratch)
            used[a] = 1
            angle = 2.0 * math.pi * lot(seed, numbers[i] * 100003 + 2 * decision + 1)
            vx, vz = velocity * math.sin(angle), velocity * math.cos(angle)
            earned = reward(actions, a, x, y, z, vx, vz, terms, first_term, end_term, log_discount)
            out[i, 0] += math.exp(frame * log_discount) * earned
            price = 0.0
            for row in range(first_term, end_term):
                if terms[row, 0] == 2.0 and actions.costs[a] > 0.0:
                    price += terms[row, 1] * actions.costs[a] + terms[row, 2]
            out[i, 8] += math.exp(frame * log_discount) * (earned + price)
            for t in range(1, actions.lengths[a] + 1):
                if frame + t <= horizon:
                    row = actions.path_offsets[a] + t - 1
                    dx, dz = x + t * vx - actions.paths[row, 0], z + t * vz - actions.paths[row, 1]
                    distance = math.sqrt(dx * dx + dz * dz)
                    out[i, 1] = min(out[i, 1], distance)
                    if distance <= within and out[i, 7] < 0.0:
                        out[i, 7] = frame + t
            for strike in range(actions.strike_offsets[a], actions.strike_offsets[a + 1]):
                t = actions.strike_times[strike]
                px, py, pz = actions.strike_places[strike]
                for row in range(first_term, end_term):
                    if terms[row, 0] != 0.0 or frame + t > horizon:
                        continue
                    if strike_lands(px, py, pz, x + t * vx, y, z + t * vz, terms, row):
                        out[i, 3] += 1.0
                        if out[i, 2] < 0.0:
                            out[i, 2] = frame + t
                        break
            length = actions.lengths[a]
            x, z = after_action(actions, a, x + length * vx, z + length * vz)
            state = actions.next[a]
            frame += length
            out[i, 4] += 1.0 if tables.actions.costs[a] > 0.0 else 0.0
            out[i, 6] += 1.0
        out[i, 5] = frame


@kernel
def draw_candidate(values, count, margin, most, temperature, number, chances):
    """Return which action is drawn by a number in [0, 1) (``pursuit.draw_candidate``); ``chances`` is scratch."""
    chances[:count] = 0.0
    best, total, last = np.argmax(values[:count]), 0.0, 0
    if temperature <= 0.0 or most <= 1:
        return best
    for _ in range(min(most, count)):
        chosen = -1
        for k in range(count):
            if chances[k] == 0.0 and (chosen < 0 or values[k] > values[chosen]):
                chosen = k
        if values[chosen] < values[best] - margin:
            break
        chances[chosen] = max(math.exp((values[chosen] - values[best]) / temperature), 1e-300)
        total += chances[chosen]
    wanted = number * total
    for k in range(count):
        if chances[k] > 0.0:
            last = k
            wanted -= chances[k]
            if wanted < 0.0:
                break
    return last


@kernel
def pursue(tables, weights, states, bearings, height, lead, velocity, begun, done, rules, out):
    """Let one avatar after another follow a target that flees straight away from it; write how far behind it is.

    Args:
        tables: ``LookupTables``.
        weights: Weight of each behaviour. Shape (B,).
        states: State in which each starts. Shape (N,).
        bearings: Where the target is at the start, and where it flees to [rad]. Shape (N,).
        height: Height of the target [m].
        lead: How far away it is at the start [m].
        velocity: Its speed [m a frame].
        begun: Control frame after which distances count.
        done: Control frame after which all is over.
        rules: Margin, most candidates and temperature of the draw. Shape (3,).
        out: Written: distance over the ground in the mean [m]. Shape (N,).
    """
    actions = tables.actions
    widest = 0
    for s in range(len(actions.offsets) - 1):
        widest = max(widest, actions.offsets[s + 1] - actions.offsets[s])
    cells, corner_weights = np.empty(64, np.int64), np.empty(64)
    values, chances = np.empty(widest), np.empty(widest)
    for i in range(len(states)):
        state, frame, decision = states[i], 0, 0
        vx, vz = velocity * math.sin(bearings[i]), velocity * math.cos(bearings[i])
        x, z = lead * math.sin(bearings[i]), lead * math.cos(bearings[i])
        out[i] = 0.0
        while frame < done:
            n = evaluate_actions(tables, weights, state, x, height, z, vx, vz, cells, corner_weights, values)
            k = draw_candidate(values, n, rules[0], int(rules[1]), rules[2], lot(i, decision), chances)
            a = actions.offsets[state] + k
            for t in range(1, actions.lengths[a] + 1):
                if begun < frame + t <= done:
                    row = actions.path_offsets[a] + t - 1
                    dx, dz = x + t * vx - actions.paths[row, 0], z + t * vz - actions.paths[row, 1]
                    out[i] += math.sqrt(dx * dx + dz * dz) / (done - begun)
            length, heading = actions.lengths[a], actions.paths[actions.path_offsets[a + 1] - 1, 2]
            x, z = after_action(actions, a, x + length * vx, z + length * vz)
            cos, sin = math.cos(heading), math.sin(heading)
            vx, vz = vx * cos - vz * sin, vx * sin + vz * cos
            state, frame, decision = actions.next[a], frame + length, decision + 1

"""What the actions of a state are worth: ``policy.kernels.values`` for many situations at a time."""

import math

import numpy as np

from crowdsim.core.angles import bearings
from crowdsim.core.mathematics import atan2
from crowdsim.crowd.kernels.layout import (
    BEARING,
    BLOCK,
    DISTANCE,
    HEIGHT,
    WORK_BEARING,
    WORK_DISTANCE,
    WORK_SHARES,
    WORK_STATE,
    WORK_X,
    WORK_Z,
)
from crowdsim.crowd.kernels.prefetch import prefetch
from crowdsim.crowd.kernels.rewards import Options, add_terms, count_price_once
from crowdsim.crowd.kernels.tables import Cell, add_rows, fade, interpolate, locate, locate_ends, whole_lanes
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import End, Target
from crowdsim.policy.axes.registry import after, measure


@kernel(inline=True)
def value_actions(model, weights, scratch, first, last):
    """Write into ``scratch.values`` what each action of a state is worth in the situations ``order[first:last]``.

    A situation (``records.SITUATION``) goes with a state, a row of ``weights``, which are those of the behaviours, and
    a policy, all in ``scratch``. ``BLOCK`` of them are evaluated at a time: what they read lies anywhere in memory, and
    one waits for it while others are worked on.
    """
    whose = scratch.policies
    while first < last:
        policy = whose[scratch.order[first]]
        count = 1
        while first + count < last and count < BLOCK and whose[scratch.order[first + count]] == policy:
            count += 1
        _value_block(model, weights, scratch, first, count, policy)
        first += count


@kernel(inline=True)
def _value_block(model, weights, scratch, first, count, policy):
    """Do what ``value_actions`` does for ``count`` situations of one policy, which share a block of scratch space."""
    work = scratch.work
    begun, end = model.policies[policy].behaviours, model.policies[policy + 1].behaviours
    slots = end - begun
    pairs = _prepare(model, weights, scratch, first, count, policy)
    if pairs > 0:
        bearings(work[WORK_X], work[WORK_Z], whole_lanes(pairs), work[WORK_BEARING])
        for b in range(begun, end):
            if model.behaviours[b].looks_ahead:
                scratch.nears[b - begun] = _look_ahead(model, b, b - begun, slots, scratch, count, pairs)
    for d in range(count):
        q = scratch.order[first + d]
        state = scratch.states[q]
        if state < 0:
            continue
        offset = model.offsets[state]
        options = Options(offset, model.offsets[state + 1] - offset, scratch.values[q])
        for b in range(begun, end):
            spot = d * slots + b - begun
            factor = scratch.parts[spot, 3]
            if factor == 0.0:
                continue
            if not model.behaviours[b].looks_ahead:
                if model.behaviours[b].further:
                    _add_row_values_of_layers(model, b, options, spot, _target_of(scratch, q), factor, scratch)
                else:
                    _add_row_values(model, b, options, spot, factor, scratch)
            else:
                if model.behaviours[b].further:
                    _add_end_values_of_layers(
                        model, b, b - begun, options, spot, scratch.begins[d], _target_of(scratch, q), factor, scratch
                    )
                else:
                    _add_end_values(model, b, b - begun, options, spot, scratch.begins[d], factor, scratch)
                add_terms(model, b, options, _target_of(scratch, q), factor, scratch)
        count_price_once(model, scratch.parts[d * slots :], begun, end, options)


@kernel(inline=True)
def _target_of(scratch, q):
    """Return the target of a situation."""
    found = scratch.situations[q]
    return Target(found.x, found.y, found.z, found.vx, found.vz, found.heading, found.impact, found.lasts)


@kernel(inline=True)
def _prepare(model, weights, scratch, first, count, policy):
    """Look at ``count`` situations from ``order[first]`` on, and prefetch what their evaluation will read.

    Returns how many actions are looked ahead along.
    """
    pairs = 0
    scratch.begins[0] = 0
    for d in range(count):
        q = scratch.order[first + d]
        scratch.begins[d + 1] = pairs
        state = scratch.states[q]
        if state < 0:
            continue
        offset = model.offsets[state]
        n = model.offsets[state + 1] - offset
        for k in range(whole_lanes(n)):
            scratch.values[q, k] = 0.0
        distance = _pull_in(scratch, q, model.sizes[policy].farthest)
        if _find_cells(model, weights, scratch, q, d, policy, distance):
            _prefetch_ways(model, offset, n)
            _see_ends(model, offset, n, _target_of(scratch, q), model.sizes[policy].later, pairs, scratch.work)
            pairs += n
            scratch.begins[d + 1] = pairs
    return pairs


@kernel(inline=True)
def _pull_in(scratch, q, farthest):
    """Move a target beyond all grids to where they end, in the same direction; return its distance.

    Beyond the end of all grids all positions have one value, so that nothing would draw the avatar to the target.
    """
    x, z = scratch.situations[q].x, scratch.situations[q].z
    distance = math.sqrt(x * x + z * z)
    if distance > farthest:
        scratch.situations[q].x, scratch.situations[q].z = (
            x * farthest / distance,
            z * farthest / distance,
        )
        distance = farthest
    return distance


@kernel(inline=True)
def _find_cells(model, weights, scratch, q, d, policy, distance):
    """Find what a situation reads of each behaviour's table, and how much the behaviour counts.

    Returns whether a behaviour that counts looks ahead along actions.
    """
    behaviours, grids, target = model.behaviours, model.grids, _target_of(scratch, q)
    begun, end = model.policies[policy].behaviours, model.policies[policy + 1].behaviours
    ahead = False
    for b in range(begun, end):
        spot = d * (end - begun) + b - begun
        factor = weights[scratch.cohorts[q], b - begun]
        if factor != 0.0:
            norm, share = behaviours[b].scale, 1.0
            for kind in range(grids.shape[1]):
                if grids[b, kind].fade > 0.0:
                    share *= fade(grids[b, kind], distance if kind == DISTANCE else measure(kind, target))
            factor = factor * share / norm if norm > 0.0 else 0.0
        scratch.parts[spot, 3] = factor
        if factor == 0.0:
            continue
        if behaviours[b].further:
            cell, scratch.spots[spot, 3], scratch.parts[spot, 2] = 0, 0, 0.0  # see ``_split_layers``
        else:
            cell, scratch.spots[spot, 3], scratch.parts[spot, 2] = locate(grids[b, HEIGHT], target.y)
        if behaviours[b].looks_ahead:
            ahead = True
            scratch.spots[spot, 0] = behaviours[b].table + cell
        else:
            # Tables of targets at rest are read at the position of the target half an action later.
            t = min(behaviours[b].lead_now, target.lasts)
            soon_x, soon_z = target.x + t * target.vx, target.z + t * target.vz
            _find_rows(model, b, scratch.states[q], scratch, spot, cell, soon_x, soon_z)
    return ahead


@kernel(inline=True)
def _find_rows(model, b, state, scratch, spot, cell, x, z):
    """Find the rows of a table of actions for a target at (x, z), and prefetch them."""
    behaviours, offset = model.behaviours, model.offsets[state]
    n = model.offsets[state + 1] - offset
    far = math.sqrt(x * x + z * z)
    near, near_step, scratch.parts[spot, 0] = locate(model.grids[b, DISTANCE], far)
    aside, aside_step, scratch.parts[spot, 1] = locate(model.grids[b, BEARING], atan2(x, z))
    at = behaviours[b].table + offset * behaviours[b].cells + (cell + near + aside) * n
    near_step, aside_step = near_step * n, aside_step * n
    scratch.spots[spot, 0], scratch.spots[spot, 1], scratch.spots[spot, 2] = at, near_step, aside_step
    scratch.spots[spot, 3] *= n
    prefetch(model.table, at)
    prefetch(model.table, at + near_step)
    prefetch(model.table, at + aside_step)
    prefetch(model.table, at + near_step + aside_step)


@kernel(inline=True)
def _prefetch_ways(model, offset, n):
    """Prefetch paths and strikes of ``n`` actions."""
    first_row, last_row = model.actions[offset].paths, model.actions[offset + n].paths
    for row in range(first_row, last_row + 15, 16):
        prefetch(model.paths.x, row)
        prefetch(model.paths.z, row)
    for strike in range(model.actions[offset].strikes, model.actions[offset + n].strikes):
        prefetch(model.strikes, strike)
        prefetch(model.earnings, strike)


@kernel(inline=True)
def _see_ends(model, offset, n, target, lead, first, work):
    """Write a target's position and distance seen from the end of ``n`` actions, and the states in which they end.

    It is seen ``lead`` frames later than the end: values are those of a still target, and an avatar that pursues a
    moving one must be ahead of them.
    """
    moves, actions = model.moves, model.actions
    x, z, vx, vz, lasts = target.x, target.z, target.vx, target.vz, target.lasts
    for k in range(n):
        action, at = np.uint64(offset + k), np.uint64(first + k)
        t = min(np.float64(actions[action].length) + lead, lasts)
        dx, dz = x + t * vx - moves[action].x, z + t * vz - moves[action].z
        cos, sin = moves[action].cos, moves[action].sin
        later_x, later_z = dx * cos - dz * sin, dx * sin + dz * cos
        work[WORK_X, at], work[WORK_Z, at] = later_x, later_z
        work[WORK_DISTANCE, at] = math.sqrt(later_x * later_x + later_z * later_z)
        work[WORK_STATE, at] = actions[action].next


@kernel(inline=True)
def _look_ahead(model, b, slot, slots, scratch, count, pairs):
    """Find the cells of one behaviour's table at the end of each of some actions, and prefetch them.

    Returns the step between distances in the table.
    """
    cells, steps = scratch.cells[2 * slot], scratch.cells[2 * slot + 1]
    for k in range(pairs):
        cells[k] = scratch.work[WORK_STATE, k]
    locate_ends(
        model.grids, b, model.behaviours[b].cells, whole_lanes(pairs), cells, steps, scratch.work,
        scratch.work[WORK_SHARES + 2 * slot], scratch.work[WORK_SHARES + 1 + 2 * slot],
    )  # fmt: skip
    near = int(model.grids[b, DISTANCE].apart) if model.grids[b, DISTANCE].points > 1.0 else 0
    for d in range(count):
        if scratch.parts[d * slots + slot, 3] != 0.0:
            at = scratch.spots[d * slots + slot, 0]
            for k in range(scratch.begins[d], scratch.begins[d + 1]):
                prefetch(model.table, at + int(cells[k]))
                prefetch(model.table, at + int(cells[k]) + near)
    return near


@kernel(inline=True)
def _add_row_values(model, b, options, spot, factor, scratch):
    """Add ``factor`` times what a table of actions holds of each action."""
    spots, parts, out = scratch.spots, scratch.parts, options.values
    for k in range(options.n):
        out[k] += factor * model.behaviours[b].low
    cell = Cell(
        spots[spot, 0], spots[spot, 1], spots[spot, 2], spots[spot, 3], parts[spot, 0], parts[spot, 1], parts[spot, 2]
    )
    add_rows(model.table, cell, factor * model.behaviours[b].step, options.n, out)


@kernel(inline=True)
def _add_end_values(model, b, slot, options, spot, begin, factor, scratch):
    """Add ``factor`` times what a table of states holds of the end of each action, less what the transition costs."""
    offset, out, table = options.offset, options.values, model.table
    above, raised = scratch.spots[spot, 3], scratch.parts[spot, 2]
    near, at = scratch.nears[slot], scratch.spots[spot, 0]
    cells, steps = scratch.cells[2 * slot], scratch.cells[2 * slot + 1]
    parts, turns = scratch.work[WORK_SHARES + 2 * slot], scratch.work[WORK_SHARES + 1 + 2 * slot]
    low, step, discounts = model.behaviours[b].low, model.behaviours[b].step, model.discounts[b, 0]
    for k in range(options.n):
        pair, action = np.uint64(begin + k), np.uint64(offset + k)
        cell = Cell(at + np.int64(cells[pair]), near, np.int64(steps[pair]), above, parts[pair], turns[pair], raised)
        value = interpolate(table, cell)
        value = (low + step * value) * discounts[np.uint64(model.actions[action].length)]
        out[np.uint64(k)] += factor * (value - model.prices[action, slot])


@kernel(inline=True)
def _split_layers(axis, value, scratch, count):
    """Split each of ``count`` layers among its neighbours along one more axis; return how many there are then."""
    if axis.points == 1.0:
        return count
    layers, shares = scratch.layers, scratch.layer_shares
    lower, step, share = locate(axis, value)
    for corner in range(count):
        layers[count + corner], shares[count + corner] = layers[corner] + lower + step, shares[corner] * share
        layers[corner], shares[corner] = layers[corner] + lower, shares[corner] * (1.0 - share)
    return 2 * count


@kernel
def _add_row_values_of_layers(model, b, options, spot, target, factor, scratch):
    """Do what ``_add_row_values`` does for a grid of further axes."""
    spots, parts, behaviour, out = scratch.spots, scratch.parts, model.behaviours[b], options.values
    for k in range(options.n):
        out[k] += factor * behaviour.low
    count = 1
    scratch.layers[0], scratch.layer_shares[0] = 0, 1.0
    for kind in range(HEIGHT, model.grids.shape[1]):
        count = _split_layers(model.grids[b, kind], measure(kind, target), scratch, count)
    for corner in range(count):
        weight = scratch.layer_shares[corner]
        if weight > 0.0:
            at = spots[spot, 0] + scratch.layers[corner] * options.n
            cell = Cell(at, spots[spot, 1], spots[spot, 2], 0, parts[spot, 0], parts[spot, 1], 0.0)
            add_rows(model.table, cell, factor * behaviour.step * weight, options.n, out)


@kernel
def _add_end_values_of_layers(model, b, slot, options, spot, begin, target, factor, scratch):
    """Do what ``_add_end_values`` does for a grid of further axes, which may change with each action."""
    behaviour, moves, near, at = model.behaviours[b], model.moves, scratch.nears[slot], scratch.spots[spot, 0]
    cells, steps = scratch.cells[2 * slot], scratch.cells[2 * slot + 1]
    parts, turns = scratch.work[WORK_SHARES + 2 * slot], scratch.work[WORK_SHARES + 1 + 2 * slot]
    for k in range(options.n):
        pair, action = np.uint64(begin + k), np.uint64(options.offset + k)
        length = np.float64(model.actions[action].length)
        over_ground = Cell(at + np.int64(cells[pair]), near, np.int64(steps[pair]), 0, parts[pair], turns[pair], 0.0)
        if behaviour.lead_later == 0.0:
            over_ground = _cell_at_end(model, b, action, target, at)
        turned = End(atan2(moves[action].sin, moves[action].cos), length, 1.0)
        count = 1
        scratch.layers[0], scratch.layer_shares[0] = 0, 1.0
        for kind in range(HEIGHT, model.grids.shape[1]):
            if model.grids[b, kind].points > 1.0:
                value = after(kind, measure(kind, target), turned)
                count = _split_layers(model.grids[b, kind], value, scratch, count)
        value = 0.0
        for corner in range(count):
            weight = scratch.layer_shares[corner]
            if weight > 0.0:
                start = over_ground.at + scratch.layers[corner]
                cell = Cell(
                    start, over_ground.near, over_ground.aside, 0, over_ground.near_share, over_ground.aside_share, 0.0
                )
                value += weight * interpolate(model.table, cell)
        value = (behaviour.low + behaviour.step * value) * model.discounts[b, 0, model.actions[action].length]
        options.values[np.uint64(k)] += factor * (value - model.prices[action, slot])


@kernel(inline=True)
def _cell_at_end(model, b, action, target, at):
    """Return the cell over the ground of a target at the very end of an action, in the table of the state behind it."""
    move, t = model.moves[action], min(np.float64(model.actions[action].length), target.lasts)
    dx, dz = target.x + t * target.vx - move.x, target.z + t * target.vz - move.z
    x, z = dx * move.cos - dz * move.sin, dx * move.sin + dz * move.cos
    near, near_step, near_share = locate(model.grids[b, DISTANCE], math.sqrt(x * x + z * z))
    aside, aside_step, aside_share = locate(model.grids[b, BEARING], atan2(x, z))
    first = at + np.int64(model.actions[action].next) * model.behaviours[b].cells + near + aside
    return Cell(first, near_step, aside_step, 0, near_share, aside_share, 0.0)

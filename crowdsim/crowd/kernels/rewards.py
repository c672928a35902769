"""Rewards of the actions of a state, for behaviours whose tables are of states: loops over all of them at once.

What terms give at frames is worked out in single precision, as in training.
"""

from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.exponentials import faded
from crowdsim.crowd.kernels.layout import LANES
from crowdsim.crowd.kernels.tables import whole_lanes
from crowdsim.jit import kernel
from crowdsim.policy.terms.registry import ONCE, STRIKE, for_frame_terms
from crowdsim.policy.terms.strike import is_wasted, lands, read_surface
from crowdsim.policy.terms.term import Seen


class Options(NamedTuple):
    """The actions of a state, and what they are worth.

    Attributes:
        offset: The first action.
        n: How many there are.
        values: What each is worth. Shape (most actions of a state,), float64.
    """

    offset: int
    n: int
    values: Any


@kernel(inline=True)
def add_terms(model, b, options, target, factor, scratch):
    """Add ``factor`` times what a behaviour's terms give for a target to what each action is worth."""
    row, last = model.behaviours[b].first_term, model.behaviours[b].end_term
    while row < last:
        kind = model.terms[row].kind
        if kind == STRIKE:
            add_strikes(model, row, options, target, factor, scratch.rows)
            row += 1
        elif kind == ONCE:
            row += 1  # part of ``Model.prices``
        else:
            row = _add_along_paths(model, b, row, last, options, target, factor, scratch.frames)


@kernel(inline=True)
def add_strikes(model, row, options, target, factor, rows):
    """Add ``factor`` times what landed strikes earn by a term to what each action is worth."""
    strikes, term, out, n = model.strikes, model.terms[row], options.values, options.n
    column, greatest, surface = term.column, term.greatest != 0.0, read_surface(term)
    for k in range(n):
        rows[k] = 0.0
    begun, end = model.actions[options.offset].strikes, model.actions[options.offset + n].strikes
    # No branch, since whether a strike lands cannot be predicted.
    for k in range(np.uint64(begun), np.uint64(end)):
        fist = strikes[k].x, strikes[k].y, strikes[k].z
        t = min(np.float64(strikes[k].time), target.lasts)
        head = target.x + t * target.vx, target.y, target.z + t * target.vz
        action = np.uint64(strikes[k].owner)
        landed = lands(fist, (strikes[k].from_x, strikes[k].from_z), head, surface)
        earned = model.earnings[k, column] * np.float64(landed)
        rows[action] = max(rows[action], earned) if greatest else rows[action] + earned
        out[action] -= factor * model.earnings[k, column + 1] * np.float64(is_wasted(fist, head, term))
    factor *= term.weight
    for k in range(n):
        out[k] += factor * rows[k]


def _build_frames(name, read, gap):
    """Return a kernel that adds what a term of one kind gives to a number for each row of paths."""

    def add(paths, first, count, target, term, out):
        wanted, weight = read(term, np.float32), np.float32(term.weight)
        x, z, vx, vz = np.float32(target.x), np.float32(target.z), np.float32(target.vx), np.float32(target.vz)
        lasts, impact = np.float32(target.lasts), np.float32(target.impact)
        cos, sin = cos_sin(target.heading)
        facing_cos, facing_sin = np.float32(cos), np.float32(sin)
        for k in range(count):
            row = np.uint64(first + k)
            t = min(paths.time[row], lasts)
            dx, dz = x + t * vx - paths.x[row], z + t * vz - paths.z[row]
            due = impact - paths.time[row]
            seen = Seen(dx, dz, paths.sin[row], paths.cos[row], facing_sin, facing_cos, due)
            out[k] += weight * faded(gap(seen, wanted))

    return kernel(add, inline=True, name=f"add_rows_of_{name}")


_add_rows = for_frame_terms(_build_frames)


@kernel(inline=True)
def _fold(rows, i, weights, t, before, greatest):
    """Return the sum, or the greatest, of eight weighted rows from ``i`` on and of what was before.

    Their weights are those from ``t`` on.
    """
    one = np.uint64(1)
    a = rows[i] * weights[t]
    i, t = i + one, t + one
    c = rows[i] * weights[t]
    i, t = i + one, t + one
    d = rows[i] * weights[t]
    i, t = i + one, t + one
    e = rows[i] * weights[t]
    i, t = i + one, t + one
    f = rows[i] * weights[t]
    i, t = i + one, t + one
    g = rows[i] * weights[t]
    i, t = i + one, t + one
    h = rows[i] * weights[t]
    i, t = i + one, t + one
    j = rows[i] * weights[t]
    if greatest:
        return max(before, max(max(max(a, c), max(d, e)), max(max(f, g), max(h, j))))
    return before + (((a + c) + (d + e)) + ((f + g) + (h + j)))


@kernel(inline=True)
def _add_along_paths(model, b, row, last, options, target, factor, rows):
    """Add ``factor`` times what terms at frames give to what each action is worth; return the row behind them.

    These are the one in ``row`` and those behind it, before ``last``, if their frames add up: one sum.
    """
    actions, terms, discounts, offset, n = model.actions, model.terms, model.discounts, options.offset, options.n
    begun, end = actions[offset].paths, actions[offset + n].paths
    greatest, count = terms[row].greatest != 0.0, whole_lanes(end - begun)
    for k in range(count):
        rows[k] = np.float32(0.0)
    while True:
        _add_rows(terms[row].kind, model.paths, begun, count, target, terms[row], rows)
        row += 1
        if greatest or row == last:
            break
        if terms[row].kind == STRIKE or terms[row].kind == ONCE or terms[row].greatest != 0.0:
            break
    at = 0
    for k in range(n):
        # Rows of the next action count for nothing: whole lanes leave the number of rounds predictable.
        length = actions[offset + k].length
        near = 0.0
        for t in range(0, length, LANES):
            near = _fold(rows, np.uint64(at + t), discounts[b, length], np.uint64(t), near, greatest)
        options.values[k] += factor * near
        at += length
    return row


@kernel(inline=True)
def count_price_once(model, shares, begun, end, options):
    """Let a transition cost what it costs the behaviour that it costs most, where each has counted its own price.

    ``shares`` holds in column 3 how much each of the behaviours ``begun`` to ``end`` counts.
    """
    behaviours = model.behaviours
    priced = 0
    for b in range(begun, end):
        priced += shares[b - begun, 3] * (behaviours[b].price + behaviours[b].each) > 0.0
    if priced < 2:
        return
    for k in range(options.n):
        cost = np.float64(model.moves[np.uint64(options.offset + k)].cost)
        if cost > 0.0:
            total, most = 0.0, 0.0
            for b in range(begun, end):
                price = shares[b - begun, 3] * (behaviours[b].price * cost + behaviours[b].each)
                total += price
                most = max(most, price)
            options.values[k] += total - most

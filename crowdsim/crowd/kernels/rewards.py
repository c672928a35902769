"""Rewards of actions along their paths, term by term, for behaviours whose tables are of states."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.bodies import comes_through
from crowdsim.core.exponentials import exponential
from crowdsim.crowd.kernels.layout import (
    ASIDE,
    BEST_FRAME,
    BEST_STRIKE,
    EACH,
    EARNED,
    EARNINGS,
    FACING,
    FIRST_TERM,
    FURTHEST,
    HEAD_SIZE,
    KIND,
    LANDING,
    LANES,
    LAST_TERM,
    NEAREST,
    PRICE,
    SIGMA,
    TORSO_END,
    TORSO_SIZE,
    TORSO_TOP,
    WASTED,
    WEIGHT,
)
from crowdsim.crowd.kernels.tables import whole_lanes
from crowdsim.jit import kernel


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


class Band(NamedTuple):
    """Where a target should be: between two distances; ``facing``, straight ahead and at most so far ``aside``."""

    least: float
    most: float
    facing: bool
    aside: float


@kernel(inline=True)
def add_terms(model, b, options, target, factor, scratch):
    """Add ``factor`` times what a behaviour's terms give for a target to what each action is worth."""
    row, last = int(model.behaviours[b, FIRST_TERM]), int(model.behaviours[b, LAST_TERM])
    while row < last:
        if model.terms[row, KIND] == 0.0:
            add_strikes(model, row, options, target, factor, scratch.rows)
            row += 1
        else:
            row = _add_nearness(model, b, row, last, options, target, factor, scratch)


@kernel(inline=True)
def add_strikes(model, row, options, target, factor, rows):
    """Add ``factor`` times what landed strikes earn by a term to what each action is worth."""
    actions, strikes, terms, out, n = model.actions, model.strikes, model.terms, options.values, options.n
    tolerance, head, torso = terms[row, LANDING], terms[row, HEAD_SIZE], terms[row, TORSO_SIZE]
    column, greatest = int(terms[row, EARNED]) - EARNINGS, terms[row, BEST_STRIKE] != 0.0
    wasted = terms[row, WASTED] * terms[row, WASTED]
    low, high = target.y - terms[row, TORSO_END], target.y - terms[row, TORSO_TOP]
    # Within the tolerance of the surface (``rewards.lands``) where no square is below its least, which would be too
    # deep in head or torso, and one is not above its most; which takes no roots.
    head_least, head_most = max(head - tolerance, 0.0) ** 2, (head + tolerance) ** 2
    torso_least, torso_most = max(torso - tolerance, 0.0) ** 2, (torso + tolerance) ** 2
    for k in range(n):
        rows[k] = 0.0
    begun, end = actions[options.offset].strikes, actions[options.offset + n].strikes
    # No branch, since whether a strike lands cannot be predicted.
    for k in range(np.uint64(begun), np.uint64(end)):
        px, py, pz = strikes[k].x, strikes[k].y, strikes[k].z
        t = min(np.float64(strikes[k].time), target.lasts)
        dx, dy, dz = px - (target.x + t * target.vx), py - target.y, pz - (target.z + t * target.vz)
        aside = dx * dx + dz * dz
        to_head = aside + dy * dy
        dy = py - min(max(py, low), high)
        to_torso = aside + dy * dy
        lands = (
            ((to_head <= head_most) | (to_torso <= torso_most)) & (to_head >= head_least) & (to_torso >= torso_least)
        )
        through = comes_through(px, pz, strikes[k].from_x, strikes[k].from_z, px - dx, pz - dz)
        action = np.uint64(strikes[k].owner)
        earned = model.earnings[k, column] * np.float64(lands & (not through))
        rows[action] = max(rows[action], earned) if greatest else rows[action] + earned
        out[action] -= factor * model.earnings[k, column + 1] * np.float64(aside > wasted)
    factor *= terms[row, WEIGHT]
    for k in range(n):
        out[k] += factor * rows[k]


@kernel(inline=True)
def _gaps(paths, first, count, target, band, out):
    """Write how far a target is from its band along ``count`` rows of paths from ``first`` on."""
    x, z, vx, vz, lasts = target.x, target.z, target.vx, target.vz, target.lasts
    least, most, wide = band.least, band.most, band.aside
    if band.facing:
        for k in range(count):
            row = np.uint64(first + k)
            t = min(np.float64(paths.time[row]), lasts)
            dx, dz = x + t * vx - paths.x[row], z + t * vz - paths.z[row]
            cos, sin = paths.cos[row], paths.sin[row]
            aside, ahead = max(abs(dx * cos - dz * sin) - wide, 0.0), dx * sin + dz * cos
            ahead -= min(max(ahead, least), most)
            out[k] = math.sqrt(ahead * ahead + aside * aside)
    else:
        for k in range(count):
            row = np.uint64(first + k)
            t = min(np.float64(paths.time[row]), lasts)
            dx, dz = x + t * vx - paths.x[row], z + t * vz - paths.z[row]
            far = math.sqrt(dx * dx + dz * dz)
            out[k] = abs(far - min(max(far, least), most))


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
def _add_nearness(model, b, row, last, options, target, factor, scratch):
    """Add ``factor`` times proximity terms to what each action is worth; return the row behind the terms.

    These are the one in ``row`` and those behind it, before ``last``, that differ in weight and width alone: one sum.
    """
    actions, terms, discounts, gaps, rows = model.actions, model.terms, model.discounts, scratch.gaps, scratch.rows
    offset, n, out = options.offset, options.n, options.values
    begun, end = actions[offset].paths, actions[offset + n].paths
    facing, greatest = terms[row, FACING] != 0.0, terms[row, BEST_FRAME] != 0.0
    least, most, wide = terms[row, NEAREST], terms[row, FURTHEST], terms[row, ASIDE]
    count = whole_lanes(end - begun)
    _gaps(model.paths, begun, count, target, Band(least, most, facing, wide), gaps)
    weight, shrink = terms[row, WEIGHT], -1.0 / terms[row, SIGMA]
    for k in range(count):
        rows[k] = weight * exponential(gaps[k] * shrink)
    row += 1
    while (
        not greatest and row < last and terms[row, KIND] != 0.0 and terms[row, BEST_FRAME] == 0.0
        and terms[row, NEAREST] == least and terms[row, FURTHEST] == most and terms[row, ASIDE] == wide
        and (terms[row, FACING] != 0.0) == facing
    ):  # fmt: skip
        weight, shrink = terms[row, WEIGHT], -1.0 / terms[row, SIGMA]
        for k in range(count):
            rows[k] += weight * exponential(gaps[k] * shrink)
        row += 1
    at = 0
    for k in range(n):
        # Rows of the next action count for nothing: whole lanes leave the number of rounds predictable.
        length = actions[offset + k].length
        near = 0.0
        for t in range(0, length, LANES):
            near = _fold(rows, np.uint64(at + t), discounts[b, length], np.uint64(t), near, greatest)
        out[k] += factor * near
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
        priced += shares[b - begun, 3] * (behaviours[b, PRICE] + behaviours[b, EACH]) > 0.0
    if priced < 2:
        return
    for k in range(options.n):
        cost = np.float64(model.moves[np.uint64(options.offset + k)].cost)
        if cost > 0.0:
            total, most = 0.0, 0.0
            for b in range(begun, end):
                price = shares[b - begun, 3] * (behaviours[b, PRICE] * cost + behaviours[b, EACH])
                total += price
                most = max(most, price)
            options.values[k] += total - most

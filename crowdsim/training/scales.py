"""The scale on which a behaviour decides, and what a table of bytes keeps of its values."""

from __future__ import annotations

import itertools
import math

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.policy.actions import Actions
from crowdsim.policy.axes.axis import Target
from crowdsim.policy.environment import Grid, fade_factor
from crowdsim.policy.rewards import TargetBody, Term, once_of, pack_terms
from crowdsim.training.model import action_ends, build_movement, changing_layers, ground_axes, measure_layers, places_of

SHOWN = 12.0
"""How far below the best action others are distinguished in a table of bytes, in parts of the behaviour's scale."""

INDIFFERENT = 1e-4
"""A behaviour whose decisions differ by less than this share of its values has no preference."""


def action_values_at(
    targets: Array,
    grid: Grid,
    terms: tuple[Term, ...],
    values: Array,
    discount: float,
    actions: Actions,
    body: TargetBody,
) -> Array:
    """Return what every action is worth for some targets, by the values V behind it.

    Args:
        targets: Where the target may be, and what else may be seen of it (``ranges.sample_targets``). Shape (N, 7).
        grid: The environment.
        terms: The reward's terms.
        values: V. Shape (S, C).
        discount: gamma, a control frame.
        actions: The graph's actions, or those of the captured states (``build_model``).
        body: Sizes of the target.

    Returns:
        Q. Shape (A, N), float32.
    """
    from crowdsim.training.kernels.judging import Learned, fill_action_values

    seen = Target(*np.ascontiguousarray(targets.T))
    measures = measure_layers(grid, seen)
    layers, shares = _layers_around(grid, measures)
    learned = Learned(
        axes=ground_axes(grid),
        ends=action_ends(actions, build_movement())[0],
        layered=changing_layers(grid),
        discounts=(discount ** actions.lengths.astype(np.float64)).astype(np.float32),
        values=np.ascontiguousarray(values, np.float32),
        terms=pack_terms(terms, body),
        once=once_of(terms, actions),
        log_discount=math.log(discount),
        heights=seen.y,
        measures=measures,
        layers=layers,
        shares=shares,
        lead=grid.leads[1] * float(actions.lengths.mean()),
    )
    places = places_of(seen, seen.vx, seen.vz, grid.lasts)
    result = np.empty((actions.action_count, len(targets)), np.float32)
    own = actions._replace(next=actions.next % np.int32(actions.state_count))
    share(actions.action_count, fill_action_values, own, learned, places, result)
    return result


def _layers_around(grid: Grid, measures: Array) -> tuple[Array, Array]:
    """Return the layers of a grid around what is measured (``measure_layers``), and their shares.

    Shapes (E, N), int64 and float32.
    """
    cells, shares = np.zeros((1, len(measures)), np.int64), np.ones((1, len(measures)), np.float32)
    strides = grid.strides[len(grid.ground_axes) :]
    for axis, stride, values in zip(grid.layer_axes, strides, measures.T, strict=True):
        place = axis.places(values) % axis.count if axis.wraps else np.clip(axis.places(values), 0.0, axis.count - 1.0)
        lower = np.minimum(place.astype(np.int64), axis.count - 1 if axis.wraps else max(axis.count - 2, 0))
        upper = (lower + 1) % axis.count if axis.wraps else np.minimum(lower + 1, axis.count - 1)
        share = (place - lower).astype(np.float32)
        cells = np.concatenate([cells + lower * stride, cells + upper * stride])
        shares = np.concatenate([shares * (np.float32(1.0) - share), shares * share])
    return cells, shares


def decisive_scale(values: Array, actions: Actions, fades: Array, greatest: float) -> float:
    """Return the scale on which a behaviour decides: how much better its best action is than the median one.

    The mean over all states, and over the targets that the behaviour counts for. Decisions depend on the differences
    between the actions of one state alone, so values of behaviours are divided by this before they are added up; how
    much they differ from place to place says nothing about decisions.

    Args:
        values: What every action is worth for some targets (``action_values_at``). Shape (A, N), float32.
        actions: The graph's actions.
        fades: How much the behaviour counts for each of the targets. Shape (N,).
        greatest: Greatest size of the behaviour's values.

    Returns:
        The scale; 0 for a behaviour that is indifferent, which then counts for nothing.
    """
    from crowdsim.training.kernels.judging import action_spreads

    spreads = np.empty((actions.state_count, len(fades)))
    share(actions.state_count, action_spreads, actions.offsets, values, spreads)
    counted = spreads[:, fades > 0.0]
    finite = counted[np.isfinite(counted)]
    scale = float(np.mean(finite)) if len(finite) else 0.0
    return scale if scale > INDIFFERENT * greatest else 0.0


def fades_of(grid: Grid, targets: Array) -> Array:
    """Return how much a behaviour counts for each target (N, 6). Shape (N,)."""
    return np.array([fade_factor(grid, target) for target in targets])


def advantages(q: Array, actions: Actions, cells: int, shown: float) -> Array:
    """Return Q less that of the state's best action in each cell, and -shown at least, in the layout of a Q-table."""
    result = np.empty_like(q)
    for first, end in itertools.pairwise(actions.offsets.tolist()):
        rows = q[first * cells : end * cells].reshape(cells, end - first)
        best = rows.max(axis=1, keepdims=True)
        result[first * cells : end * cells] = np.maximum(rows - best, -shown).ravel()
    return result

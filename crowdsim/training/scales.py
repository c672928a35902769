"""The scale on which a behaviour decides, and what a table of bytes keeps of its values."""

from __future__ import annotations

import itertools

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.actions import Actions
from crowdsim.policy.policy import Behaviour
from crowdsim.policy.rewards import TargetBody

SHOWN = 12.0
"""How far below the best action others are distinguished in a table of bytes, in parts of the behaviour's scale."""

INDIFFERENT = 1e-4
"""A behaviour whose decisions differ by less than this share of its values has no preference."""


def decisive_scale(behaviour: Behaviour, actions: Actions, body: TargetBody, targets: Array, greatest: float) -> float:
    """Return the scale on which a behaviour decides: how much better its best action is than the median one.

    The mean over all states, and over the targets that the behaviour counts for. Decisions depend on the differences
    between the actions of one state alone, so values of behaviours are divided by this before they are added up; how
    much they differ from place to place says nothing about decisions.

    Args:
        behaviour: Its table not yet encoded.
        actions: The graph's actions.
        body: Sizes of the target.
        targets: Where the target may be, and how it may move (``ranges.sample_targets``). Shape (N, 5).
        greatest: Greatest size of the behaviour's values.

    Returns:
        The scale; 0 for a behaviour that is indifferent, which then counts for nothing.
    """
    from crowdsim.policy.policy import build_lookup_tables
    from crowdsim.training.kernels.judging import action_spreads

    tables = build_lookup_tables(actions, (behaviour,), body)
    spreads = np.full((actions.state_count, len(targets)), np.nan)
    action_spreads(tables, targets, spreads)
    finite = spreads[np.isfinite(spreads)]
    scale = float(np.mean(finite)) if len(finite) else 0.0
    return scale if scale > INDIFFERENT * greatest else 0.0


def advantages(q: Array, actions: Actions, cells: int, shown: float) -> Array:
    """Return Q less that of the state's best action in each cell, and -shown at least, in the layout of a Q-table."""
    result = np.empty_like(q)
    for first, end in itertools.pairwise(actions.offsets.tolist()):
        rows = q[first * cells : end * cells].reshape(cells, end - first)
        best = rows.max(axis=1, keepdims=True)
        result[first * cells : end * cells] = np.maximum(rows - best, -shown).ravel()
    return result

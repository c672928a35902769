"""Room for what a simulation records, and scratch space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Model, Record
from crowdsim.crowd.kernels.layout import BLOCK, LANES
from crowdsim.crowd.kernels.records import NEIGHBOUR, SITUATION, STRIKE


class Scratch(NamedTuple):
    """Scratch space for a batch of avatars that choose, and for all actions of a state.

    Attributes:
        situations: Where each one's target is, how it moves and which way it faces. Shape (batch,), ``SITUATION``.
        states: The state that it chooses in, -1 where there is no opponent. Shape (batch,), int32.
        cohorts: Its cohort. Shape (batch,), int32.
        policies: Its policy. Shape (batch,), int32.
        order: Indices in the batch in the order of states. Shape (batch,), int64.
        starts: Where each state begins in it. Shape (S + 2,), int64.
        values: What its actions are worth. Shape (batch, most actions of a state), float64.
        begins: Where the actions of each of a block begin in ``cells`` and ``work``. Shape (block + 1,), int64.
        spots: For each of a block and each behaviour an entry of the table, and steps from there to the next along
            each axis. Shape (block * behaviours, 4), int64.
        parts: Likewise the shares of the next one along each axis, and how much the behaviour counts.
            Shape (block * behaviours, 4), float64.
        nears: Steps between distances in each behaviour's table. Shape (behaviours,), int64.
        cells: For each behaviour where each action ends in the table, and the step to the next bearing.
            Shape (2 * behaviours, actions of a block), float64.
        work: Where the target is seen from there: x, z, distance, bearing; the state; then for each behaviour the
            shares of the next distance and bearing. Shape (5 + 2 * behaviours, actions of a block), float64.
        frames: A number for each control frame of a state's actions. float32.
        rows: A number for each action. float64.
        layers: Cells around a target on axes that are not over the ground. Shape (64,), int64.
        layer_shares: Their shares. Shape (64,), float64.
        near: Neighbours that may be in the way. Shape (most neighbours,), ``NEIGHBOUR``.
    """

    situations: Array
    states: Array
    cohorts: Array
    policies: Array
    order: Array
    starts: Array
    values: Array
    begins: Array
    spots: Array
    parts: Array
    nears: Array
    cells: Array
    work: Array
    frames: Array
    rows: Array
    layers: Array
    layer_shares: Array
    near: Array


def empty_record(frames: int, count: int) -> Record:
    """Return a record with room for some frames."""
    kinds = {"action": np.int32, "opponent": np.int32}
    return Record(*(np.empty((frames, count), kinds.get(name, np.float32)) for name in Record._fields))


def empty_strikes(count: int) -> Array:
    """Return room for some strikes (``STRIKE``)."""
    return np.empty(count, STRIKE)


def empty_scratch(model: Model, neighbours: int, batch: int) -> Scratch:
    """Return scratch space for the states of a model, for some neighbours, and for a batch."""
    lanes, block = LANES, min(BLOCK, batch)
    width = -(-int(np.diff(model.offsets).max()) // lanes) * lanes
    behaviours = int(np.diff(model.policies["behaviours"]).max())
    rows = int(np.diff(model.actions["paths"][model.offsets]).max()) + lanes
    return Scratch(
        situations=np.zeros(batch, SITUATION),
        states=np.empty(batch, np.int32),
        cohorts=np.empty(batch, np.int32),
        policies=np.empty(batch, np.int32),
        order=np.empty(batch, np.int64),
        starts=np.empty(len(model.offsets) + 1, np.int64),
        values=np.empty((batch, width)),
        begins=np.empty(block + 1, np.int64),
        spots=np.empty((block * behaviours, 4), np.int64),
        parts=np.empty((block * behaviours, 4)),
        nears=np.empty(behaviours, np.int64),
        cells=np.zeros((2 * behaviours, block * width)),
        work=np.zeros((5 + 2 * behaviours, block * width)),
        # Rows behind the last action are read and weighed by zero, which needs them to be finite.
        frames=np.zeros(rows, np.float32),
        rows=np.zeros(width),
        layers=np.zeros(64, np.int64),
        layer_shares=np.zeros(64),
        near=np.empty(max(neighbours, 1), NEIGHBOUR),
    )

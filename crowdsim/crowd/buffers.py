"""Room for what a simulation records, and scratch space."""

from __future__ import annotations

import numpy as np

from crowdsim.crowd.arrays import Model, Record, Scratch, Strikes
from crowdsim.crowd.kernels import layout


def empty_record(frames: int, count: int) -> Record:
    """Return a record with room for some frames."""
    # A spare frame, so that rows of it never lie in one piece: kernels are compiled for one layout, whatever the rows.
    whole, real = np.empty((2, frames + 1, count), np.int32), np.empty((4, frames + 1, count), np.float32)
    return Record(whole[:, :frames], real[:, :frames])


def empty_strikes(count: int) -> Strikes:
    """Return room for some strikes."""
    return Strikes(np.empty((count, 5), np.int32), np.empty((count, 6)))


def empty_scratch(model: Model, neighbours: int, batch: int) -> Scratch:
    """Return scratch space for the states of a model, for some neighbours, and for a batch."""
    lanes, block = layout.LANES, min(layout.BLOCK, batch)
    width = -(-int(np.diff(model.offsets).max()) // lanes) * lanes
    behaviours = int(np.diff(model.policies[:, layout.BEHAVIOURS]).max())
    rows = int(np.diff(model.actions[model.offsets, layout.PATHS]).max()) + lanes
    return Scratch(
        situations=np.zeros((batch, 6)),
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
        gaps=np.empty(rows),
        # Rows behind the last action are read and weighed by zero, which needs them to be finite.
        rows=np.zeros(max(rows, width)),
        near=np.empty((max(neighbours, 1), 10)),
    )

"""All runs of a batch as one xarray dataset, with the swept keys as dimensions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.batch.plan import read_plan
from crowdsim.batch.report import plain_value, read_table
from crowdsim.core.types import FileName
from crowdsim.errors import BatchError, nearest

if TYPE_CHECKING:
    from xarray import Dataset

    from crowdsim.take.take import Take

_TEXT = ("run", "scenario", "state", "folder", "task", "cause", "message", "log", "command")


def open_batch(folder: FileName, variables: Sequence[str] = ()) -> Dataset:
    """Return all runs of a batch as one dataset, with the columns of ``report/summary.csv`` by name.

    Dimensions are ``scenario``, where there are several, and the first key of every axis of the batch; keys that change
    with it are coordinates along it. What was excluded, failed or is not done is NaN, or an empty text. Variables of
    takes, such as ``x`` and ``z``, have the dimensions ``frame`` and ``avatar`` behind the others, as long as the
    longest and largest run, NaN beyond the end of the others.

    Raises:
        BatchError: There is no batch, it is damaged, or a variable is unknown.
    """
    from xarray import Dataset

    folder = Path(folder)
    plan = read_plan(folder)
    table, batch = read_table(folder, plan), plan.batch
    several = len(batch.scenarios) > 1
    sizes = {"scenario": len(batch.scenarios)} if several else {}
    coordinates: dict[str, Any] = {"scenario": list(batch.scenarios)} if several else {}
    for axis in batch.all_axes:
        first = next(iter(axis))
        sizes[first] = len(axis[first])
        coordinates |= {key: (first, [plain_value(value) for value in column]) for key, column in axis.items()}
    shape = tuple(sizes.values())
    places = [(batch.scenarios.index(one.scenario),) * several + one.indices for one, _ in plan.combinations]
    found: dict[str, Any] = {}
    for name in table.columns:
        if name in coordinates:
            continue
        is_text = name in _TEXT
        values = np.full(shape, "" if is_text else np.nan, dtype=object if is_text else float)
        for place, value in zip(places, table[name], strict=True):
            missing = value is None or value != value
            values[place] = ("" if missing else str(value)) if is_text else np.nan if value is None else float(value)
        found[name] = (tuple(sizes), values.astype(str) if is_text else values)
    takes = _open_takes(folder, variables, places, table)
    # As many as there are, whatever the plan says.
    frames, avatars = (
        max((getattr(take, key) for take in takes.values()), default=0) for key in ("frame_count", "avatar_count")
    )
    for name in variables:
        values = np.full((*shape, frames, avatars), np.nan, np.float32)
        for place, take in takes.items():
            values[place][: take.frame_count, : take.avatar_count] = getattr(take, name)[:]
        found[name] = ((*sizes, "frame", "avatar"), values)
    return Dataset(found, coordinates, {"name": batch.name, "description": batch.description})


def _open_takes(
    folder: Path, variables: Sequence[str], places: Sequence[tuple[int, ...]], table: Mapping[str, Any]
) -> dict[tuple[int, ...], Take]:
    """Return the takes of all runs that are done by their places, if they have the variables."""
    from crowdsim.take.store import open_take
    from crowdsim.take.take import VARIABLES

    for name in variables:
        if name not in VARIABLES:
            what = f"takes have none of that name, expected {', '.join(VARIABLES)}{nearest(name, VARIABLES)}"
            raise BatchError(f"variable {name!r}: {what}")
    rows = zip(places, table["folder"], table["state"], strict=True) if variables else ()
    return {place: open_take(folder / run) for place, run, state in rows if state == "done"}

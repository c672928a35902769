"""All runs of a batch as one xarray dataset, with the swept keys as dimensions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.batch.plan import Plan, read_plan
from crowdsim.batch.table import plain_value, read_table
from crowdsim.core.types import FileName
from crowdsim.errors import BatchError, nearest

if TYPE_CHECKING:
    from xarray import Dataset

_TEXT = ("run", "state", "folder", "task", "cause", "message", "log", "command")


def open_batch(folder: FileName, variables: Sequence[str] = ()) -> Dataset:
    """Return all runs of a batch as one dataset.

    Dimensions are ``scenario``, where there are several, and the first key of every axis of the batch; keys that change
    with it are coordinates along it. What was excluded, failed or is not done is NaN, or an empty text.

    Args:
        folder: Folder of the batch.
        variables: Variables of the takes to be added, such as ``x`` and ``z``. They have the dimensions ``frame`` and
            ``avatar`` behind the others, as long as the longest and largest run, NaN beyond the end of the others.

    Returns:
        Figures of the runs, as the columns of ``report/summary.csv``, by name.

    Raises:
        BatchError: There is no batch, it is damaged, or a variable is unknown.
    """
    from xarray import Dataset

    folder = Path(folder)
    plan = read_plan(folder)
    table = read_table(folder, plan)
    keys = {key for axis in plan.axes for key in axis}
    sizes, coordinates = _coordinates(plan)
    shape = tuple(sizes.values())
    places = [_place(plan, one.scenario, one.indices) for one, _ in plan.combinations]
    found: dict[str, Any] = {}
    for name in table.columns:
        if name in keys or (name == "scenario" and "scenario" in sizes):
            continue
        is_text = name in _TEXT or name == "scenario"
        values = np.full(shape, "" if is_text else np.nan, dtype=object if is_text else float)
        for place, value in zip(places, table[name], strict=True):
            values[place] = ("" if value is None or value != value else str(value)) if is_text else _number(value)
        found[name] = (tuple(sizes), values.astype(str) if is_text else values)
    for name in variables:
        found[name] = ((*sizes, "frame", "avatar"), _read_takes(folder, plan, name, shape, places, table))
    return Dataset(found, coordinates, {"name": plan.batch.name, "description": plan.batch.description})


def _coordinates(plan: Plan) -> tuple[dict[str, int], dict[str, Any]]:
    """Return the length of each dimension, and the coordinates."""
    sizes: dict[str, int] = {}
    coordinates: dict[str, Any] = {}
    if len(plan.batch.scenarios) > 1:
        sizes["scenario"], coordinates["scenario"] = len(plan.batch.scenarios), list(plan.batch.scenarios)
    for axis in plan.axes:
        first = next(iter(axis))
        sizes[first] = len(axis[first])
        for key, column in axis.items():
            coordinates[key] = (first, [plain_value(value) for value in column])
    return sizes, coordinates


def _place(plan: Plan, scenario: str, indices: tuple[int, ...]) -> tuple[int, ...]:
    """Return the index of a combination in all dimensions."""
    return ((plan.batch.scenarios.index(scenario),) if len(plan.batch.scenarios) > 1 else ()) + indices


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)


def _read_takes(
    folder: Path,
    plan: Plan,
    name: str,
    shape: tuple[int, ...],
    places: Sequence[tuple[int, ...]],
    table: Mapping[str, Any],
) -> Any:
    """Return a variable of all takes, NaN where there is nothing."""
    from crowdsim.take.store import open_take
    from crowdsim.take.take import VARIABLES

    if name not in VARIABLES:
        known = ", ".join(VARIABLES)
        raise BatchError(f"variable {name!r}: takes have none of that name, expected {known}{nearest(name, VARIABLES)}")
    takes = {
        place: open_take(folder / run)
        for place, run, state in zip(places, table["folder"], table["state"], strict=True)
        if state == "done"
    }
    # As many as there are, whatever the plan says.
    frames, avatars = (
        max((getattr(take, key) for take in takes.values()), default=0) for key in ("frame_count", "avatar_count")
    )
    values = np.full((*shape, frames, avatars), np.nan, np.float32)
    for place, take in takes.items():
        values[place][: take.frame_count, : take.avatar_count] = getattr(take, name)[:]
    return values

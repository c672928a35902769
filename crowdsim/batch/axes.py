"""Axes of a batch: keys of a scenario and the values that they take, multiplied or zipped."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

_RANGE = re.compile(r"\s*(\d{1,18})\s*:\s*(\d{1,18})\s*")


@dataclass(frozen=True)
class Axis:
    """Keys whose values change together.

    Attributes:
        keys: Key paths of a scenario, such as ``groups[0].count``; the first names the axis.
        columns: Values of each key, equally many.
    """

    keys: tuple[str, ...]
    columns: tuple[Sequence[Any], ...]

    def __len__(self) -> int:
        return len(self.columns[0])

    def row(self, index: int) -> dict[str, Any]:
        """Return the values of all keys at an index."""
        return {key: column[index] for key, column in zip(self.keys, self.columns, strict=True)}


@dataclass(frozen=True)
class Combination:
    """One scenario with one value of every axis.

    Attributes:
        scenario: The scenario as the batch names it.
        indices: Index of the value on each axis.
        values: The values by key.
    """

    scenario: str
    indices: tuple[int, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return it in words."""
        return ", ".join([self.scenario, *(f"{key}={value}" for key, value in self.values.items())])


def read_values(values: Any) -> Sequence[Any]:
    """Return the values that a list, or text such as ``0:10`` for whole numbers, stands for; nothing for other text."""
    if isinstance(values, str):
        match = _RANGE.fullmatch(values)
        return range(int(match[1]), int(match[2])) if match else ()
    return list(values)


def read_axis(keys: Mapping[str, Any]) -> Axis:
    """Return the axis of some keys with their values."""
    return Axis(tuple(keys), tuple(read_values(values) for values in keys.values()))


def count_combinations(scenarios: Sequence[str], axes: Sequence[Axis]) -> int:
    """Return how many combinations there are, those that are excluded among them."""
    return len(scenarios) * math.prod(map(len, axes))


def combine(
    scenarios: Sequence[str], axes: Sequence[Axis], exclude: Sequence[Mapping[str, Any]] = ()
) -> Iterator[Combination]:
    """Yield every scenario with every value of every axis, the last axis first, but for what is excluded.

    Args:
        scenarios: Scenarios by name.
        axes: The axes.
        exclude: Values by key, one or a list of them each; a combination that has them all is left out. The key
            ``scenario`` is the scenario's name.
    """
    for scenario in scenarios:
        for indices in itertools.product(*(range(len(axis)) for axis in axes)):
            values: dict[str, Any] = {}
            for axis, index in zip(axes, indices, strict=True):
                values.update(axis.row(index))
            if not any(_has({"scenario": scenario, **values}, rule) for rule in exclude):
                yield Combination(scenario, indices, values)


def _has(values: Mapping[str, Any], rule: Mapping[str, Any]) -> bool:
    return all(values[key] in (wanted if isinstance(wanted, list) else [wanted]) for key, wanted in rule.items())

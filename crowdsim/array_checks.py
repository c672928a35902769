"""Checks of arrays that are read from files, declared as tables: no index reaches compiled code unchecked.

A table names every array with its type, its shape in named dimensions, and what must be true of its entries. Sizes of
dimensions are taken from the arrays in the order of the table, but for those that are known beforehand. Checks need one
or two passes over an array, whether it is mapped into memory or not, and no copy of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from crowdsim.core.types import Array

_BLOCK = 1 << 15
_UNIT = 1e-3

Sizes = Mapping[str, int]
Check = Callable[[Array, Sizes], str]
"""Says what is wrong with an array, and what was expected; an empty text when nothing is."""


class ArrayFault(ValueError):
    """An array is not what its table says.

    Attributes:
        name: Name of the array.
        what: What is wrong with it, and what was expected.
    """

    def __init__(self, name: str, what: str) -> None:
        super().__init__(f"{name}: {what}")
        self.name, self.what = name, what


@dataclass(frozen=True)
class Column:
    """What an array must be.

    Attributes:
        dtypes: Its type, or several with blanks between; little endian.
        shape: Numbers, or names of dimensions, ``A`` or ``A+1`` say.
        checks: What must be true of its entries.
    """

    dtypes: str
    shape: tuple[int | str, ...]
    checks: tuple[Check, ...] = ()


@dataclass(frozen=True)
class Relation:
    """What must be true of several arrays together.

    Attributes:
        name: The array that is to blame.
        expected: What is expected of it.
        holds: Whether it is so, for each entry of that array or for all at once.
    """

    name: str
    expected: str
    holds: Callable[[Mapping[str, Array]], Array | bool]


def check_table(
    table: Mapping[str, Column], arrays: Mapping[str, Array], sizes: Sizes, optional: Sequence[str] = ()
) -> dict[str, int]:
    """Hold arrays against their table; return the sizes of all dimensions.

    Args:
        table: The table.
        arrays: The arrays by name.
        sizes: Sizes that are known beforehand.
        optional: Arrays that may be missing.

    Raises:
        ArrayFault: One is missing, unknown, or not what the table says.
    """
    found = dict(sizes)
    for name in arrays:
        if name not in table:
            what = "is unknown, expected only arrays of the format; what another version made must be made again, "
            raise ArrayFault(name, f"{what}a policy by 'crowdsim train'")
    for name, column in table.items():
        if name in arrays:
            check_array(name, arrays[name], column, found)
        elif name not in optional:
            raise ArrayFault(name, f"is missing, expected {column.dtypes}{_shape_text(column.shape)}")
    return found


def check_array(name: str, values: Array, column: Column, sizes: dict[str, int]) -> None:
    """Hold an array against what it must be; dimensions that are new are added to ``sizes``.

    Raises:
        ArrayFault: It is something else.
    """
    check_shape(name, values.dtype, values.shape, column, sizes)
    if not values.flags.c_contiguous:
        raise ArrayFault(name, "is in Fortran order, expected C order")
    for check in column.checks if values.size else (check for check in column.checks if isinstance(check, Offsets)):
        what = check(values, sizes)
        if what:
            raise ArrayFault(name, what)


def check_shape(name: str, dtype: np.dtype[Any], shape: tuple[int, ...], column: Column, sizes: dict[str, int]) -> None:
    """Hold type and shape of an array against what they must be, as ``check_array`` does.

    Raises:
        ArrayFault: They are others.
    """
    if dtype not in _dtypes(column.dtypes):
        kind = dtype.name if dtype.isnative else dtype.str
        raise ArrayFault(name, f"holds {kind}, expected {column.dtypes.replace(' ', ' or ')}")
    fits = len(shape) == len(column.shape)
    if not (fits and all(_fits(size, wanted, sizes) for size, wanted in zip(shape, column.shape, strict=True))):
        expected = f"{_shape_text(column.shape)}{_sizes_text(column.shape, sizes)}"
        raise ArrayFault(name, f"has the shape {shape}, expected {expected}")


def check_relations(relations: Sequence[Relation], arrays: Mapping[str, Array]) -> None:
    """Hold arrays that have passed their table against one another.

    Raises:
        ArrayFault: They do not belong together.
    """
    for relation in relations:
        holds = np.asarray(relation.holds(arrays))
        if not holds.all():
            values = arrays[relation.name]
            at = int(np.argmin(holds)) if holds.shape == values.shape else None
            found = f"is {values[at]} at [{at}], " if at is not None else ""
            raise ArrayFault(relation.name, f"{found}expected {relation.expected}")


@dataclass(frozen=True)
class Within:
    """Numbers between two limits, both included; with ``absent`` NaN too."""

    low: float
    high: float
    absent: bool = False

    def __call__(self, values: Array, sizes: Sizes) -> str:
        """Say what is out of range."""
        low, high = _extremes(values)
        if self.absent and low != low:
            low, high = float(np.fmin.reduce(values, axis=None)), float(np.fmax.reduce(values, axis=None))
            if low != low:
                return ""
        if low >= self.low and high <= self.high:
            return ""
        inside = (values >= self.low) & (values <= self.high)
        return f"{_found(values, inside | (values != values) if self.absent else inside)}, expected {self._range()}"

    def _range(self) -> str:
        return f"numbers from {self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class Index:
    """Indices into a dimension, from ``least`` on, and less than its size."""

    of: str
    least: int = 0

    def __call__(self, values: Array, sizes: Sizes) -> str:
        """Say what is out of range."""
        last = sizes[self.of] - 1
        low, high = _extremes(values)
        if low >= self.least and high <= last:
            return ""
        inside = (values >= self.least) & (values <= last)
        return f"{_found(values, inside)}, expected indices from {self.least} to {last}"


@dataclass(frozen=True)
class Offsets:
    """Offsets of a CSR, from 0 to the size of a dimension, each ``least`` to ``most`` after the one before."""

    of: str
    least: int = 0
    most: int | None = None

    def __call__(self, values: Array, sizes: Sizes) -> str:
        """Say what is wrong with them."""
        end = sizes[self.of]
        if not len(values) or values[0] != 0 or values[-1] != end:
            ends = f"begin with {values[0]} and end with {values[-1]}" if len(values) else "are none"
            return f"offsets {ends}, expected 0 and {end}"
        # No entry is out of range if they ascend, and differences are of a wider type, which does not overflow.
        steps = np.diff(values.astype(np.int64))
        if not len(steps) or (steps.min() >= self.least and (self.most is None or steps.max() <= self.most)):
            return ""
        inside = (steps >= self.least) & (steps <= (end if self.most is None else self.most))
        at = int(np.argmin(inside))
        most = "" if self.most is None else f", at most {self.most}"
        return f"offset {at + 1} is {steps[at]} after the one before, expected at least {self.least}{most}"


@dataclass(frozen=True)
class Ascending:
    """Entries that ascend; with ``strictly`` no two are equal."""

    strictly: bool = False

    def __call__(self, values: Array, sizes: Sizes) -> str:
        """Say where they do not."""
        before, after = values[:-1], values[1:]
        holds = before < after if self.strictly else before <= after
        if holds.all():
            return ""
        at = int(np.argmin(holds)) + 1
        return f"holds {values[at]} at [{at}] behind {values[at - 1]}, expected ascending entries"


def unit_quaternions(values: Array, sizes: Sizes) -> str:
    """Say which quaternions are no rotations: those that are longer or shorter than 1 by more than 0.001."""
    rows = values.reshape(-1, 4)
    with np.errstate(over="ignore", invalid="ignore"):
        if all(_are_units(rows[start : start + _BLOCK]) for start in range(0, len(rows), _BLOCK)):
            return ""
        lengths = np.linalg.norm(values, axis=-1)
    return f"{_found(lengths, np.abs(lengths - 1.0) <= _UNIT)} as a length, expected unit quaternions"


def _are_units(rows: Array) -> bool:
    squares = rows[:, 0] * rows[:, 0]
    for column in rows.T[1:]:
        squares += column * column
    return bool(squares.min() >= (1.0 - _UNIT) ** 2 and squares.max() <= (1.0 + _UNIT) ** 2)


def parents_first(values: Array, sizes: Sizes) -> str:
    """Say where a child comes before its parent; the first joint is the root and has -1."""
    holds = (values >= 0) & (values < np.arange(len(values)))
    holds[0] = values[0] == -1
    if holds.all():
        return ""
    at = int(np.argmin(holds))
    return f"holds {values[at]} at [{at}], expected -1 for the root and an earlier joint for all others"


def true_or_false(values: Array, sizes: Sizes) -> str:
    """Say which bytes of booleans are neither 0 nor 1."""
    raw = values.view(np.uint8)
    return "" if raw.max() <= 1 else f"{_found(raw, raw <= 1)}, expected 0 or 1"


def _extremes(values: Array) -> tuple[float, float]:
    """Return the lowest and the highest entry, both NaN where one is: in blocks that are still in the cache."""
    if values.size <= _BLOCK:
        return float(values.min()), float(values.max())
    flat = values.reshape(-1)
    blocks = [flat[start : start + _BLOCK] for start in range(0, len(flat), _BLOCK)]
    extremes = np.array([(block.min(), block.max()) for block in blocks])
    return float(extremes[:, 0].min()), float(extremes[:, 1].max())


def _found(values: Array, inside: Array) -> str:
    """Return the first entry that is out of range, and where it is."""
    at = np.unravel_index(int(np.argmin(inside)), values.shape)
    return f"holds {values[at]} at [{', '.join(map(str, at))}]"


@cache
def _dtypes(names: str) -> tuple[np.dtype[Any], ...]:
    return tuple(np.dtype(name) for name in names.split())


def _fits(size: int, wanted: int | str, sizes: dict[str, int]) -> bool:
    if isinstance(wanted, int):
        return size == wanted
    name, _, more = wanted.partition("+")
    known = size - int(more or 0)
    return known >= 0 and sizes.setdefault(name, known) == known


def _shape_text(shape: tuple[int | str, ...]) -> str:
    return f"({', '.join(map(str, shape))}{',' * (len(shape) == 1)})"


def _sizes_text(shape: tuple[int | str, ...], sizes: Sizes) -> str:
    names = [str(wanted).partition("+")[0] for wanted in shape if isinstance(wanted, str)]
    known = [f"{name} = {sizes[name]}" for name in dict.fromkeys(names) if name in sizes]
    return f" with {', '.join(known)}" if known else ""

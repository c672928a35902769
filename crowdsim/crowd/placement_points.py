"""Points of a placement from CSV and NPY files, of which nothing is taken for granted."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

from crowdsim.core.types import Array
from crowdsim.scenario.groups import PointsPlacement
from crowdsim.scenario.parts import FARTHEST
from crowdsim.scenario.scenario import Scenario

_LONGEST_LINE = 1000
_COLUMNS = "x", "z", "heading"


def read_points(scenario: Scenario, group: int, placement: PointsPlacement) -> Array:
    """Return a placement's points: x and z [m] and, where the file has it, the heading [degrees]. Shape (M, 2 or 3).

    Of a file, there are no more than the group has avatars.

    Raises:
        ScenarioError: The file cannot be read or has another format.
    """
    if placement.file is None:
        return np.array(placement.points or (), dtype=float).reshape(-1, 2)
    path = scenario.folder / placement.file
    try:
        read = _read_npy if path.suffix.lower() == ".npy" else _read_csv
        points = read(path, scenario.groups[group].count)
        good = np.isfinite(points).all(axis=1) & (np.abs(points[:, :2]) <= FARTHEST).all(axis=1)
        if not good.all():
            row = int(np.argmin(good))
            values = ", ".join(f"{value:g}" for value in points[row])
            raise ValueError(f"row {row + 1} is {values}, expected finite numbers up to {FARTHEST:g} m")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise scenario.error(f"{path}: {reason}", "groups", group, "placement", "file") from None
    return points


def _check_columns(shape: tuple[int, ...]) -> None:
    if len(shape) != 2 or shape[1] not in (2, 3):
        raise ValueError(f"holds an array of shape {shape}, expected rows of x, z and perhaps a heading")


def _read_npy(path: Path, most: int) -> Array:
    """Read the first ``most`` rows of an array; what its header claims must be in the file, which is never unpickled.

    Raises:
        ValueError: It is no such array.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        try:
            version = np.lib.format.read_magic(file)
            read_header = np.lib.format.read_array_header_1_0
            if version != (1, 0):
                read_header = np.lib.format.read_array_header_2_0
            shape, is_fortran, dtype = read_header(file)
        except Exception:
            # numpy reads it as Python, whose tokenizer and parser raise much.
            raise ValueError("is no NPY file, expected an array as numpy.save writes it") from None
        if dtype.kind not in "fiu":
            raise ValueError(f"holds {dtype.name} values, expected numbers: rows of x, z and perhaps a heading")
        _check_columns(shape)
        held = (os.fstat(file.fileno()).st_size - file.tell()) // (shape[1] * dtype.itemsize)
        if not 0 <= shape[0] <= held:
            raise ValueError(f"claims {shape[0]:,} rows, but holds {held:,}, expected a complete file")
        rows = shape[0] if is_fortran else min(shape[0], most)
        values = np.fromfile(file, dtype, rows * shape[1])
    points = values.reshape(rows, shape[1], order="F" if is_fortran else "C")
    return np.ascontiguousarray(points[:most], dtype=float)


def _read_csv(path: Path, most: int) -> Array:
    """Read the first ``most`` rows of numbers between commas, semicolons or blanks, below the names of columns if any.

    Raises:
        ValueError: It is no such text.
        OSError: It cannot be read.
    """
    with path.open(encoding="utf-8-sig", newline=None) as file:
        lines = _Lines(file)
        try:
            first = next(lines, "")
            separator = "," if "," in first else ";" if ";" in first else None
            words = first.split(separator)
            if not words or _is_number(words[0]):
                file.seek(0)
                lines = _Lines(file)
            else:
                _check_names(words)
            with warnings.catch_warnings():
                # A file without rows is one without points, which is reported as such.
                warnings.simplefilter("ignore", UserWarning)
                points = np.loadtxt(lines, delimiter=separator, ndmin=2, max_rows=most)
        except UnicodeDecodeError:
            raise ValueError(f"line {lines.number + 1} is no UTF-8, expected a text file") from None
        except ValueError as error:
            raise ValueError(f"line {lines.number}: {str(error).partition(' at row')[0]}") from None
    points = points if points.size else np.empty((0, 2))
    _check_columns(points.shape)
    return points


def _check_names(words: list[str]) -> None:
    """Check the names of columns, which may have a unit: ``x [m]``.

    Raises:
        ValueError: They are others, or in another order.
    """
    names = [re.split(r"[^a-z]", word.strip(" \"'\n").lower())[0] for word in words]
    if names != list(_COLUMNS[: len(names)]):
        found = ", ".join(word.strip()[:20] for word in words[:6])
        raise ValueError(f"names its columns {found}, expected {_COLUMNS[0]}, {_COLUMNS[1]} and perhaps {_COLUMNS[2]}")


class _Lines(Iterator[str]):
    """The lines of a text file, counted, none of them too long.

    Attributes:
        number: Number of the last one read, from 1.
    """

    def __init__(self, file: TextIO) -> None:
        self.number = 0
        self._file = file

    def __next__(self) -> str:
        """Return the next line."""
        line = self._file.readline(_LONGEST_LINE)
        if not line:
            raise StopIteration
        self.number += 1
        if len(line) == _LONGEST_LINE:
            raise ValueError(f"is longer than {_LONGEST_LINE} characters, expected x, z and perhaps a heading")
        return line


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True

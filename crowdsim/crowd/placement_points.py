"""Points of a placement from CSV and NPY files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from crowdsim.core.types import Array
from crowdsim.scenario.groups import PointsPlacement
from crowdsim.scenario.scenario import Scenario

FARTHEST = 100_000.0


def read_points(scenario: Scenario, group: int, placement: PointsPlacement) -> Array:
    """Return a placement's points: x and z [m] and, where the file has it, the heading [degrees]. Shape (M, 2 or 3).

    Raises:
        ScenarioError: The file cannot be read or has another format.
    """
    if placement.file is None:
        return np.array(placement.points or (), dtype=float).reshape(-1, 2)
    path = scenario.folder / placement.file
    try:
        points = _read_npy(path) if path.suffix.lower() == ".npy" else _read_csv(path)
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise ValueError(f"holds an array of shape {points.shape}, expected rows of x, z and perhaps a heading")
        good = np.isfinite(points).all(axis=1) & (np.abs(points[:, :2]) <= FARTHEST).all(axis=1)
        if not good.all():
            row = int(np.argmin(good))
            values = ", ".join(f"{value:g}" for value in points[row])
            raise ValueError(f"row {row + 1} is {values}, expected finite numbers up to {FARTHEST:g} m")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise scenario.error(f"{path}: {reason}", "groups", group, "placement", "file") from None
    return points


def _read_npy(path: Path) -> Array:
    points = np.load(path, allow_pickle=False)
    if not isinstance(points, np.ndarray) or points.dtype.kind not in "fiu":
        raise ValueError("holds no numbers, expected rows of x, z and perhaps a heading")
    return points.astype(float)


def _read_csv(path: Path) -> Array:
    """Read numbers between commas, semicolons or blanks, below a line of names if there is one."""
    with path.open(encoding="utf-8-sig") as file:
        first = file.readline()
    separator = "," if "," in first else ";" if ";" in first else None
    words = first.split(separator)
    skip = 0 if _is_number(words[0]) else 1
    points = np.loadtxt(path, delimiter=separator, skiprows=skip, ndmin=2, encoding="utf-8-sig")
    return points if points.size else np.empty((0, 2))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True

"""What files of floor plans draw, in units of their own."""

from __future__ import annotations

from typing import Any

Line = list[tuple[float, float]]


class PlanError(ValueError):
    """A file is no floor plan; the message says what it holds and what was expected.

    Attributes:
        obstacle: Number of the obstacle in its scenario.
    """

    obstacle = 0


class Sketch:
    """What a file draws, in its own units.

    Attributes:
        walls: Lines, whether they are closed, keys of ``WallObstacle``, and where in the file they are.
        solids: Rings of solid things, the outer one first, keys of ``BoxObstacle``, and where they are.
        discs: Middles, radii, keys of ``DiscObstacle``, and where they are.
        heights: Heights of its positions.
    """

    def __init__(self) -> None:
        self.walls: list[tuple[Line, bool, dict[str, Any], str]] = []
        self.solids: list[tuple[list[Line], dict[str, Any], str]] = []
        self.discs: list[tuple[tuple[float, float], float, dict[str, Any], str]] = []
        self.heights: set[float] = set()

    def points(self) -> Line:
        """Return all points that it draws."""
        found = [point for line, *_ in self.walls for point in line]
        found += [point for rings, *_ in self.solids for ring in rings for point in ring]
        return found + [middle for middle, *_ in self.discs]

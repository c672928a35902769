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
        walls: Lines, whether they are closed, and keys of ``WallObstacle``.
        solids: Outlines of solid things, and keys of ``BoxObstacle``.
        discs: Middles, radii and keys of ``DiscObstacle``.
    """

    def __init__(self) -> None:
        self.walls: list[tuple[Line, bool, dict[str, Any]]] = []
        self.solids: list[tuple[Line, dict[str, Any]]] = []
        self.discs: list[tuple[tuple[float, float], float, dict[str, Any]]] = []

    def points(self) -> Line:
        """Return all points that it draws."""
        found = [point for line, *_ in self.walls for point in line]
        found += [point for line, _ in self.solids for point in line]
        return found + [middle for middle, *_ in self.discs]

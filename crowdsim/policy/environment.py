"""The environment of a behaviour: where its target is, as the avatar sees it, on a grid of named axes (section 4).

The target is a point ``(x, y, z)`` in the avatar's ground frame [m]: +z is ahead, +x to the left, +y up. An axis
measures one quantity of it. Cells are numbered in C order, the last axis fastest. The value of a table between grid
points is multilinear; beyond the range of an axis the measure is clamped, and the behaviour's say fades out
(``fade_factor``).

To add an axis, add it to ``AXIS_KINDS`` with a code of its own, give it a field in ``recipe.Axes`` and a range in
``ranges.resolve_grid``, define what it measures in ``measure`` and in ``measure`` of ``kernels/axes.py``, let
``Grid.targets`` place targets by it, and list it in ``COMPILED``: training knows it then. Control has kernels of its
own: ``SUPPORTED_AXES`` in ``crowd/model.py`` says what they need. An axis that is not listed is refused, never taken
for another one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.errors import RecipeError, nearest

HALFWAY = 0.5
"""A table of Q-values is read for where a moving target will be after so much of an action of mean length."""

LEAD = 1.15
"""Values behind an action are read for where a moving target will be so many mean lengths of an action later still.

They are those of a still target, and who goes after a moving one must be ahead of them (measured on the moving targets
of ``benchmarks/scenes.py``: 0.7 trails them, 1.5 hardly strikes)."""

AXIS_WIDTH = 9
"""Numbers of an axis as compiled code reads it."""


@dataclass(frozen=True)
class AxisKind:
    """One quantity that an axis can measure.

    Attributes:
        code: Number of the kind in compiled code.
        unit: Its unit.
        period: After how much it repeats, or 0 when it does not.
        moves: Whether it changes when the avatar moves over the ground. Kinds that do not come last in a grid, so that
            a Bellman sweep handles all their cells at once.
    """

    code: int
    unit: str
    period: float
    moves: bool


AXIS_KINDS: dict[str, AxisKind] = {
    "distance": AxisKind(0, "m", 0.0, True),
    "bearing": AxisKind(1, "rad", 2.0 * math.pi, True),
    "height": AxisKind(2, "m", 0.0, False),
}
"""Every axis there is, in the order in which a grid holds them, those that move first."""

COMPILED = ("distance", "bearing", "height")
"""Axes that have a branch in ``measure`` of ``kernels/axes.py``, and by which targets are placed."""


@dataclass(frozen=True)
class Axis:
    """One axis of a grid.

    Attributes:
        name: A key of ``AXIS_KINDS``.
        minimum: Where the first grid point lies.
        maximum: Where the last grid point lies; one step after the last one on an axis that wraps.
        count: Number of grid points, at least 1.
        wraps: Whether the axis closes on itself, which needs a range of one period.
        fade: How far beyond the range the behaviour's weight has fallen to nothing, in the axis' unit; 0 never fades.
        stretch: Where the step between grid points has grown to four times that at 0, so that a grid is fine near and
            coarse far: at the value v it is (1 + v / stretch)^2 times as long. 0: all steps are equal.
    """

    name: str
    minimum: float
    maximum: float
    count: int
    wraps: bool = False
    fade: float = 0.0
    stretch: float = 0.0

    @property
    def rate(self) -> float:
        """By how much a value is squeezed: grid points are even in v / (1 + rate v)."""
        return 1.0 / self.stretch if self.stretch > 0.0 else 0.0

    @property
    def first(self) -> float:
        """The first grid point, squeezed."""
        return self.minimum / (1.0 + self.rate * self.minimum)

    @property
    def step(self) -> float:
        """Distance between grid points, squeezed; 1 when there is only one."""
        if self.wraps:
            return (self.maximum - self.minimum) / self.count
        last = self.maximum / (1.0 + self.rate * self.maximum)
        return (last - self.first) / (self.count - 1) if self.count > 1 else 1.0

    @property
    def points(self) -> Array:
        """Where the grid points lie. Shape (count,)."""
        if not self.rate:
            return self.minimum + self.step * np.arange(self.count)
        squeezed = self.first + self.step * np.arange(self.count)
        return squeezed / (1.0 - self.rate * squeezed)

    def places(self, values: ArrayLike) -> Array:
        """Return where values lie on the axis, in grid points from the first one. Shape of ``values``."""
        values = np.asarray(values, dtype=float)
        return np.asarray((values / (1.0 + self.rate * values) - self.first) / self.step)


@dataclass(frozen=True)
class Grid:
    """A grid over the environment; make one with ``build_grid``.

    Attributes:
        axes: The axes in the order of ``AXIS_KINDS``, those that move first, the last one fastest.
    """

    axes: tuple[Axis, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points of each axis."""
        return tuple(axis.count for axis in self.axes)

    @property
    def cells(self) -> int:
        """Number of cells, which are the grid's points."""
        return math.prod(self.shape)

    @property
    def moving_axes(self) -> tuple[Axis, ...]:
        """The leading axes, which change when the avatar moves over the ground."""
        return tuple(axis for axis in self.axes if AXIS_KINDS[axis.name].moves)

    @property
    def layers(self) -> int:
        """Cells of the axes that stay the same when the avatar moves: neighbours of one another in a table."""
        return math.prod(axis.count for axis in self.axes if not AXIS_KINDS[axis.name].moves)

    @property
    def strides(self) -> tuple[int, ...]:
        """How far apart neighbours along each axis lie in a table."""
        return tuple(math.prod(self.shape[place + 1 :]) for place in range(len(self.axes)))

    def pack(self) -> Array:
        """Return the axes as compiled code reads them. Shape (D, 9), float64.

        The columns are the kind's code, first point and step (squeezed), count, whether it wraps, stride in a table,
        fade, minimum, rate.

        Raises:
            RecipeError: An axis is unknown to compiled code.
        """
        self._check_compiled()
        rows = [
            (
                AXIS_KINDS[axis.name].code,
                axis.first,
                axis.step,
                axis.count,
                axis.wraps,
                stride,
                axis.fade,
                axis.minimum,
                axis.rate,
            )
            for axis, stride in zip(self.axes, self.strides, strict=True)
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, AXIS_WIDTH)

    def targets(self) -> Array:
        """Return the target at each cell's grid point, in the ground frame [m]. Shape (cells, 3).

        A grid without a bearing puts it straight ahead, one without a height at 0, one without a distance at 1 m.

        Raises:
            RecipeError: Targets are not placed by an axis.
        """
        self._check_compiled()
        mesh = np.meshgrid(*(axis.points for axis in self.axes), indexing="ij")
        found = {axis.name: values.ravel() for axis, values in zip(self.axes, mesh, strict=True)}
        still = np.zeros(self.cells)
        distance, bearing = found.get("distance", still + 1.0), found.get("bearing", still)
        height = found.get("height", still)
        return np.stack([distance * np.sin(bearing), height, distance * np.cos(bearing)], axis=-1)

    def _check_compiled(self) -> None:
        for axis in self.axes:
            if axis.name not in COMPILED:
                raise RecipeError(f"{axis.name!r} is no axis of training, expected one of {', '.join(COMPILED)}")


def build_grid(axes: Iterable[Axis]) -> Grid:
    """Return a grid of the axes, which may come in any order.

    Raises:
        RecipeError: An axis is unknown, named twice, empty, has no points, or wraps over less than its period.
    """
    axes = list(axes)
    for axis in axes:
        kind = AXIS_KINDS.get(axis.name)
        if kind is None:
            known = ", ".join(AXIS_KINDS)
            raise RecipeError(f"unknown axis {axis.name!r}, expected one of {known}{nearest(axis.name, AXIS_KINDS)}")
        if axis.count < 1 or (axis.wraps and axis.count < 2):
            raise RecipeError(
                f"axis {axis.name!r} has {axis.count} grid points, expected {2 if axis.wraps else 1} or more"
            )
        if axis.count > 1 and not axis.minimum < axis.maximum:
            raise RecipeError(
                f"axis {axis.name!r} reaches from {axis.minimum:g} to {axis.maximum:g}, expected a range upwards"
            )
        if axis.stretch and (axis.wraps or axis.minimum < 0.0):
            raise RecipeError(f"axis {axis.name!r} is stretched, so it must begin at 0 or above and cannot wrap")
        if axis.wraps and abs(axis.maximum - axis.minimum - kind.period) > 1e-6:
            raise RecipeError(f"axis {axis.name!r} wraps, so its range must be {kind.period:g} {kind.unit}")
    order = list(AXIS_KINDS)
    names = [axis.name for axis in axes]
    twice = [name for name in names if names.count(name) > 1]
    if twice or not axes:
        raise RecipeError(f"axis {twice[0]!r} is named twice" if twice else "a grid needs one axis or more")
    if not any(AXIS_KINDS[name].moves for name in names):
        raise RecipeError(
            f"a grid of {', '.join(names)} alone does not see where the target is, expected a distance too"
        )
    return Grid(tuple(sorted(axes, key=lambda axis: (not AXIS_KINDS[axis.name].moves, order.index(axis.name)))))


def measure(name: str, target: ArrayLike) -> Array:
    """Return what the axis ``name`` measures of targets (..., 3) in the ground frame. Shape (...)."""
    x, y, z = np.moveaxis(np.asarray(target, dtype=float), -1, 0)
    if name == "distance":
        return np.hypot(x, z)
    if name == "bearing":
        return np.arctan2(x, z)
    if name == "height":
        return y
    raise RecipeError(f"unknown axis {name!r}, expected one of {', '.join(AXIS_KINDS)}{nearest(name, AXIS_KINDS)}")


def corners(grid: Grid, target: ArrayLike) -> tuple[Array, Array]:
    """Return the cells around one target (3,) and their multilinear weights, which sum to 1. Shapes (2^D,).

    At a grid point one weight is 1 and the others are 0.
    """
    parts = []
    for axis, stride in zip(grid.axes, grid.strides, strict=True):
        place = float(axis.places(measure(axis.name, target)))
        if axis.wraps:
            place %= axis.count
            lower = min(int(place), axis.count - 1)
            upper = (lower + 1) % axis.count
        else:
            place = min(max(place, 0.0), axis.count - 1.0)
            lower = max(min(int(place), axis.count - 2), 0)
            upper = min(lower + 1, axis.count - 1)
        share = place - lower
        parts.append(((lower * stride, 1.0 - share), (upper * stride, share)))
    combined = list(itertools.product(*parts))
    cells = np.array([sum(cell for cell, _ in corner) for corner in combined], dtype=np.int64)
    weights = np.array([math.prod(weight for _, weight in corner) for corner in combined])
    return cells, weights


def fade_factor(grid: Grid, target: ArrayLike) -> float:
    """Return how much a behaviour counts for one target (3,): 1 inside its grid, falling to 0 over each axis' ``fade``.

    Beyond the range the table is clamped and would take a target at 3 m for one at the edge, so its weight must fade.
    The fall is a straight line per axis; axes multiply.
    """
    factor = 1.0
    for axis in grid.axes:
        if axis.wraps or axis.fade <= 0.0:
            continue
        value = float(measure(axis.name, target))
        beyond = max(axis.minimum - value, value - axis.maximum, 0.0)
        factor *= max(0.0, 1.0 - beyond / axis.fade)
    return factor

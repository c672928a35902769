"""The environment of a behaviour: what the avatar sees of its target, on a grid of named axes (section 4).

An axis measures one quantity of the target in the avatar's ground frame (``axes``, a file each). Cells are numbered in
C order, the last axis fastest. The value of a table between grid points is multilinear; beyond the range of an axis the
measure is clamped, and the behaviour's say fades out (``fade_factor``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.errors import RecipeError, nearest
from crowdsim.policy.axes.axis import AxisKind, Target
from crowdsim.policy.axes.registry import NAMES, kind_named
from crowdsim.policy.records import AXIS

HALFWAY = 0.5
"""A table of Q-values is read for where a moving target will be after so much of an action of mean length."""

LEAD = 1.15
"""Values behind an action are read for where a moving target will be so many mean lengths of an action later still.

They are those of a still target, and who goes after a moving one must be ahead of them (measured on the moving targets
of ``benchmarks/scenes.py``: 0.7 trails them, 1.5 hardly strikes)."""

MOST_AXES = 5


@dataclass(frozen=True)
class Axis:
    """One axis of a grid.

    Attributes:
        name: One of ``axes.registry.NAMES``.
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
    def kind(self) -> AxisKind:
        """What it measures."""
        return kind_named(self.name)

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
        axes: The axes in the order of ``AXES``, those over the ground first, the last one fastest.
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
    def ground_axes(self) -> tuple[Axis, ...]:
        """The leading axes, which say where the target is over the ground."""
        return tuple(axis for axis in self.axes if axis.kind.over_ground)

    @property
    def layer_axes(self) -> tuple[Axis, ...]:
        """All others."""
        return self.axes[len(self.ground_axes) :]

    @property
    def layers(self) -> int:
        """Cells of these: neighbours of one another in a table, which a Bellman sweep handles at once."""
        return math.prod(axis.count for axis in self.layer_axes)

    @property
    def changes(self) -> bool:
        """Whether what one of these measures changes while the avatar acts."""
        return any(axis.kind.after is not None for axis in self.layer_axes)

    @property
    def lasts(self) -> float:
        """For how many control frames a target moves in training, where an axis says how; otherwise for ever."""
        return min((axis.kind.lasts for axis in self.layer_axes if axis.kind.lasts is not None), default=math.inf)

    @property
    def moves(self) -> bool:
        """Whether an axis says how the target moves."""
        return self.lasts < math.inf

    @property
    def leads(self) -> tuple[float, float]:
        """How far ahead of a moving target tables of Q and of V are read, in mean lengths of an action.

        A grid that says how the target moves holds values of moving targets, and needs none of this.
        """
        return (0.0, 0.0) if self.moves else (HALFWAY, LEAD)

    @property
    def strides(self) -> tuple[int, ...]:
        """How far apart neighbours along each axis lie in a table."""
        return tuple(math.prod(self.shape[place + 1 :]) for place in range(len(self.axes)))

    def pack(self) -> Array:
        """Return the axes as compiled code reads them. Shape (D,), ``records.AXIS``."""
        records = np.zeros(len(self.axes), AXIS)
        for record, axis, stride in zip(records, self.axes, self.strides, strict=True):
            record["kind"], record["stride"], record["rate"] = NAMES.index(axis.name), stride, axis.rate
            record["first"], record["step"], record["count"] = axis.first, axis.step, axis.count
            record["wraps"], record["fade"] = axis.wraps, axis.fade
            record["minimum"], record["maximum"] = axis.minimum, axis.maximum
        return records

    def observed(self) -> Target:
        """Return the target at each cell's grid point, as arrays (C,); what the grid does not see is ``UNSEEN``."""
        mesh = np.meshgrid(*(axis.points for axis in self.axes), indexing="ij")
        target = Target(*(np.full(self.cells, number) for number in UNSEEN))
        for axis, values in zip(self.axes, mesh, strict=True):
            if axis.kind.beyond is not None:
                values = np.where(values == axis.points[-1], axis.kind.beyond, values)
            target = axis.kind.place(target, values.ravel())
        return target

    def targets(self) -> Array:
        """Return where the target is at each cell's grid point, in the ground frame [m]. Shape (cells, 3)."""
        return np.stack(self.observed()[:3], axis=-1)


UNSEEN = Target(0.0, 0.0, 1.0)
"""A target of which nothing is known: straight ahead, 1 m away."""


def build_grid(axes: Iterable[Axis]) -> Grid:
    """Return a grid of the axes, which may come in any order.

    Raises:
        RecipeError: An axis is unknown, named twice, empty, has no points, or wraps over less than its period.
    """
    axes = list(axes)
    for axis in axes:
        if axis.name not in NAMES:
            known = ", ".join(NAMES)
            raise RecipeError(f"unknown axis {axis.name!r}, expected one of {known}{nearest(axis.name, NAMES)}")
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
        if axis.wraps and abs(axis.maximum - axis.minimum - axis.kind.period) > 1e-6:
            raise RecipeError(f"axis {axis.name!r} wraps, so its range must be {axis.kind.period:g} {axis.kind.unit}")
    names = [axis.name for axis in axes]
    twice = [name for name in names if names.count(name) > 1]
    if twice or not axes:
        raise RecipeError(f"axis {twice[0]!r} is named twice" if twice else "a grid needs one axis or more")
    if len(axes) > MOST_AXES:
        raise RecipeError(f"a grid of {', '.join(names)} has {len(axes)} axes, expected {MOST_AXES} at most")
    if not any(axis.kind.over_ground for axis in axes):
        raise RecipeError(
            f"a grid of {', '.join(names)} alone does not see where the target is, expected a distance too"
        )
    return Grid(tuple(sorted(axes, key=lambda axis: NAMES.index(axis.name))))


def fade_factor(grid: Grid, target: ArrayLike) -> float:
    """Return how much a behaviour counts for one target: 1 inside its grid, falling to 0 over each axis' ``fade``.

    Beyond the range the table is clamped and would take a target at 3 m for one at the edge, so its weight must fade.
    The fall is a straight line per axis; axes multiply. The target has the numbers of a ``Target`` that the grid sees.
    """
    factor, seen = 1.0, Target(*np.asarray(target, dtype=float).tolist())
    for axis in grid.axes:
        if axis.wraps or axis.fade <= 0.0:
            continue
        value = axis.kind.value(seen)
        beyond = max(axis.minimum - value, value - axis.maximum, 0.0)
        factor *= max(0.0, 1.0 - beyond / axis.fade)
    return factor

"""What an axis is: a quantity that is observed of a target."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from crowdsim.core.types import Array

UNSEEN_STRIKE = 1e6
"""Control frames until a strike reaches furthest where none is seen: more than any that is."""


class Target(NamedTuple):
    """A target in the avatar's ground frame; outside compiled code, also many of them, as arrays.

    Attributes:
        x: Where its head is, to the left [m].
        y: Upwards.
        z: Ahead.
        vx: How far it moves in a control frame, to the left [m].
        vz: Ahead.
        heading: Which way it faces, 0 as the avatar does, to the left is positive [rad].
        impact: Control frames until its strike reaches furthest; ``UNSEEN_STRIKE`` where none is seen.
        lasts: For how many control frames it moves so; then it stands.
    """

    x: Any
    y: Any
    z: Any
    vx: Any = 0.0
    vz: Any = 0.0
    heading: Any = 0.0
    impact: Any = UNSEEN_STRIKE
    lasts: Any = math.inf

    def mirrored(self) -> Target:
        """Return the target as a mirror straight ahead shows it."""
        return self._replace(x=-self.x, vx=-self.vx, heading=-self.heading)


class End(NamedTuple):
    """What axes change by while an avatar does an action; compiled code may pass a record with these fields instead.

    Attributes:
        turn: How far the avatar turns, to the left is positive [rad].
        frames: Control frames that the action takes.
        side: -1 where the target is seen as in a mirror afterwards, else 1.
    """

    turn: Any
    frames: Any
    side: Any = 1.0


@dataclass(frozen=True)
class AxisKind:
    """One quantity that an axis can measure.

    Attributes:
        name: What a recipe calls it.
        unit: Its unit.
        description: What it is, for people who write recipes.
        observed: What control observes, for their reference page.
        trained: How it develops in training while an action runs, likewise.
        measure: Inlined kernel that returns it for a target (``Target``, or any tuple with these names).
        place: Returns targets of which it has some values, all else being that of given targets.
        lowest: Returns the first grid point where a recipe names none, of the motion (``training.ranges.Observed``).
        highest: Returns the last one.
        over_ground: Whether it depends on where the target is over the ground. All axes that do come before all others
            in a grid, and are those that sweeps and control find for many targets at once: distance and bearing.
        after: Inlined kernel that returns what it measures after an action, from what it measures before and ``End``;
            None where that does not change.
        period: After how much it repeats, or 0 when it does not.
        time: Power of time in its unit. A recipe counts seconds, a grid control frames.
        beyond: What its last grid point stands for besides its own value, and is learned for; None: nothing else.
        lasts: Of an axis that says how the target moves: for how many control frames it does so in training. Values are
            not those of a target at rest then. None for any other axis.
        bounds: Least and greatest value that a recipe may name, in its unit.
    """

    name: str
    unit: str
    description: str
    observed: str
    trained: str
    measure: Any
    place: Callable[[Target, Array], Target]
    lowest: Callable[[Any], float]
    highest: Callable[[Any], float]
    over_ground: bool = False
    after: Any = None
    period: float = 0.0
    time: int = 0
    beyond: float | None = None
    lasts: float | None = None
    bounds: tuple[float, float] = (-math.inf, math.inf)

    def grid_units(self, rate: float) -> float:
        """Return what one of its unit is in a grid, at a control rate [1/s]."""
        return rate**self.time

    def value(self, target: Target) -> float:
        """Return what it measures of a target, outside compiled code."""
        return float(getattr(self.measure, "py_func", self.measure)(target))

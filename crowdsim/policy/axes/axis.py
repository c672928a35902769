"""What an axis is: a quantity that is observed of a target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from crowdsim.core.types import Array


class Target(NamedTuple):
    """A target in the avatar's ground frame; outside compiled code, also many of them, as arrays.

    Attributes:
        x: Where its head is, to the left [m].
        y: Upwards.
        z: Ahead.
        vx: How far it moves in a control frame, to the left [m].
        vz: Ahead.
        heading: Which way it faces, 0 as the avatar does, to the left is positive [rad].
    """

    x: Any
    y: Any
    z: Any
    vx: Any = 0.0
    vz: Any = 0.0
    heading: Any = 0.0

    def mirrored(self) -> Target:
        """Return the target as a mirror straight ahead shows it."""
        return Target(-self.x, self.y, self.z, -self.vx, self.vz, -self.heading)


@dataclass(frozen=True)
class AxisKind:
    """One quantity that an axis can measure.

    Attributes:
        name: What a recipe calls it.
        unit: Its unit.
        description: What it is, for people who write recipes.
        measure: Inlined kernel that returns it for a target (``Target``, or any tuple with these names).
        place: Returns targets of which it has some values, all else being that of given targets.
        lowest: Returns the first grid point where a recipe names none, of the motion (``training.ranges.Observed``).
        highest: Returns the last one.
        over_ground: Whether it depends on where the target is over the ground. All axes that do come before all others
            in a grid, and are those that sweeps and control find for many targets at once: distance and bearing.
        turns: Whether it changes when the avatar turns, though not when it moves.
        period: After how much it repeats, or 0 when it does not.
    """

    name: str
    unit: str
    description: str
    measure: Any
    place: Callable[[Target, Array], Target]
    lowest: Callable[[Any], float]
    highest: Callable[[Any], float]
    over_ground: bool = False
    turns: bool = False
    period: float = 0.0

    def value(self, target: Target) -> float:
        """Return what it measures of a target, outside compiled code."""
        return float(getattr(self.measure, "py_func", self.measure)(target))

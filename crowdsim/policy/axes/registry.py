"""Every axis there is.

To add one, write its file beside this one and put it into ``AXES``: recipes, training, control and judging know it
then. What it measures must be among what is known of a ``Target``; control observes that in ``crowd.kernels``.
Wherever the target is, ``AxisKind.after`` says what becomes of it while an action runs.
"""

from __future__ import annotations

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind
from crowdsim.policy.axes.bearing import KIND as BEARING
from crowdsim.policy.axes.distance import KIND as DISTANCE
from crowdsim.policy.axes.heading import KIND as HEADING
from crowdsim.policy.axes.height import KIND as HEIGHT
from crowdsim.policy.axes.impact import KIND as IMPACT
from crowdsim.policy.axes.velocity import KIND as VELOCITY
from crowdsim.policy.dispatch_kernels import for_kinds

AXES: tuple[AxisKind, ...] = (DISTANCE, BEARING, HEIGHT, HEADING, VELOCITY, IMPACT)
"""Every axis, in the order in which a grid holds them, those over the ground first. Its place is its kind in a
record."""

NAMES = tuple(kind.name for kind in AXES)

GROUND = sum(kind.over_ground for kind in AXES)
"""How many of them are over the ground: those of lesser kinds."""


def kind_named(name: str) -> AxisKind:
    """Return the axis that a recipe calls ``name``."""
    return AXES[NAMES.index(name)]


@kernel(inline=True)
def _stays(value, end):
    """Return a value that does not change while an avatar acts."""
    return value


measure = for_kinds((kind, f"measure_{axis.name}", axis.measure) for kind, axis in enumerate(AXES))
"""Kernel: what an axis of a kind measures of a target, ``measure(kind, target)``."""

after = for_kinds((kind, f"follow_{axis.name}", axis.after or _stays) for kind, axis in enumerate(AXES))
"""Kernel: what it measures after an action, ``after(kind, value, end)``, see ``AxisKind.after``."""

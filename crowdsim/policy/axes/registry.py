"""Every axis there is.

To add one, write its file beside this one and put it into ``AXES``: recipes, training, control and judging know it
then. What it measures must be among what is known of a ``Target``; control observes that in ``crowd.kernels``.
Wherever the target is, ``AxisKind.after`` says what becomes of it while an action runs.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind
from crowdsim.policy.axes.bearing import KIND as BEARING
from crowdsim.policy.axes.distance import KIND as DISTANCE
from crowdsim.policy.axes.heading import KIND as HEADING
from crowdsim.policy.axes.height import KIND as HEIGHT
from crowdsim.policy.axes.impact import KIND as IMPACT
from crowdsim.policy.axes.velocity import KIND as VELOCITY

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


def _either(kind: int, does: str, own: Any, others: Any) -> Any:
    """Return a kernel that calls one kernel for a kind of axis, and another one for all other kinds."""

    def call(given, *arguments):  # type: ignore[no-untyped-def]
        if given == kind:
            return own(*arguments)
        return others(given, *arguments)

    def call_own(given, *arguments):  # type: ignore[no-untyped-def]
        return own(*arguments)

    return kernel(call_own if others is None else call, inline=True, name=f"{does}_{NAMES[kind]}_or_others")


def _for_each(does: str, kernels: Iterable[Any]) -> Any:
    """Return a kernel that does for an axis of any kind what the kernel of its kind does."""
    chosen = None
    for kind, own in enumerate(kernels):
        chosen = _either(kind, does, own, chosen)
    return chosen


measure = _for_each("measure", [axis.measure for axis in AXES])
"""Kernel: what an axis of a kind measures of a target, ``measure(kind, target)``."""

after = _for_each("follow", [axis.after or _stays for axis in AXES])
"""Kernel: what it measures after an action, ``after(kind, value, end)``, see ``AxisKind.after``."""

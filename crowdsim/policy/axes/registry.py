"""Every axis there is.

To add one, write its file beside this one and put it into ``AXES``: recipes, training, control and judging know it
then. What it measures must be among what is known of a ``Target``; control observes that in ``crowd.kernels``.
"""

from __future__ import annotations

from typing import Any

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind
from crowdsim.policy.axes.bearing import KIND as BEARING
from crowdsim.policy.axes.distance import KIND as DISTANCE
from crowdsim.policy.axes.heading import KIND as HEADING
from crowdsim.policy.axes.height import KIND as HEIGHT

AXES: tuple[AxisKind, ...] = (DISTANCE, BEARING, HEIGHT, HEADING)
"""Every axis, in the order in which a grid holds them, those over the ground first. Its place is its kind in a
record."""

NAMES = tuple(kind.name for kind in AXES)


def kind_named(name: str) -> AxisKind:
    """Return the axis that a recipe calls ``name``."""
    return AXES[NAMES.index(name)]


def _either(kind: int, own: Any, others: Any) -> Any:
    """Return a kernel that measures one kind of axis by a kernel, and all others by another one."""

    def call(given, target):  # type: ignore[no-untyped-def]
        if given == kind:
            return own(target)
        return others(given, target)

    def call_own(given, target):  # type: ignore[no-untyped-def]
        return own(target)

    return kernel(call_own if others is None else call, inline=True, name=f"measure_{NAMES[kind]}_or_others")


def _measures() -> Any:
    """Return a kernel that measures an axis of any kind of a target."""
    chosen = None
    for kind, axis in enumerate(AXES):
        chosen = _either(kind, axis.measure, chosen)
    return chosen


measure = _measures()
"""Kernel: what an axis of a kind measures of a target, ``measure(kind, target)``."""

"""Which way the target faces."""

from __future__ import annotations

import math

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind


@kernel(inline=True)
def measure(target):
    """Return the heading of a target [rad]: 0 where it faces as the avatar does, to the left is positive."""
    return target.heading


KIND = AxisKind(
    name="heading",
    unit="rad",
    description="Which way it faces; 0 as the avatar does, to the left is positive [rad].",
    measure=measure,
    place=lambda target, heading: target._replace(heading=heading),
    lowest=lambda motion: -math.pi,
    highest=lambda motion: math.pi,
    turns=True,
    period=2.0 * math.pi,
)

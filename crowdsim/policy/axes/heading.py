"""Which way the target faces."""

from __future__ import annotations

import math

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind


@kernel(inline=True)
def measure(target):
    """Return the heading of a target [rad]: 0 where it faces as the avatar does, to the left is positive."""
    return target.heading


@kernel(inline=True)
def after(heading, end):
    """Return the heading of a target once the avatar has turned [rad]."""
    return end.side * (heading - end.turn)


KIND = AxisKind(
    name="heading",
    unit="rad",
    description="Which way it faces; 0 as the avatar does, to the left is positive [rad].",
    observed="The heading of the opponent; where a scripted target moves to.",
    trained="The target's stays, and the avatar turns.",
    measure=measure,
    place=lambda target, heading: target._replace(heading=heading),
    lowest=lambda motion: -math.pi,
    highest=lambda motion: math.pi,
    after=after,
    period=2.0 * math.pi,
)

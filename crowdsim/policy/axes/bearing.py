"""In which direction the target is."""

from __future__ import annotations

import math

import numpy as np

from crowdsim.core.mathematics import atan2
from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind, Target


@kernel(inline=True)
def measure(target):
    """Return the bearing of a target [rad]: 0 ahead, to the left is positive."""
    return atan2(target.x, target.z)


def place(target: Target, bearing: Array) -> Target:
    """Return targets in some directions, at the same distances."""
    distance = np.hypot(target.x, target.z)
    return target._replace(x=distance * np.sin(bearing), z=distance * np.cos(bearing))


KIND = AxisKind(
    name="bearing",
    unit="rad",
    description="In which direction it is; 0 ahead, to the left is positive [rad].",
    observed="As the distance.",
    trained="As the distance, and the avatar turns.",
    measure=measure,
    place=place,
    lowest=lambda motion: -math.pi,
    highest=lambda motion: math.pi,
    over_ground=True,
    period=2.0 * math.pi,
)

"""How far away the target is over the ground."""

from __future__ import annotations

import math

import numpy as np

from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind, Target


@kernel(inline=True)
def measure(target):
    """Return the distance of a target [m]."""
    return math.sqrt(target.x * target.x + target.z * target.z)


def place(target: Target, distance: Array) -> Target:
    """Return targets at some distances, in the same directions."""
    bearing = np.arctan2(target.x, target.z)
    return target._replace(x=distance * np.sin(bearing), z=distance * np.cos(bearing))


KIND = AxisKind(
    name="distance",
    unit="m",
    description="How far away the target is over the ground [m].",
    observed="Where the opponent's head is, and where it will be when its action ends.",
    trained="The target is at rest, or moves as `target` says; the avatar's action leads to it or away.",
    measure=measure,
    place=place,
    lowest=lambda motion: 0.0,
    highest=lambda motion: motion.beyond_strikes(),
    over_ground=True,
)

"""How fast the target goes away, along the line of sight.

Control observes the opponent's mean velocity up to the end of its action. In training the target of a cell goes on so
for ``LASTS`` control frames, the mean for opponents that are seen in the middle of an action, and then stands. What is
left of the velocity behind the avatar's action is ``KEPT`` of it for each control frame: what a first-order
autoregression expects. Both numbers were measured at the decisions of 30 shipped boxers in 60 s of a brawl.
"""

from __future__ import annotations

import math

import numpy as np

from crowdsim.core.mathematics import exp
from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind, Target

KEPT = 0.6
"""Share of a velocity that is left a control frame later."""

_LOG_KEPT = -0.5108256237659907

LASTS = 3.0
"""For how many control frames a target goes on as it does."""


@kernel(inline=True)
def measure(target):
    """Return how far a target goes away in a control frame [m]; negative where it comes nearer."""
    distance = math.sqrt(target.x * target.x + target.z * target.z)
    return (target.x * target.vx + target.z * target.vz) / max(distance, 1e-9)


def place(target: Target, velocity: Array) -> Target:
    """Return targets that go away for some time, where they are."""
    bearing = np.arctan2(target.x, target.z)
    vx, vz = velocity * np.sin(bearing), velocity * np.cos(bearing)
    return target._replace(vx=vx, vz=vz, lasts=np.full_like(velocity, LASTS))


@kernel(inline=True)
def after(velocity, end):
    """Return what is expected of a velocity after an action."""
    return velocity * exp(_LOG_KEPT * end.frames)


KIND = AxisKind(
    name="velocity",
    unit="m/s",
    description="How fast it goes away along the line of sight; negative where it comes nearer [m/s].",
    observed="The mean velocity of the opponent's head to the end of its action.",
    trained=f"The target goes on for {LASTS:g} control frames, then stands; {KEPT:g} of what it observes is left for "
    "each control frame of the action.",
    measure=measure,
    place=place,
    lowest=lambda motion: -motion.pace(),
    highest=lambda motion: motion.pace(),
    after=after,
    time=-1,
    lasts=LASTS,
    bounds=(-10.0, 10.0),
)

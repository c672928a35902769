"""How high the target's head is."""

from __future__ import annotations

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import AxisKind


@kernel(inline=True)
def measure(target):
    """Return the height of a target's head [m]."""
    return target.y


KIND = AxisKind(
    name="height",
    unit="m",
    description="How high its head is [m].",
    observed="The height of the opponent's head, for a body of the avatar's size.",
    trained="It stays.",
    measure=measure,
    place=lambda target, height: target._replace(y=height),
    lowest=lambda motion: motion.head_heights()[0],
    highest=lambda motion: motion.head_heights()[1],
)

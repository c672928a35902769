"""How soon a strike of the target reaches furthest.

Control observes the next strike in progress that ends near the avatar, as the behaviour ``defend`` does: of what an
opponent has decided nothing is seen within the reaction time. In training time runs: an action takes from it as long as
it lasts. Once the strike has reached furthest, and where none is seen, the last grid point counts: no strike is
expected.
"""

from __future__ import annotations

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, AxisKind


@kernel(inline=True)
def measure(target):
    """Return how soon a strike of a target reaches furthest [control frames]."""
    return target.impact


@kernel(inline=True)
def after(impact, end):
    """Return how soon it does after an action; a strike that is over is one that is not seen."""
    left = impact - end.frames
    return left if left > 0.0 else UNSEEN_STRIKE


KIND = AxisKind(
    name="impact",
    unit="s",
    description="How soon its strike reaches furthest; the last grid point also stands for no strike [s].",
    observed="The next strike in progress, of its opponent or of another attacker, that ends within 0.8 m of the "
    "avatar; once the reaction time is over.",
    trained="Time runs. A strike that is over is followed by none: the last grid point, which stands for no strike.",
    measure=measure,
    place=lambda target, impact: target._replace(impact=impact),
    lowest=lambda motion: 0.0,
    highest=lambda motion: motion.longest_warning(),
    after=after,
    time=1,
    beyond=UNSEEN_STRIKE,
    bounds=(0.0, 10.0),
)

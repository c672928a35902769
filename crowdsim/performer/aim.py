"""How a punch of the embedded boxer fits its target: what body and fist do for a near, a far or a low one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.performer.moves import Part, Punch
from crowdsim.performer.score import REAR, Channel

ELBOWS = frozenset({Channel.LEAD_ELBOW, Channel.REAR_ELBOW})
ARMS = frozenset(channel for channel in Channel if channel >= Channel.LEAD_FORTH)
"""Channels of shoulders, elbows and fists, which are quicker than all that carries them."""
_WOUND = {Channel.PELVIS_TURN: 0.2, Channel.TWIST: 0.2, Channel.LEAD_ARC: 0.8, Channel.REAR_ARC: 0.8}
"""What is left of winding up when the punch before has turned the body already."""
_LOADS = frozenset({Channel.LEAD_HAND_Y, Channel.REAR_HAND_Y, Channel.LEAD_SWING_Y, Channel.REAR_SWING_Y})
"""Channels by which an uppercut dips before it rises, the less the lower it is aimed."""
_DRAWS = (((Channel.LEAD_HAND_X, -0.06), (Channel.LEAD_HAND_Z, -0.20)), ((Channel.REAR_HAND_Z, -0.14),))
"""How each fist is drawn in before it strikes at close quarters [m]."""
_LOW = 1.34
"""Height of a target under which trunk and knees go down to it [m]."""
_ARMS_LENGTH = 0.90
"""Distance of a target from the pelvis from which on the trunk has to lean out to it [m]."""


@dataclass(frozen=True)
class Aim:
    """A punch and its target, seen from the pelvis with the stance's heading.

    Attributes:
        recipe: The punch.
        bearing: Of the target [rad].
        distance: Of the target over the ground [m].
        height: Of the target over the floor [m].
    """

    recipe: Punch
    bearing: float
    distance: float
    height: float

    def share(self, part: Part, wound: bool) -> float:
        """Return how much of a part of the punch is played; ``wound`` where the punch before turned the body."""
        size = 1.0
        if wound and part.start < 0.0 and part.end < 1.2:
            size *= _WOUND.get(part.channel, 1.0)
        if part.channel in ELBOWS and part.size > 1.0:
            size *= 1.0 - self._low
        if part.channel in _LOADS and part.size < 0.0:
            size *= 1.0 - 1.8 * self._low
        return size

    def trunk(self) -> tuple[tuple[Channel, float], ...]:
        """Return what brings trunk and knees to the target: turned to it, down to a low one, out to a far one.

        At close quarters the hips come forward, and the trunk leans back to make room for the fist.
        """
        least, most = self.recipe.distance
        far = float(np.clip(2.0 * (self.distance - least) / (most - least) - 1.0, -1.0, 1.0))
        near = float(np.clip((least - self.distance) / 0.25, 0.0, 1.0))
        lunge = float(np.clip((self.distance - _ARMS_LENGTH) / 0.17, 0.0, 1.0))
        turn = 1.0 if self.recipe.hand == REAR else -1.0
        low = self._low
        return (
            (Channel.PELVIS_TURN, 0.35 * self.bearing),
            (Channel.TWIST, 0.35 * self.bearing + 0.06 * turn * far),
            (Channel.HEAD_TURN, 0.5 * self.bearing),
            (Channel.PELVIS_TILT, 0.08 * lunge - 0.12 * near),
            (Channel.HEIGHT, -0.42 * low - 0.05 * lunge),
            (Channel.FLEX, (0.60 - 0.3 * near) * low + 0.05 * far + 0.32 * lunge - 0.26 * near),
            (Channel.BEND, -0.22 * low * turn),
            (Channel.SHIFT_Z, 0.02 * far + 0.03 * near),
            (Channel.HEAD_NOD, 0.25 * low),
            (Channel.REAR_HEEL, 0.5 * low),
        )

    def draws(self) -> tuple[tuple[Channel, float], ...]:
        """Return what draws the fist in before it moves out to a near target."""
        least, _ = self.recipe.distance
        if self.recipe.inside >= least:
            return ()
        drawn = float(np.clip((least + 0.12 - self.distance) / 0.30, 0.0, 1.0))
        return tuple((channel, size * drawn) for channel, size in _DRAWS[self.recipe.hand])

    @property
    def _low(self) -> float:
        """How far the target lies under where a guard looks [m]."""
        return max(_LOW - self.height, 0.0)

"""What a run records: variables of every frame and avatar, and strikes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.layout import LANDED, MISSED

OUTCOMES = ("missed", "landed", "blocked", "evaded")
"""What becomes of a strike, by number."""

VARIABLES = ("action", "action_frame", "x", "z", "heading", "opponent")
"""What is recorded for every control frame and avatar, in this order."""


@dataclass(frozen=True)
class Events:
    """Strikes thrown, in the order of time, then of attackers; S strikes.

    Attributes:
        frame: When, in control frames from the start, between frames too. Shape (S,), float32 in a take.
        attacker: Avatar that struck. Shape (S,), int32.
        victim: Its opponent, an avatar or ``-2 - target``; -1 for none. Shape (S,), int32.
        hand: Side of the limb, 0 left, 1 right. Shape (S,), uint8.
        point: Where what strikes was, of a strike that was blocked where it met the arm [m]. Shape (S, 3), float32.
        speed: Its highest speed before [m/s]. Shape (S,), float32.
        landed: Whether it landed. Shape (S,), bool.
        limb: Number of ``strikers.LIMBS``; hands where it is not given. Shape (S,), uint8.
        outcome: Index into ``OUTCOMES``; where it is not given, as ``landed`` says. Shape (S,), uint8.
        damage: What it took from its victim's health [points]; 0 where it is not given. Shape (S,), float32.
        down: Whether it knocked its victim down; not where it is not given. Shape (S,), bool.
    """

    frame: Array
    attacker: Array
    victim: Array
    hand: Array
    point: Array
    speed: Array
    landed: Array
    limb: Array = None  # type: ignore[assignment]
    outcome: Array = None  # type: ignore[assignment]
    damage: Array = None  # type: ignore[assignment]
    down: Array = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.limb is None:
            object.__setattr__(self, "limb", self.hand)
        if self.outcome is None:
            object.__setattr__(
                self, "outcome", np.where(np.asarray(self.landed, bool), LANDED, MISSED).astype(np.uint8)
            )
        if self.damage is None:
            object.__setattr__(self, "damage", np.zeros(len(self.landed), np.float32))
        if self.down is None:
            object.__setattr__(self, "down", np.zeros(len(self.landed), bool))

"""Settings of a recipe that say what is found in motion."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from crowdsim.config.files import StrictModel
from crowdsim.motion.strikes import HANDS, LIMBS


class StrikeSettings(StrictModel):
    """The ``strikes`` section of a recipe: what counts as a strike."""

    limbs: list[Literal["hands", "feet", "left_hand", "right_hand", "left_foot", "right_foot"]] = Field(
        default=["hands"],
        min_length=1,
        description="Limbs whose strikes are found in the motion, rewarded, and land; those of feet are kicks. Mirror "
        "images have those of the other side.",
    )

    def numbers(self) -> tuple[int, ...]:
        """Return them as numbers of ``strikes.LIMBS``, ascending."""
        pairs = ["hands" if number in HANDS else "feet" for number in range(len(LIMBS))]
        return tuple(n for n, limb in enumerate(LIMBS) if limb in self.limbs or pairs[n] in self.limbs)

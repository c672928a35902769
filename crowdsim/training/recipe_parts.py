"""Sections of a recipe on what avatars do beside the behaviours that they learn from rewards."""

from __future__ import annotations

from pydantic import Field

from crowdsim.config.files import StrictModel
from crowdsim.training.motion_source import MAXIMUM_SEED


class DefenceSpec(StrictModel):
    """How the behaviour ``defend`` is learned: in fights of pairs of avatars with the recipe's other behaviours."""

    rounds: int = Field(
        default=4,
        ge=1,
        le=100,
        description="Rounds of fights; in all but the first, one of each pair defends itself.",
    )
    pairs: int = Field(default=192, ge=1, le=200, description="Pairs that fight at a time.")
    seconds: float = Field(default=900.0, ge=10.0, le=100_000.0, description="How long each round lasts [s].")
    temperature: float = Field(
        default=0.5, ge=0.0, le=100.0, description="Randomness of the draw of those that learn, see the type's key."
    )
    counter: float = Field(
        default=0.1, ge=0.0, le=10.0, description="What a hit is worth that an avatar lands, over one that it takes."
    )
    seed: int = Field(default=0, ge=0, le=MAXIMUM_SEED, description="Seed of the fights.")


class RestSpec(StrictModel):
    """How avatars rest that need not fight: they stand at ease, by what the motion holds of that."""

    seconds: float = Field(
        default=1.0,
        ge=0.2,
        le=10.0,
        description="About how long avatars at ease go on before they decide anew [s].",
    )

"""What fights take from avatars of a type, and what ends a run early."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, StrictModel

Points = Annotated[float, Field(gt=0, le=1_000_000)]
Share = Annotated[float, Field(ge=0, le=10)]
PerMove = Annotated[float, Field(ge=0, le=1)]


class Damage(StrictModel):
    """What strikes that land take from an avatar, and what that leads to."""

    health: Points = Field(
        default=100.0, description="Health at the start [points]. At 0 an avatar goes down for good."
    )
    hit: Points = Field(
        default=6.0,
        description="What a strong hit to the head takes [points]; a hit is as strong as its speed over that which a "
        "quarter of the policy's strikes reach.",
    )
    body: Share = Field(default=0.6, description="What a hit to the body takes, as a share of one to the head.")
    blocked: Share = Field(default=0.1, description="What a blocked strike takes, as a share of one that lands.")
    stagger: Points = Field(
        default=8.0, description="Hits that take so much within 2 s make an avatar stagger [points]."
    )
    knock_down: Points = Field(default=16.0, description="Hits that take so much within 2 s knock it down [points].")
    count: float = Field(default=4.0, ge=0, le=3600, description="For how long it lies before it gets up [s].")
    downs: int = Field(default=3, ge=1, le=1000, description="With how many knock-downs it stays down.")


class Stamina(StrictModel):
    """What tires an avatar; one that is exhausted strikes at a quarter of its tempo."""

    strike: PerMove = Field(default=0.02, description="What a strike takes, as a share of all stamina.")
    metre: PerMove = Field(default=0.01, description="What a metre takes that it moves.")
    rest: PerMove = Field(default=0.02, description="What a second restores.")


class CountEnd(StrictModel):
    """A number that ends the run when it is reached."""

    down: int | None = Field(
        default=None, ge=1, le=10_000_000, description="Number of avatars that have gone down for good."
    )
    landed: int | None = Field(default=None, ge=1, le=1_000_000_000, description="Number of strikes that have landed.")

    @model_validator(mode="after")
    def _check(self) -> CountEnd:
        if (self.down is None) == (self.landed is None):
            both = "both 'down' and" if self.down is not None else "neither 'down' nor"
            raise Fault(f"has {both} 'landed', expected one of them")
        return self


End = Literal["last_standing", "last_team"] | CountEnd

LINGERS = 3.0
"""For how long a run goes on after its end is decided, so that the last fall is seen [s]."""

"""Numbers that are drawn for each avatar: factors about 1, and quantities with a unit."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from crowdsim.config.files import Fault, StrictModel


class Uniform(StrictModel):
    """A factor spread evenly over a range."""

    kind: Literal["uniform"] = Field(description="Spread evenly from `minimum` to `maximum`.")
    minimum: float = Field(gt=0, description="Least factor.")
    maximum: float = Field(gt=0, description="Greatest factor.")

    @model_validator(mode="after")
    def _check(self) -> Uniform:
        if self.minimum > self.maximum:
            raise Fault(f"is {self.minimum}, expected at most the maximum, {self.maximum}", "minimum")
        return self

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest number that can be drawn."""
        return self.minimum, self.maximum

    @property
    def middle(self) -> float:
        """Mean of what is drawn."""
        return 0.5 * (self.minimum + self.maximum)


class Normal(StrictModel):
    """A factor of the normal distribution, cut off at two deviations."""

    kind: Literal["normal"] = Field(description="Normally distributed, cut off at two deviations.")
    mean: float = Field(default=1.0, gt=0, description="Mean factor.")
    deviation: float = Field(ge=0, description="Standard deviation.")

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest number that can be drawn."""
        return self.mean - 2 * self.deviation, self.mean + 2 * self.deviation

    @property
    def middle(self) -> float:
        """Mean of what is drawn."""
        return self.mean


class UniformQuantity(Uniform):
    """A quantity spread evenly over a range."""

    minimum: float = Field(description="Least quantity.")
    maximum: float = Field(description="Greatest quantity.")


class NormalQuantity(Normal):
    """A quantity of the normal distribution, cut off at two deviations."""

    mean: float = Field(description="Mean quantity.")


Spread = Annotated[Uniform | Normal, Field(discriminator="kind")]
QuantitySpread = Annotated[UniformQuantity | NormalQuantity, Field(discriminator="kind")]
Distribution = float | Uniform | Normal


def limits(distribution: Distribution) -> tuple[float, float]:
    """Return the least and the greatest number of a distribution; a number alone is both."""
    return (distribution, distribution) if isinstance(distribution, float | int) else distribution.limits


def middle(distribution: Distribution) -> float:
    """Return the mean of a distribution; a number alone is its own."""
    return float(distribution) if isinstance(distribution, float | int) else distribution.middle

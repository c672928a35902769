"""Being near the target: gamma^t exp(-d(t) / sigma), summed over the action's frames, or the greatest.

d(t) is how far the target is from where it is wanted: at a distance, or between two, from the avatar; anywhere around
it, or straight ahead.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal, NamedTuple

from pydantic import Field, model_validator

from crowdsim.config.files import Fault
from crowdsim.jit import kernel
from crowdsim.policy.terms.term import Metres, TargetBody, Term


class Band(NamedTuple):
    """Where a target is wanted; in one precision.

    Attributes:
        nearest: Least distance [m].
        furthest: Greatest.
        facing: Whether it is measured straight ahead.
        aside: With ``facing``, how far to the side is as good [m].
        shrink: 1 / sigma [1/m].
    """

    nearest: Any
    furthest: Any
    facing: bool
    aside: Any
    shrink: Any


@kernel(inline=True)
def read(term, number):
    """Return the band of a record."""
    facing, shrink = term.facing != 0.0, 1.0 / term.sigma
    return Band(number(term.nearest), number(term.furthest), facing, number(term.aside), number(shrink))


@kernel(inline=True)
def gap(seen, band):
    """Return how far a target is from its band, in sigmas."""
    if band.facing:
        ahead = seen.dx * seen.sin + seen.dz * seen.cos
        ahead -= min(max(ahead, band.nearest), band.furthest)
        aside = max(abs(seen.dx * seen.cos - seen.dz * seen.sin), band.aside) - band.aside
        return math.sqrt(ahead * ahead + aside * aside) * band.shrink
    far = math.sqrt(seen.dx * seen.dx + seen.dz * seen.dz)
    return abs(far - min(max(far, band.nearest), band.furthest)) * band.shrink


class ProximityTerm(Term):
    """Being near the target."""

    numbers: ClassVar[tuple[str, ...]] = ("nearest", "furthest", "sigma", "greatest", "facing", "aside")
    at_frames: ClassVar[tuple[Any, Any] | None] = (read, gap)

    kind: Literal["proximity"]
    distance: Metres | tuple[Metres, Metres] | None = Field(
        default=None,
        description="Where the target is wanted: this far away, or between two distances; null: where strikes reach "
        "it, by the data [m].",
    )
    sigma: float = Field(default=0.5, gt=0.0, description="How fast the reward falls with the distance from there [m].")
    form: Literal["sum", "max"] = Field(
        default="sum", description="Summed over the action's frames, or their greatest."
    )
    facing: bool = Field(
        default=False, description="Whether the target is wanted straight ahead, rather than anywhere round."
    )
    aside: float = Field(
        default=0.0, ge=0.0, description="With facing: how far to the side of straight ahead is as good [m]."
    )

    @model_validator(mode="after")
    def _upwards(self) -> ProximityTerm:
        if isinstance(self.distance, tuple) and self.distance[0] > self.distance[1]:
            raise Fault(f"is {list(self.distance)}, expected the nearer distance first", "distance")
        return self

    @property
    def between(self) -> tuple[float, float]:
        """Least and greatest distance at which the target is wanted [m]."""
        if self.distance is None:
            raise ValueError("the distance is not known yet; see ranges.resolve_terms")
        return self.distance if isinstance(self.distance, tuple) else (self.distance, self.distance)

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return the numbers of its record."""
        return (*self.between, self.sigma, float(self.form == "max"), float(self.facing), self.aside)

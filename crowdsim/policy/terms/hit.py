"""Being hit: what it costs to be where the target's strike lands, at the moment when it reaches furthest.

The strike reaches furthest at the time that the axis ``impact`` observes, and lands on an avatar that is then between
two distances from the target; further away or nearer, it costs gamma^t exp(-d / sigma), d from there.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal, NamedTuple

from pydantic import Field, model_validator

from crowdsim.config.files import Fault
from crowdsim.jit import kernel
from crowdsim.policy.terms.term import Metres, TargetBody, Term

_NEVER = 100.0
"""How far from being hit an avatar is at all other moments."""


class Reach(NamedTuple):
    """Where strikes land; in one precision.

    Attributes:
        nearest: Least distance [m].
        furthest: Greatest.
        shrink: 1 / sigma [1/m].
        half: Half a control frame.
        never: ``_NEVER``.
    """

    nearest: Any
    furthest: Any
    shrink: Any
    half: Any
    never: Any


@kernel(inline=True)
def read(term, number):
    """Return the reach of a record."""
    return Reach(number(term.nearest), number(term.furthest), number(1.0 / term.sigma), number(0.5), number(_NEVER))


@kernel(inline=True)
def gap(seen, reach):
    """Return how far an avatar is from where a strike lands in this frame, in sigmas."""
    far = math.sqrt(seen.dx * seen.dx + seen.dz * seen.dz)
    away = abs(far - min(max(far, reach.nearest), reach.furthest)) * reach.shrink
    return away if (seen.due <= reach.half) & (seen.due > -reach.half) else reach.never


class HitTerm(Term):
    """Being where the target's strike lands when it reaches furthest: what that costs."""

    numbers: ClassVar[tuple[str, ...]] = ("nearest", "furthest", "sigma")
    at_frames: ClassVar[tuple[Any, Any] | None] = (read, gap)
    axes: ClassVar[tuple[str, ...]] = ("impact",)
    sign: ClassVar[float] = -1.0

    kind: Literal["hit"]
    distance: tuple[Metres, Metres] | None = Field(
        default=None,
        description="Between which distances from the target its strikes land; null: where strikes reach it, by the "
        "data [m].",
    )
    sigma: float = Field(default=0.1, gt=0.0, description="How fast the cost falls with the distance from there [m].")

    @model_validator(mode="after")
    def _upwards(self) -> HitTerm:
        if self.distance is not None and self.distance[0] > self.distance[1]:
            raise Fault(f"is {list(self.distance)}, expected the nearer distance first", "distance")
        return self

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return the numbers of its record."""
        if self.distance is None:
            raise ValueError("the distance is not known yet; see ranges.resolve_terms")
        return (*self.distance, self.sigma)

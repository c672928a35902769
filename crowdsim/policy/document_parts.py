"""What the parts of ``policy.json`` are made of."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from crowdsim.config.documents import DocumentModel
from crowdsim.config.files import Fault
from crowdsim.policy.axes.registry import NAMES
from crowdsim.policy.checks import FAR, NEAR
from crowdsim.policy.environment import Axis

LOOKUPS = Literal["q", "v"]
_FINEST = 1e-9
"""Least step between grid points."""


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("expected text that can be printed")
    return text


Text = Annotated[str, Field(min_length=1, max_length=255), AfterValidator(_printable)]
Count = Annotated[int, Field(ge=0, le=1 << 48)]
Size = Annotated[float, Field(ge=1e-6, le=NEAR)]
Rate = Annotated[float, Field(ge=0.01, le=10_000)]
Number = Annotated[float, Field(ge=-1e12, le=1e12)]
Measure = Annotated[float, Field(ge=-FAR, le=FAR)]
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class AxisPart(DocumentModel):
    """An axis of a grid, see ``environment.Axis``."""

    name: Literal[NAMES]  # type: ignore[valid-type]
    minimum: Measure
    maximum: Measure
    count: Annotated[int, Field(ge=1, le=1 << 20)]
    wraps: bool = False
    fade: Annotated[float, Field(ge=0.0, le=FAR)] = 0.0
    stretch: Annotated[float, Field(ge=0.0, le=FAR)] = 0.0

    @model_validator(mode="after")
    def _step(self) -> AxisPart:
        axis = Axis(**self.model_dump())
        if 0.0 < self.stretch < 1e-3 or not (self.count == 1 or axis.step >= _FINEST):
            raise Fault(f"has steps of {axis.step:g}, expected a range that its grid points divide", "count")
        return self

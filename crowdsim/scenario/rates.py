"""Frame rates as users write them: numbers, and fractions such as 24000/1001, which stay exact."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, PlainSerializer

from crowdsim.errors import CrowdsimError

_FRACTION = re.compile(r"\s*(\d{1,9})\s*/\s*(\d{1,9})\s*")
_LARGEST = 1001
"""Greatest denominator of a rate: a fraction up to it follows from the nearest floating point number."""
_EQUAL = 1e-9


def read_rate(value: Any) -> Any:
    """Return a fraction, or text such as ``24000/1001``, as a number; anything else as it is.

    Raises:
        ValueError: The denominator is 0, or above 1001 in lowest terms.
    """
    match = _FRACTION.fullmatch(value) if isinstance(value, str) else None
    if match is not None:
        value = Fraction(int(match[1]), int(match[2])) if int(match[2]) else None
    elif not isinstance(value, Fraction):
        return value
    if value is None or value.denominator > _LARGEST:
        raise ValueError(f"expected a fraction with a denominator of 1 to {_LARGEST}, such as 24000/1001")
    return float(value)


def parse_rate(value: str | float | Fraction) -> float:
    """Return a rate that a user gives.

    Raises:
        CrowdsimError: It is no number or fraction from 1 to 1000.
    """
    what = "a number from 1 to 1000, or a fraction with a denominator of 1 to 1001, such as 24000/1001"
    try:
        rate = 0.0 if isinstance(value, bool) else float(read_rate(value))
    except (TypeError, ValueError):
        rate = 0.0
    if not 1.0 <= rate <= 1000.0:
        raise CrowdsimError(f"fps is {value}, expected {what}")
    return rate


def exact_rate(fps: float | Fraction) -> Fraction:
    """Return a rate as a fraction: 23.976023976023978, and 23.976023976, are 24000/1001."""
    if isinstance(fps, Fraction):
        return fps
    near = Fraction(fps).limit_denominator(_LARGEST)
    return near if abs(near - Fraction(fps)) <= _EQUAL * fps else Fraction(repr(float(fps)))


def rate_text(fps: float) -> str:
    """Return a rate as text that reads back as the same number: ``30``, ``12.5`` or ``24000/1001``."""
    short, exact = f"{fps:.6g}", exact_rate(fps)
    if float(short) == fps:
        return short
    return str(exact) if float(exact) == fps else repr(fps)


def _plain(fps: float) -> float | str:
    """Return a rate as plain data: as a fraction where it is one that has no short decimal."""
    text = rate_text(fps)
    return text if "/" in text else fps


class _Text:
    """Says in the schema that a rate may be text, too."""

    def __get_pydantic_json_schema__(self, core: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Return the schema of the number, or text that is a fraction."""
        return {
            "anyOf": [
                handler(core),
                {"type": "string", "pattern": f"^{_FRACTION.pattern}$", "examples": ["24000/1001"]},
            ]
        }


_AS_DATA = PlainSerializer(_plain, return_type=Any, when_used="json-unless-none")
Rate = Annotated[float, Field(ge=1, le=1000), BeforeValidator(read_rate), _AS_DATA, _Text()]
PictureRate = Annotated[float, Field(ge=1, le=240), BeforeValidator(read_rate), _AS_DATA, _Text()]
"""Rates of outputs, and of pictures and video."""

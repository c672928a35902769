"""JSON documents of the program's own formats: plain data, held against a model that says what is in them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from crowdsim.config.findings import translate
from crowdsim.config.schema import schema_of
from crowdsim.config.tree import Document

_DEPTH = 64
"""Deepest nesting of a document, far from where the interpreter gives up."""


class DocumentModel(BaseModel):
    """A part of a document: no unknown keys, every value of the very type, and finite."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class OpenModel(BaseModel):
    """Likewise, where further keys may be, which nothing reads."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)


def parse_json(text: str | bytes) -> Any:
    """Return plain data of JSON, whose numbers are all finite.

    Raises:
        ValueError: It is no JSON, nested too deeply, or holds numbers that are not finite.
    """
    try:
        data = json.loads(text, parse_constant=_refuse, parse_float=_finite)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    level = [data]
    for _ in range(_DEPTH):
        level = [value for one in level for value in _values(one) if isinstance(value, dict | list)]
        if not level:
            return data
    raise ValueError(f"nested too deeply, expected at most {_DEPTH} levels")


def document_fault(model: type[BaseModel], data: Any) -> str:
    """Say what is wrong with plain data, the first of all findings; an empty text when nothing is."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        findings = translate(error, Document("", data), schema_of(model))
        return str(findings[0]) if findings else error.errors(include_url=False)[0]["msg"]
    return ""


def _values(data: Any) -> Iterable[Any]:
    return data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()


def _finite(text: str) -> float:
    number = float(text)
    if number in (float("inf"), float("-inf")):
        raise ValueError(f"{text[:20]} is too large for a number")
    return number


def _refuse(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")

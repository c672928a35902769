"""Pydantic's errors as findings: the key path to blame, what is wrong and what was expected."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from crowdsim.config.schema import Spot, describe, discriminator, join, member, step
from crowdsim.config.tree import Document, Finding, Loc
from crowdsim.errors import is_near, nearest


class Faults(ValueError):
    """What a validator of a model finds; locations are seen from the model."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        self.findings = tuple(findings)
        super().__init__("; ".join(map(str, self.findings)))


class Fault(Faults):
    """The one thing that a validator of a model finds, with the keys and indices that lead to what is to blame."""

    def __init__(self, message: str, *loc: str | int) -> None:
        super().__init__([Finding(loc, message)])


@dataclass(frozen=True)
class _Located:
    """Where a location of pydantic lies in the data and in the schema.

    Attributes:
        loc: The location without the labels of union members.
        value: What the data has there, or above it where it has nothing.
        spot: What the schema expects there; None where it says nothing.
        parent: The same a level above.
        union: The outermost plain union on the way, and the label of its member.
    """

    loc: Loc
    value: Any
    spot: Spot | None
    parent: Spot | None = None
    union: tuple[_Located, str] | None = None


def translate(error: ValidationError, document: Document, top: Spot) -> list[Finding]:
    """Return the findings of a validation error; the members of a plain union speak with one voice."""
    findings: list[Finding] = []
    unions: dict[Loc, tuple[_Located, dict[str, list[Finding | None]]]] = {}
    for detail in error.errors(include_url=False):
        here = _locate(detail["loc"], document.data, top)
        if document.hides(here.loc):
            continue
        found = _findings_of(dict(detail), here)
        if here.union is None:
            findings += found
            continue
        # A member that the value's very type rules out has nothing to say once another one is meant.
        outer, label = here.union
        common = discriminator(outer.spot)
        ruled_out = here.loc == outer.loc and detail["type"].endswith(("_type", "literal_error", "int_from_float"))
        ruled_out = ruled_out or (common is not None and here.loc == (*outer.loc, common[0]))
        labels = unions.setdefault(outer.loc, (outer, {}))[1]
        labels.setdefault(label, []).extend([None] if ruled_out else found)
    for outer, labels in unions.values():
        meant = [[finding for finding in found if finding] for found in labels.values() if None not in found]
        if meant:
            findings += sorted(meant, key=len)[0]
        elif not any(loc[: len(outer.loc)] == outer.loc for loc in document.unreadable):
            findings.append(_no_member(outer))
    return [document.place(finding) for finding in findings if not document.hides(finding.loc)]


def unknown_key(loc: Loc, spot: Spot | None) -> Finding:
    """Return the finding of a key that a mapping does not know, with its new name or the nearest known one."""
    key, known = str(loc[-1]), spot.keys if spot else []
    renamed = spot.renamed.get(key) if spot else None
    expected = f"it is now called '{renamed}'" if renamed else f"expected {join(known)}{nearest(key, known)}"
    return Finding(loc, f"unknown key, {expected}", of_key=loc)


def show(value: Any) -> str:
    """Say what a value is: ``is 'abc'``, ``is a list``, ``is empty``."""
    if value is None:
        return "is empty"
    if isinstance(value, dict | list):
        return "is a mapping" if isinstance(value, dict) else "is a list"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return f"is {text if len(text) <= 60 else text[:57] + '...'}"


def holds(value: Any, part: Any) -> bool:
    """Whether a mapping or list has something at a key or index."""
    return part in value if isinstance(value, dict) else isinstance(value, list) and part in range(len(value))


def _locate(location: tuple[Any, ...], value: Any, top: Spot) -> _Located:
    """Follow a location of pydantic, which has a label of the member chosen after every union."""
    here = _Located((), value, top)
    for part in location:
        spot, inside = here.spot, holds(here.value, part)
        if spot is not None and spot.members:
            union = here.union or (None if spot.tagged else (here, str(part)))
            here = replace(here, spot=member(spot, str(part)), union=union)
        elif part == "[key]":
            break
        elif inside or spot is not None:
            value = here.value[part] if inside else here.value
            here = _Located((*here.loc, part), value, step(spot, part), spot, here.union)
            if not inside:
                break
    return here


def _findings_of(detail: dict[str, Any], here: _Located) -> list[Finding]:
    """Return what an error of pydantic says in words; nothing where another finding says it."""
    kind, loc, context = detail["type"], here.loc, detail.get("ctx", {})
    shown, expected, reason = show(here.value), describe(here.spot), context.get("error")
    what = f"{shown}, expected {expected}"
    if isinstance(reason, Faults):
        return [replace(finding, loc=(*loc, *finding.loc)) for finding in reason.findings]
    if detail["loc"][-1:] == ("[key]",):
        reason = reason or detail["msg"].replace("String should match pattern", "expected text that matches")
        return [Finding(loc[:-1], f"the key is {loc[-1]!r}, {reason}", of_key=loc)]
    if kind == "extra_forbidden":
        return [unknown_key(loc, here.parent)]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return [_wrong_tag(here)]
    if kind == "missing":
        if _is_misspelt(str(loc[-1]), here.parent, here.value):
            return []
        what = f"missing, expected {expected}"
    elif kind in ("too_short", "too_long"):
        count, limit = len(here.value), context.get("min_length", context.get("max_length"))
        if kind == "too_short" and count >= limit:
            return []  # pydantic counts valid items only; the others have findings of their own
        if here.spot is None or not here.spot.is_pair_or_the_like:
            expected = f"at {'least' if kind == 'too_short' else 'most'} {limit}"
        what = f"has {count} item{'s'[: count != 1]}, expected {expected}"
    elif kind == "string_too_short":
        what = "is empty text, expected text"
    elif reason is not None:
        what = f"{shown}, {reason}"
    elif here.spot is None or expected == "a value":
        what = f"{shown}, expected {re.sub('^(Input|Value) should be ', '', detail['msg'])}"
    elif kind == "literal_error":
        what += _near(here.value, here.spot.words)
    elif here.spot.kind is str and isinstance(here.value, int | float):
        what += " in quotes"
    return [Finding(loc, what)]


def _is_misspelt(key: str, spot: Spot | None, given: Any) -> bool:
    """Whether an unknown key is a misspelt missing one, and has a finding of its own."""
    if spot is None or not isinstance(given, dict):
        return False
    return any(
        spot.renamed.get(name) == key or nearest(name, spot.keys) == nearest(key, [key])
        for name in given
        if name not in spot.keys
    )


def _no_member(here: _Located) -> Finding:
    """Return the finding of a value that is meant for no member of a union."""
    if discriminator(here.spot) and isinstance(here.value, dict):
        return _wrong_tag(here)
    words = [word for choice in here.spot.members for word in choice.words] if here.spot else []
    return Finding(here.loc, f"{show(here.value)}, expected {describe(here.spot)}{_near(here.value, words)}")


def _wrong_tag(here: _Located) -> Finding:
    """Return the finding of a mapping whose key that chooses among the models of a union is missing or wrong."""
    key, words = discriminator(here.spot) or ("kind", [])
    loc, expected = (*here.loc, key), join([f"'{word}'" for word in words])
    if key in here.value:
        return Finding(loc, f"{show(here.value[key])}, expected {expected}{_near(here.value[key], words)}")
    known = {name for choice in here.spot.members for name in choice.keys} if here.spot else set()
    for other in here.value:
        if other not in known and is_near(other, key):
            what = f"unknown key, expected {key}: {expected} (did you mean '{key}'?)"
            return Finding((*here.loc, other), what, of_key=(*here.loc, other))
    return Finding(loc, f"missing, expected {expected}")


def _near(value: Any, words: Iterable[Any]) -> str:
    return "" if isinstance(value, dict | list) else nearest(str(value), words)

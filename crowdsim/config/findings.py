"""Pydantic's errors as findings: the key path to blame, what is wrong and what was expected."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import islice
from typing import Any, NamedTuple

from pydantic import ValidationError

from crowdsim.config.schema import Part, chosen, describe, discriminator, join, keys, members, quoted, step, words
from crowdsim.config.tree import MOST_FINDINGS, Document, Finding, Loc, shortened
from crowdsim.errors import is_near, nearest

_MOST_ERRORS = 10 * MOST_FINDINGS
_MOST_KEYS = 100
"""How many errors of pydantic are looked at, and how many unknown keys of a mapping are held against its own."""


class Faults(ValueError):
    """What a validator of a model finds; locations are seen from the model."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        self.findings = tuple(findings)
        super().__init__("; ".join(map(str, self.findings)))


class Fault(Faults):
    """The only finding of a validator of a model, with the keys and indices that lead to its location."""

    def __init__(self, message: str, *loc: str | int) -> None:
        super().__init__([Finding(loc, message)])


class _Located(NamedTuple):
    """Where a location of pydantic lies in the data and in the schema.

    Attributes:
        loc: The location without the labels of union members.
        value: What the data has there, or above it where it has nothing.
        part: What the schema expects there.
        above: What the schema expects a level above.
        union: The outermost union along the location that has no discriminator.
        is_meant: Whether the value is meant for the member of it that the location names.
    """

    loc: Loc
    value: Any
    part: Part
    above: Part
    union: _Located | None = None
    is_meant: bool = True


def translate(error: ValidationError, document: Document, top: Part) -> list[Finding]:
    """Return the findings of a validation error; of a union, only those of the member that the value is meant for.

    Of very many, there are those of the first ``_MOST_ERRORS`` errors, and no more than about ``MOST_FINDINGS``.
    """
    labels: dict[Loc, list[str]] = {}
    found: list[tuple[_Located, dict[str, Any] | None]] = []
    silent: dict[Loc, _Located] = {}
    spoken: set[Loc] = set()
    union: Loc | None = None
    for count, detail in enumerate(error.errors(include_url=False, include_input=False)):
        here = _locate(detail["loc"], document.data, top, labels)
        before, union = union, None if here.union is None else here.union.loc
        if count > _MOST_ERRORS and (union is None or union != before or union in spoken):
            break
        if here.union is not None:
            silent[here.union.loc] = here.union
            of_other_type = detail["type"].endswith(("_type", "literal_error", "int_from_float"))
            if not here.is_meant or (here.loc == here.union.loc and of_other_type):
                continue
            spoken.add(here.union.loc)
        found.append((here, dict(detail)))
    found += [(one, None) for loc, one in silent.items() if loc not in spoken]
    found.sort(key=lambda one: document.position(one[0].loc))
    findings: list[Finding] = []
    for here, detail_of in found:
        of_one = [_no_member(here)] if detail_of is None else _findings_of(detail_of, here)
        findings += [document.place(finding) for finding in of_one if not document.hides(finding.loc)]
        if len(findings) > MOST_FINDINGS:
            break
    return findings


def refused_nulls(document: Document, top: Part) -> list[Finding]:
    """Return the findings of values that are empty, or null where the documentation gives that no meaning."""
    found = []
    for loc, what in document.nulls.items():
        above, part, value = top, top, document.data
        for at in loc:
            above = chosen(part, value)
            part = step(above, at)
            value = value[at] if holds(value, at) else None
        said = part.get("description", "") + above.get("description", "")
        has_meaning = "null" in said.lower() or "without it" in said
        # What an unknown key is to be called matters more than that it has no value.
        if part and (what.startswith("is empty") or not has_meaning):
            found.append(Finding(loc, f"{what}, expected {describe(part)}"))
    return found


def _locate(location: tuple[Any, ...], data: Any, top: Part, labels: dict[Loc, list[str]]) -> _Located:
    """Follow a location of pydantic through data and schema.

    After every union it has a label: the discriminator's value, or a name of the member. Pydantic names all members in
    the order of the schema; ``labels`` keeps those of each union.
    """
    here = _Located((), data, top, {})
    for i, at in enumerate(location):
        if members(here.part):
            known = labels.setdefault(location[:i], [])
            known += [at] if at not in known else []
            of_mapping = chosen(here.part, here.value)
            if "discriminator" in here.part:
                here = here._replace(part=of_mapping)
                continue
            member = members(here.part)[known.index(at)]
            is_meant = here.is_meant and (member is of_mapping or not isinstance(here.value, dict))
            here = here._replace(part=member, union=here.union or here, is_meant=is_meant)
        elif at == "[key]":
            break
        elif holds(here.value, at):
            here = here._replace(loc=(*here.loc, at), value=here.value[at], part=step(here.part, at), above=here.part)
        else:
            return here._replace(loc=(*here.loc, at), part=step(here.part, at), above=here.part)
    return here


def _findings_of(detail: dict[str, Any], here: _Located) -> list[Finding]:
    """Return an error of pydantic in words; none where another finding covers it."""
    kind, loc, context = detail["type"], here.loc, detail.get("ctx", {})
    reason, expected = context.get("error"), describe(here.part)
    what = f"{show(here.value)}, expected {expected}"
    if isinstance(reason, Faults):
        return [
            Finding((*loc, *one.loc), one.message, None if one.of_key is None else (*loc, *one.of_key))
            for one in reason.findings
        ]
    if detail["loc"][-1:] == ("[key]",):
        reason = reason or detail["msg"].replace("String should match pattern", "expected text that matches")
        return [Finding(loc[:-1], f"the key {show(loc[-1])}, {reason}", of_key=loc)]
    if kind == "extra_forbidden":
        return [unknown_key(loc, here.above)]
    if kind == "missing":
        if _is_misspelt(str(loc[-1]), here.above, here.value):
            return []
        what = f"missing, expected {expected}"
    elif kind in ("too_short", "too_long"):
        count, limit = len(here.value), context.get("min_length", context.get("max_length"))
        if kind == "too_short" and count >= limit:
            return []  # pydantic counts valid items only; the others have findings of their own
        if "prefixItems" not in here.part:
            expected = f"at {'least' if kind == 'too_short' else 'most'} {limit}"
        what = f"has {count} item{'s'[: count != 1]}, expected {expected}"
    elif reason is not None:
        what = f"{show(here.value)}, {reason}"
    elif members(here.part):
        return [_no_member(here)]
    elif expected == "a value":
        what = f"{show(here.value)}, expected {re.sub('^(Input|Value) should be ', '', detail['msg'])}"
    elif kind == "literal_error":
        what += _near(here.value, words(here.part))
    elif here.part.get("type") == "string" and isinstance(here.value, int | float):
        what += " in quotes"
    return [Finding(loc, what)]


def unknown_key(loc: Loc, part: Part) -> Finding:
    """Return the finding of a key that a mapping does not know, with its new name or the nearest known one."""
    key = str(loc[-1])
    renamed = part.get("renamed", {}).get(key)
    expected = f"it is now called '{renamed}'" if renamed else f"expected {join(keys(part))}{nearest(key, keys(part))}"
    return Finding(loc, f"unknown key, {expected}", of_key=loc)


def _is_misspelt(key: str, part: Part, given: Any) -> bool:
    """Whether an unknown key is a misspelt missing one, and has a finding of its own."""
    return isinstance(given, dict) and any(
        part.get("renamed", {}).get(name) == key or nearest(name, keys(part)) == nearest(key, [key])
        for name in islice((name for name in given if name not in keys(part)), _MOST_KEYS)
    )


def _no_member(here: _Located) -> Finding:
    """Return the finding of a value that is meant for no member of a union."""
    key, tags = discriminator(here.part)
    if not key or not isinstance(here.value, dict):
        choices = [word for choice in members(here.part) for word in words(choice)]
        return Finding(here.loc, f"{show(here.value)}, expected {describe(here.part)}{_near(here.value, choices)}")
    if key in here.value:
        what = f"{show(here.value[key])}, expected {quoted(tags)}{_near(here.value[key], tags)}"
        return Finding((*here.loc, key), what)
    known = {name for choice in tags.values() for name in keys(choice)}
    for other in islice(here.value, _MOST_KEYS):
        if other not in known and is_near(other, key):
            loc = (*here.loc, other)
            return Finding(loc, f"unknown key, expected {key}: {quoted(tags)} (did you mean '{key}'?)", of_key=loc)
    for tag, choice in tags.items():
        others = [nearest(name, keys(choice)) for name in islice(here.value, _MOST_KEYS)]
        if others and all(others):
            names = [other.split("'")[1] for other in others]
            near = f" (did you mean {join([f'{key}: {tag}', *names], 'and')}?)"
            return Finding((*here.loc, key), f"missing, expected {quoted(tags)}{near}")
    return Finding((*here.loc, key), f"missing, expected {quoted(tags)}")


def show(value: Any) -> str:
    """Say what a value is: ``is 'abc'``, ``is a list``, ``is empty``."""
    if value is None:
        return "is empty"
    if isinstance(value, dict | list):
        return "is a mapping" if isinstance(value, dict) else "is a list"
    text = str(value).lower() if isinstance(value, bool) else repr(value[:80] if isinstance(value, str) else value)
    return f"is {shortened(text)}"


def holds(value: Any, at: Any) -> bool:
    """Whether a mapping or list has something at a key or index."""
    return at in value if isinstance(value, dict) else isinstance(value, list) and at in range(len(value))


def _near(value: Any, words: Iterable[Any]) -> str:
    return "" if isinstance(value, dict | list) else nearest(str(value), words)

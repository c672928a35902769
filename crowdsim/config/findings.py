"""Pydantic's errors as findings: the line and column to blame, the key path, what is wrong and what was expected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import ValidationError

from crowdsim.config.schema import Spot, describe, discriminator, join, member, step
from crowdsim.config.tree import FAULTY, Entry, Finding, Path, key_path
from crowdsim.errors import is_near, nearest


class Fault(ValueError):
    """One thing that is wrong at a key: a path of keys and indices below the model whose validator raises it."""

    def __init__(self, message: str, *path: str | int) -> None:
        super().__init__(f"{key_path(path)}: {message}" if path else message)
        self.message = message
        self.path: Path = path


class Faults(ValueError):
    """Several faults at once."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = list(faults)
        super().__init__("; ".join(map(str, self.faults)))


class _Located:
    """Where a location of pydantic lies in the tree and in the schema."""

    def __init__(self, entry: Entry, spot: Spot | None) -> None:
        self.entry = entry
        self.spot = spot
        self.parent: Spot | None = None
        self.path: Path = ()
        self.union: tuple[_Located, str] | None = None


def translate(error: ValidationError, entry: Entry, top: Spot) -> list[Finding]:
    """Return the findings of a validation error; the members of a plain union speak with one voice."""
    findings: list[Finding] = []
    unions: dict[Path, tuple[_Located, dict[str, list[Finding | None]]]] = {}
    for detail in error.errors(include_url=False):
        here = _locate(detail["loc"], entry, top)
        if here.entry.value is FAULTY:
            continue
        found = _findings_of(dict(detail), here)
        if here.union is None:
            findings += found
            continue
        # A member that the value's very type rules out has nothing to say once another one is meant.
        outer, label = here.union
        common = discriminator(outer.spot) if outer.spot else None
        ruled_out = here.path == outer.path and detail["type"].endswith(("_type", "literal_error", "int_from_float"))
        ruled_out = ruled_out or (common is not None and here.path == (*outer.path, common[0]))
        labels = unions.setdefault(outer.path, (outer, {}))[1]
        labels.setdefault(label, []).extend([None] if ruled_out else found)
    for outer, labels in unions.values():
        meant = [some for some in labels.values() if None not in some]
        common = discriminator(outer.spot) if outer.spot else None
        if meant:
            findings += [finding for finding in min(meant, key=len) if finding is not None]
        elif common is not None and isinstance(outer.entry.value, dict):
            findings.append(_wrong_tag(outer, *common))
        else:
            words = [str(word) for choice in outer.spot.members for word in choice.words] if outer.spot else []
            near = nearest(str(outer.entry.value), words)
            what = f"{show(outer.entry.value)}, expected {describe(outer.spot)}{near}"
            findings.append(Finding(outer.entry.place, key_path(outer.path), what))
    return findings


def fault_finding(fault: Fault, path: Path, entry: Entry) -> Finding:
    """Return a validator's fault below ``path`` as a finding; it stands at the deepest place that the file has."""
    for part in fault.path:
        if not _holds(entry.value, part):
            break
        entry = entry.value[part]
    return Finding(entry.place, key_path((*path, *fault.path)), fault.message)


def show(value: Any) -> str:
    """Say what stands at a place: ``is 'abc'``, ``is a list``, ``is empty``."""
    if value is None:
        return "is empty"
    if isinstance(value, dict):
        return "is a mapping"
    if isinstance(value, list):
        return "is a list"
    if isinstance(value, bool):
        return f"is {str(value).lower()}"
    text = repr(value)
    return f"is {text if len(text) <= 60 else text[:57] + '...'}"


def _locate(location: Sequence[Any], entry: Entry, top: Spot) -> _Located:
    """Follow a location of pydantic, which has a label of the member chosen after every union."""
    here = _Located(entry, top)
    for part in location:
        if here.entry.value is FAULTY or part == "[key]":
            break
        if here.spot is not None and here.spot.members:
            if not here.spot.tagged and here.union is None:
                outer = _Located(here.entry, here.spot)
                outer.path = here.path
                here.union = (outer, str(part))
            here.spot = member(here.spot, str(part))
            continue
        inside = _holds(here.entry.value, part)
        if not inside and here.spot is None:
            continue
        here.parent, here.spot, here.path = here.spot, step(here.spot, part), (*here.path, part)
        if not inside:
            break
        here.entry = here.entry.value[part]
    return here


def _holds(value: Any, part: Any) -> bool:
    if isinstance(value, list):
        return isinstance(part, int) and part < len(value)
    return isinstance(value, dict) and part in value


def _findings_of(detail: dict[str, Any], here: _Located) -> list[Finding]:
    kind, context, value = detail["type"], detail.get("ctx", {}), here.entry.value
    place, path = here.entry.place, here.path
    if kind in ("value_error", "assertion_error"):
        reason = context["error"]
        if isinstance(reason, Faults):
            return [fault_finding(fault, path, here.entry) for fault in reason.faults]
        if isinstance(reason, Fault):
            return [fault_finding(reason, path, here.entry)]
        if detail["loc"][-1:] == ("[key]",):
            return [Finding(here.entry.key_place, key_path(path[:-1]), f"the key is {path[-1]!r}, {reason}")]
        return [Finding(place, key_path(path), f"{show(value)}, {reason}")]
    if kind == "extra_forbidden":
        keys = here.parent.keys if here.parent else []
        what = f"unknown key, expected {join(keys)}{nearest(str(path[-1]), keys)}"
        return [Finding(here.entry.key_place, key_path(path), what)]
    if kind == "missing":
        if _misspelt(str(path[-1]), here):
            return []  # the unknown key that it is meant by has a finding of its own
        return [Finding(place, key_path(path), f"missing, expected {describe(here.spot)}")]
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        common = discriminator(here.spot) if here.spot else None
        return [_wrong_tag(here, *(common or (str(context["discriminator"]).strip("'"), [])))]
    if kind in ("too_short", "too_long"):
        count = len(value)
        if kind == "too_short" and count >= context["min_length"]:
            return []  # pydantic counts valid items only; the others have findings of their own
        if here.spot is not None and here.spot.is_pair_or_the_like:
            expected = describe(here.spot)
        else:
            expected = (
                f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
            )
        return [Finding(place, key_path(path), f"has {count} item{'s'[: count != 1]}, expected {expected}")]
    if kind == "string_too_short":
        return [Finding(place, key_path(path), "is empty text, expected text")]
    if kind == "literal_error":
        words = [str(word) for word in here.spot.words] if here.spot else []
        what = f"{show(value)}, expected {describe(here.spot) if here.spot else context['expected']}"
        return [Finding(place, key_path(path), what + nearest(str(value), words))]
    expected = describe(here.spot)
    if expected == "a value":
        expected = str(detail["msg"]).removeprefix("Input should be ").removeprefix("Value should be ")
    return [Finding(place, key_path(path), f"{show(value)}, expected {expected}{_hint(value, here.spot)}")]


def _wrong_tag(here: _Located, key: str, words: list[Any]) -> Finding:
    path, given = key_path((*here.path, key)), here.entry.value.get(key)
    expected = join([f"'{word}'" for word in words])
    if given is None:
        known = {name for choice in here.spot.members for name in choice.keys} if here.spot else set()
        for other, entry in here.entry.value.items():
            if other not in known and is_near(other, key):
                what = f"unknown key, expected {key}: {expected} (did you mean '{key}'?)"
                return Finding(entry.key_place, key_path((*here.path, other)), what)
        return Finding(here.entry.place, path, f"missing, expected {expected}")
    return Finding(given.place, path, f"{show(given.value)}, expected {expected}{nearest(str(given.value), words)}")


def _misspelt(key: str, here: _Located) -> bool:
    """Whether an unknown key stands beside a missing one that it is most like."""
    keys = here.parent.keys if here.parent else []
    given = here.entry.value if isinstance(here.entry.value, dict) else {}
    return any(name not in keys and nearest(name, keys) == nearest(key, [key]) for name in given)


def _hint(value: Any, spot: Spot | None) -> str:
    if spot is not None and spot.kind is str and isinstance(value, int | float):
        return " in quotes"
    return ""

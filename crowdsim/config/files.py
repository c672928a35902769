"""Reads YAML files into pydantic models and says everything that is wrong with one, each with its line and column.

A model refuses unknown keys by ``ConfigDict(extra="forbid")``; :class:`StrictModel` does. Checks across keys raise
:class:`Fault` or :class:`Faults` in a validator, which name the key that is to blame. A model may have a class method
``faults_in(data) -> list[Fault]`` for checks that make sense on plain data of a file that is otherwise invalid, such as
names that refer to nothing; it is asked only when validation fails.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from crowdsim.config.findings import Fault, Faults, fault_finding, show, translate
from crowdsim.config.schema import Spot, describe, discriminator, join, member, spot_of, step
from crowdsim.config.tree import (
    FAULTY,
    MAXIMUM_BYTES,
    Entry,
    Finding,
    Path,
    Place,
    TreeError,
    key_path,
    read_tree,
    scalar,
)
from crowdsim.core.types import FileName
from crowdsim.errors import CrowdsimError, nearest

__all__ = ["Fault", "Faults", "Finding", "StrictModel", "dump_yaml", "find_faults", "load_model", "where"]

Model = TypeVar("Model", bound=BaseModel)


class StrictModel(BaseModel):
    """A frozen model that refuses keys it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def load_model(
    path: FileName,
    model: type[Model],
    error: type[CrowdsimError],
    overrides: Sequence[str] = (),
    context: dict[str, Any] | None = None,
) -> Model:
    """Return the model that a YAML file describes.

    Args:
        path: The file.
        model: What the file holds.
        error: Class of the error to raise.
        overrides: ``KEY=VALUE`` each, such as ``groups[0].count=12`` or ``groups.0.count=12``; laid over the file.
        context: What the model's validators find in ``info.context``.

    Raises:
        CrowdsimError: Of the class ``error``, with every finding in a line of its own and as the tuple ``findings``.
    """
    value, findings = _read(path, model, overrides, context)
    if value is None or findings:
        failure = error("\n".join(map(str, findings)))
        failure.findings = tuple(findings)  # type: ignore[attr-defined]
        raise failure
    return value


def find_faults(
    path: FileName, model: type[BaseModel], overrides: Sequence[str] = (), context: dict[str, Any] | None = None
) -> list[Finding]:
    """Return everything that is wrong with a YAML file, in the order of its lines; an empty list when nothing is."""
    return _read(path, model, overrides, context)[1]


def where(path: FileName, key: Sequence[str | int]) -> str:
    """Return ``PATH:LINE:COLUMN: key.path`` of a key in a file, or of the nearest one above it that the file has."""
    place = Place(str(path))
    try:
        with open(path, "rb") as file:
            entry, _ = read_tree(file.read(MAXIMUM_BYTES + 1), str(path))
        if entry is not None:
            place = fault_finding(Fault("", *key), (), entry).place
    except (TreeError, OSError, ValueError):
        pass
    return f"{place}: {key_path(tuple(key))}"


def dump_yaml(data: Any) -> str:
    """Return plain data as YAML in block style, which :func:`load_model` reads back to the same values."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=False, width=10**6)


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(scalar(text), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


def _read(
    path: FileName, model: type[Model], overrides: Sequence[str], context: dict[str, Any] | None
) -> tuple[Model | None, list[Finding]]:
    source = str(path)
    try:
        with open(path, "rb") as file:
            entry, findings = read_tree(file.read(MAXIMUM_BYTES + 1), source)
    except TreeError as failure:
        return None, [failure.finding]
    except (OSError, ValueError) as failure:
        problem = {"FileNotFoundError": "no such file", "IsADirectoryError": "is a folder, expected a YAML file"}
        why = failure.strerror if isinstance(failure, OSError) else failure
        what = problem.get(type(failure).__name__, f"cannot be read: {why}")
        return None, [Finding(Place(source), "", what)]
    top = spot_of(model)
    if entry is None or entry.value is None:
        if not findings:
            findings = [Finding(Place(source, 1, 1), "", f"the file is empty, expected {describe(top)}")]
        return None, findings
    if not isinstance(entry.value, dict):
        if entry.value is not FAULTY:
            what = f"the file {show(entry.value).replace('is', 'holds', 1)}, expected {describe(top)}"
            findings.append(Finding(entry.place, "", what))
        return None, findings
    for text in overrides:
        findings += _override(entry, top, text)
    value, data = None, entry.plain()
    try:
        # JSON is where pydantic's strict mode takes lists for tuples and whole numbers for floats, yet no other mix.
        text = json.dumps(data, default=lambda faulty: None)
        value = model.model_validate_json(text, strict=True, context=context)
    except ValidationError as failure:
        findings += translate(failure, entry, top)
        faults_in: Callable[[Any], list[Fault]] | None = getattr(model, "faults_in", None)
        findings += [fault_finding(fault, (), entry) for fault in (faults_in(data) if faults_in else [])]
    unique = {str(finding): finding for finding in findings}
    return value, sorted(unique.values(), key=lambda one: (one.place.line or 10**9, one.place.column or 0))


def _override(entry: Entry, top: Spot, text: str) -> list[Finding]:
    """Lay one ``KEY=VALUE`` over the tree; return what is wrong with it."""
    place = Place(f"--set {text}")
    key, equals, words = text.partition("=")
    parts = re.findall(r"[^.\[\]]+", key)
    if not equals or not re.fullmatch(r"[^.\[\]]+(\.[^.\[\]]+|\[\d+\])*", key):
        return [Finding(place, "", "is no override, expected KEY=VALUE, such as seed=3 or groups[0].count=12")]
    spot: Spot | None = top
    path: Path = ()
    created: tuple[dict[str, Entry], str] | None = None

    def refused(at: Path, what: str) -> list[Finding]:
        if created is not None:
            del created[0][created[1]]
        return [Finding(place, key_path(at), what)]

    for i, part in enumerate(parts):
        chosen = _entered(spot, entry)
        # A scalar gives way where its key may as well hold a mapping: seconds for a number of frames.
        if chosen is not spot and chosen is not None and part in chosen.keys and not isinstance(entry.value, dict):
            entry.value = {}
        spot = chosen
        if entry.value is None and spot is not None and spot.is_list:
            entry.value = []
        if isinstance(entry.value, list):
            at: Any = int(part) if part.isdigit() else part
            if not part.isdigit() or at >= len(entry.value):
                count = len(entry.value)
                some = f"an index from 0 to {count - 1}" if count else "none: the list is empty"
                return refused(path, f"there is no item {part}, expected {some}")
        else:
            at = part
            if entry.value is None:
                entry.value = {}
            if not isinstance(entry.value, dict):
                what = f"{key_path(path)} {show(entry.value)}, expected a mapping"
                return refused((*path, part), what)
            if spot is not None and spot.keys and part not in spot.keys:
                what = f"unknown key, expected {join(spot.keys)}{nearest(part, spot.keys)}"
                return refused((*path, part), what)
        path, spot = (*path, at), step(spot, at)
        if i == len(parts) - 1:
            entry.value[at], findings = _parse(words, spot, path, place)
            return findings
        if isinstance(entry.value, dict) and at not in entry.value:
            created = created or (entry.value, at)
            entry.value[at] = Entry(None, place, place)
        entry = entry.value[at]
    return []


def _entered(spot: Spot | None, entry: Entry) -> Spot | None:
    """Return the member of a union that the value of an entry chooses, or the spot itself when it is no union."""
    if spot is None or not spot.members:
        return spot
    common = discriminator(spot)
    if common and isinstance(entry.value, dict) and common[0] in entry.value:
        return member(spot, str(entry.value[common[0]].value))
    models = [choice for choice in spot.members if choice.model is not None]
    return models[0] if len(models) == 1 else None


def _parse(words: str, spot: Spot | None, path: Path, place: Place) -> tuple[Entry, list[Finding]]:
    """Return the value of an override, and what is wrong with it; words stand as they are where text is expected."""
    try:
        entry, findings = read_tree(words.encode("utf-8", "replace"), str(place))
    except TreeError as failure:
        return Entry(FAULTY, place, place), [Finding(place, key_path(path), failure.finding.message)]
    entry = _moved(entry or Entry(None if not findings else FAULTY, place, place), place)
    # Numbers and what looks like a comment, such as a colour, are text where text is expected.
    told = isinstance(entry.value, str | dict | list) or scalar(words.strip()) is None
    if spot is not None and spot.kind is str and not told:
        entry.value, findings = words.strip(), []
    return entry, [Finding(place, key_path(path), finding.message) for finding in findings]


def _moved(entry: Entry, place: Place) -> Entry:
    value = entry.value
    if isinstance(value, dict):
        value = {key: _moved(inner, place) for key, inner in value.items()}
    elif isinstance(value, list):
        value = [_moved(inner, place) for inner in value]
    return Entry(value, place, place)

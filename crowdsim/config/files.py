"""Reads YAML files into pydantic models and reports everything that is wrong with one, each with its line and column.

A model refuses unknown keys by ``ConfigDict(extra="forbid")``; :class:`StrictModel` does. Checks across keys raise
:class:`Fault` or :class:`Faults` in a validator, which name the key that is to blame. A model may have a class method
``findings_in(data) -> list[Finding]`` for checks that make sense on plain data of a file that is otherwise invalid,
such as names that refer to nothing; it is called only when validation fails.
"""

from __future__ import annotations

import gc
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from enum import Enum
from functools import lru_cache
from typing import Any, ClassVar, TypeVar

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, GetJsonSchemaHandler, ValidationError

from crowdsim.config.findings import Fault, Faults, holds, refused_nulls, show, translate, unknown_key
from crowdsim.config.nodes import MAXIMUM_BYTES, MAXIMUM_DEPTH, TOO_DEEP
from crowdsim.config.schema import Part, chosen, join, keys, schema_of, step, words
from crowdsim.config.tree import MOST_FINDINGS, Document, Finding, Loc, key_path, read_document, scalar
from crowdsim.core.types import FileName
from crowdsim.errors import CrowdsimError

__all__ = [
    "MOST_FINDINGS",
    "Fault",
    "Faults",
    "Finding",
    "StrictModel",
    "dump_yaml",
    "find_faults",
    "load_data",
    "load_model",
    "place",
    "validate",
]

Model = TypeVar("Model", bound=BaseModel)


@contextmanager
def collection_paused() -> Iterator[None]:
    """Pause the search for cyclic garbage, which takes half of the time in which a long file is read.

    Each search goes through all objects that there are, and reading makes hundreds of thousands.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


class StrictModel(BaseModel):
    """A frozen model that refuses unknown keys.

    Attributes:
        renamed: Keys that files had before, with the new name of each, which is reported.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    renamed: ClassVar[dict[str, str]] = {}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: GetJsonSchemaHandler) -> Part:
        """Return the JSON Schema of the model, with the keys that were renamed as ``renamed``."""
        schema = handler(core)
        if cls.renamed:
            handler.resolve_ref_schema(schema)["renamed"] = cls.renamed
        return schema


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
    return _sound(value, findings, error)


def load_data(
    data: Mapping[str, Any],
    name: str,
    model: type[Model],
    error: type[CrowdsimError],
    overrides: Sequence[str] = (),
    context: dict[str, Any] | None = None,
) -> Model:
    """Return the model that data describes which are no file's, checked as those of a file; see :func:`load_model`.

    Args:
        data: Mappings, sequences, text, numbers, numpy's too, and models.
        name: What findings call it.
        model: What the data are.
        error: Class of the error to raise.
        overrides: As of :func:`load_model`.
        context: Likewise.
    """
    foreign: list[Finding] = []
    read = read_document(dump_yaml(_plain(data, (), foreign, 0)).encode("utf-8", "replace"), name)
    findings = [replace(finding, source=name, line=0, column=0) for finding in (*foreign, *read.findings)]
    unreadable = read.unreadable | {finding.loc for finding in foreign}
    document = Document(name, read.data, unreadable=unreadable, findings=findings)
    return _sound(*_validate(document, model, overrides, context), error)


def validate(document: Document, model: type[Model], error: type[CrowdsimError]) -> Model:
    """Return the model that a document describes; arguments and errors as of :func:`load_model`."""
    return _sound(*_validate(document, model), error)


def find_faults(
    path: FileName, model: type[BaseModel], overrides: Sequence[str] = (), context: dict[str, Any] | None = None
) -> list[Finding]:
    """Return everything that is wrong with a YAML file, in the order of its lines; an empty list when nothing is."""
    return _read(path, model, overrides, context)[1]


@collection_paused()
def place(path: FileName, findings: Iterable[Finding]) -> list[Finding]:
    """Return findings in a file with the positions of their keys, or of the nearest ones above them that it has."""
    found = list(findings)
    document = _document(path) if found else Document(str(path))
    return _cut([document.place(finding) for finding in found])


def dump_yaml(data: Any) -> str:
    """Return plain data as YAML in block style, which :func:`load_model` reads back to the same values."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=False, width=10**6)


def _plain(value: Any, loc: Loc, findings: list[Finding], depth: int) -> Any:
    """Return a value as YAML has it; what it cannot have is a finding, and null."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, Enum):
        value = value.value
    if depth <= MAXIMUM_DEPTH:
        if isinstance(value, Mapping):
            return {str(key): _plain(item, (*loc, str(key)), findings, depth + 1) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [_plain(item, (*loc, index), findings, depth + 1) for index, item in enumerate(value)]
    if value is None or type(value) in (str, bool, int, float):
        return value
    what = TOO_DEEP if depth > MAXIMUM_DEPTH else f"is of type {type(value).__name__}, expected what YAML can hold"
    findings.append(Finding(loc, what))
    return None


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(scalar(text), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


def _document(path: FileName, is_changed: bool = False) -> Document:
    """Return the document of a file; it is shared, unless it is to be changed."""
    read = _read_document.__wrapped__ if is_changed else _read_document
    try:
        with open(path, "rb") as file:
            return read(file.read(MAXIMUM_BYTES + 1), str(path))
    except FileNotFoundError:
        what = "no such file"
    except IsADirectoryError:
        what = "is a folder, expected a YAML file"
    except (OSError, ValueError) as failure:
        what = f"cannot be read: {failure.strerror if isinstance(failure, OSError) else failure}"
    return Document(str(path), findings=[Finding((), what, source=str(path))])


# A command places findings in files that it has just read: a scenario and some recipes.
_read_document = lru_cache(maxsize=4)(read_document)


@collection_paused()
def _read(
    path: FileName, model: type[Model], overrides: Sequence[str], context: dict[str, Any] | None = None
) -> tuple[Model | None, list[Finding]]:
    return _validate(_document(path, bool(overrides)), model, overrides, context)


def _sound(value: Model | None, findings: list[Finding], error: type[CrowdsimError]) -> Model:
    if value is None or findings:
        failure = error("\n".join(map(str, findings)))
        failure.findings = tuple(findings)  # type: ignore[attr-defined]
        raise failure
    return value


def _validate(
    document: Document, model: type[Model], overrides: Sequence[str] = (), context: dict[str, Any] | None = None
) -> tuple[Model | None, list[Finding]]:
    # The schema takes a tenth of a second to make, so it is made only where there is a finding.
    value, findings = None, list(document.findings)
    if not isinstance(document.data, dict):
        if not findings:
            what = "is empty" if document.data is None else show(document.data).replace("is", "holds", 1)
            required = schema_of(model).get("required", ())
            found = document.place(Finding((), f"the file {what}, expected a mapping with {join(required, 'and')}"))
            findings = [replace(found, line=1, column=1) if document.data is None else found]
        return None, _first(findings)
    for text in overrides:
        findings += [replace(finding, source=f"--set {text}") for finding in override(document, text, schema_of(model))]
    if document.nulls:
        refused = refused_nulls(document, schema_of(model))
        findings += map(document.place, refused)
        document.unreadable.update(finding.loc for finding in refused)
    try:
        # JSON is where pydantic's strict mode takes lists for tuples and whole numbers for floats, yet no other mix.
        value = model.model_validate_json(json.dumps(document.data), strict=True, context=context)
    except ValidationError as failure:
        findings += translate(failure, document, schema_of(model))
        findings_in: Callable[[Any], list[Finding]] | None = getattr(model, "findings_in", None)
        findings += map(document.place, findings_in(document.data) if findings_in else [])
    return value, _first(findings)


def _first(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings in the order of their lines, each once."""
    unique = {str(finding): finding for finding in findings}
    found = sorted(unique.values(), key=lambda finding: (finding.line or 10**9, finding.column))
    return _cut(found)


def _cut(found: list[Finding]) -> list[Finding]:
    """Return findings; of too many the first ones, and one that says so."""
    if len(found) <= MOST_FINDINGS:
        return found
    return [*found[:MOST_FINDINGS], replace(found[MOST_FINDINGS], loc=(), of_key=None, message="more is wrong here")]


def override(document: Document, text: str, top: Part) -> list[Finding]:
    """Lay one ``KEY=VALUE`` over the data of a file; return what is wrong with it, not placed.

    Where text is expected, the value is text, be it a number or what looks like a comment, such as a colour.
    """
    key, equals, written = text.partition("=")
    if not equals or not re.fullmatch(r"[^.\[\]]+(\.[^.\[\]]+|\[\d+\])*", key):
        return [Finding((), "is no override, expected KEY=VALUE, such as seed=3 or groups[0].count=12")]
    value: Any = document.data
    expected = top
    loc: Loc = ()
    chain: list[tuple[Any, Any]] = []
    for part in re.findall(r"[^.\[\]]+", key):
        member = chosen(expected, value if isinstance(value, dict) else {})
        known = keys(member)
        # A value that is no mapping is replaced where its key may hold one: seconds for a number of frames.
        if value is None or (not isinstance(value, dict) and member is not expected and part in known):
            value = [] if member.get("type") == "array" else {}
        if isinstance(value, list) and not (part.isdigit() and int(part) < len(value)):
            some = f"an index from 0 to {len(value) - 1}" if value else "none: the list is empty"
            return [Finding(loc, f"there is no item {part}, expected {some}")]
        if not isinstance(value, list | dict):
            return [Finding((*loc, part), f"{key_path(loc)} {show(value)}, expected a mapping")]
        if isinstance(value, dict) and known and part not in known:
            return [unknown_key((*loc, part), member)]
        at = int(part) if isinstance(value, list) else part
        chain.append((value, at))
        loc, expected, value = (*loc, at), step(member, at), value[at] if holds(value, at) else None
    given = read_document(written.encode("utf-8", "replace"), "")
    if not given.marks and given.findings:
        given.unreadable.add(())  # it is no YAML
    elif expected.get("type") == "string" and not words(expected) and not isinstance(given.data, str | dict | list):
        given = given if scalar(written.strip()) is None else Document("", written.strip())
    value = given.data
    for container, at in reversed(chain):
        container[at] = value
        value = container
    mark = (f"--set {text}", 0, 0)
    document.marks = {other: mark for other, mark in document.marks.items() if other[: len(loc)] != loc}
    for end in range(1, len(loc) + 1):
        document.marks.setdefault(loc[:end], (mark, mark))
    document.unreadable = {other for other in document.unreadable if other[: len(loc)] != loc}
    document.nulls = {other: what for other, what in document.nulls.items() if other[: len(loc)] != loc}
    document.nulls |= {(*loc, *inner): what for inner, what in given.nulls.items()}
    if given.data is None and not given.findings and not written.strip():
        document.nulls[loc] = "is empty"
    document.unreadable |= {(*loc, *inner) for inner in given.unreadable}
    return [Finding((*loc, *finding.loc), finding.message) for finding in given.findings]

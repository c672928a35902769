"""Text of a YAML file as a tree in which every key and value knows its line and column.

PyYAML parses; what plain words mean is decided here, after YAML 1.2: ``1e3`` and ``1_000`` are numbers, ``yes``, ``on``
and ``12:30`` are text. Nothing is ever constructed but text, numbers, booleans, null, lists and mappings.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import yaml

from crowdsim.config.syntax import explain

MAXIMUM_BYTES = 1_048_576
MAXIMUM_VALUES = 100_000
MAXIMUM_DEPTH = 64

_INTEGER = re.compile(r"[-+]?[0-9]+(?:_[0-9]+)*|0x[0-9a-fA-F]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(?:[0-9]+(?:_[0-9]+)*\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_WORDS = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
_EMPTY = ("", "~", "null", "Null", "NULL")
_TAGS = {"str": str, "int": int, "float": float, "bool": bool, "null": type(None)}

Path = tuple[Any, ...]


@dataclass(frozen=True)
class Place:
    """Where something was written: a file's line and column, counted from 1, or only a source such as an option."""

    source: str
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        return self.source if self.line is None else f"{self.source}:{self.line}:{self.column}"


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, printed as ``PATH:LINE:COLUMN: key.path: what is wrong, what was expected``."""

    place: Place
    key: str
    message: str

    def __str__(self) -> str:
        text = f"{self.place}: {self.key}: {self.message}" if self.key else f"{self.place}: {self.message}"
        return re.sub(r"\s+", " ", text).strip()


@dataclass
class Entry:
    """A value with the place of its key and of itself; mappings hold entries by key and lists hold entries."""

    value: Any
    place: Place
    key_place: Place

    def plain(self) -> Any:
        """Return the value without places: nested dicts, lists and scalars."""
        if isinstance(self.value, dict):
            return {key: entry.plain() for key, entry in self.value.items()}
        if isinstance(self.value, list):
            return [entry.plain() for entry in self.value]
        return self.value


class TreeError(Exception):
    """The text holds no tree at all; ``finding`` says why."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(str(finding))
        self.finding = finding


def key_path(path: Path) -> str:
    """Return a path in words: ``("groups", 0, "count")`` is ``groups[0].count``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def scalar(text: str) -> Any:
    """Return what an unquoted word means: None, a boolean, a number or the text; inf and nan come back as floats."""
    if text in _EMPTY:
        return None
    if text in _WORDS:
        return _WORDS[text]
    if len(text) < 400 and _INTEGER.fullmatch(text):
        return int(text, 0 if text[:2] in ("0x", "0o") else 10)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", ""))
    if len(text) < 400 and _FLOAT.fullmatch(text):
        number = float(text)
        return int(number) if number.is_integer() and abs(number) < 2**53 else number
    return text


def read_tree(data: bytes, source: str) -> tuple[Entry | None, list[Finding]]:
    """Return the tree of a file's bytes, None where it holds no value, and what is wrong with its keys and words.

    Raises:
        TreeError: The bytes are no YAML, or too large.
    """
    text = _decode(data, source)
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        raise TreeError(_broken(error, text, source)) from None
    except yaml.reader.ReaderError as error:
        # Positions count characters of the text as a whole.
        code = error.character if isinstance(error.character, int) else ord(str(error.character))
        what = f"broken YAML: the character U+{code:04X} cannot stand in a file"
        raise TreeError(Finding(_place_of(text, error.position, source), "", what)) from None
    except RecursionError:
        what = f"nested too deeply, expected at most {MAXIMUM_DEPTH} levels"
        raise TreeError(Finding(Place(source, 1, 1), "", what)) from None
    except ValueError as error:
        raise TreeError(Finding(Place(source, 1, 1), "", f"broken YAML: {error}")) from None
    if node is None:
        return None, []
    builder = _Builder(source)
    return builder.build(node, (), None), builder.findings


def _decode(data: bytes, source: str) -> str:
    if len(data) > MAXIMUM_BYTES:
        what = f"the file is too large, expected at most {MAXIMUM_BYTES:,} bytes"
        raise TreeError(Finding(Place(source, 1, 1), "", what))
    data = data.removeprefix(b"\xef\xbb\xbf")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8")
        what = f"byte 0x{data[error.start]:02x} is no UTF-8, expected a text file in UTF-8"
        raise TreeError(Finding(_place_of(before, len(before), source), "", what)) from None


def _place_of(text: str, position: int, source: str) -> Place:
    before = text[:position]
    return Place(source, before.count("\n") + 1, position - (before.rfind("\n") + 1) + 1)


def _broken(error: yaml.MarkedYAMLError, text: str, source: str) -> Finding:
    line, column, message = explain(error, text)
    return Finding(Place(source, line, column), "", message)


class _Builder:
    """Turns PyYAML's nodes into entries; keeps count, so that aliases cannot blow up."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.findings: list[Finding] = []
        self.count = 0
        self.open: list[yaml.Node] = []

    def place(self, node: yaml.Node) -> Place:
        return Place(self.source, node.start_mark.line + 1, node.start_mark.column + 1)

    def note(self, node: yaml.Node, path: Path, message: str) -> None:
        self.findings.append(Finding(self.place(node), key_path(path), message))

    def tally(self, node: yaml.Node, path: Path) -> None:
        self.count += 1
        if self.count > MAXIMUM_VALUES:
            what = f"the file unfolds to more than {MAXIMUM_VALUES:,} values, expected fewer aliases"
            raise TreeError(Finding(self.place(node), key_path(path), what))

    def build(self, node: yaml.Node, path: Path, key_place: Place | None) -> Entry | None:
        """Return the entry of a node, or None where a finding says why there is none."""
        self.tally(node, path)
        if any(node is other for other in self.open):
            self.note(node, path, "refers to itself, expected a value")
            return None
        if len(self.open) > MAXIMUM_DEPTH:
            what = f"nested too deeply, expected at most {MAXIMUM_DEPTH} levels"
            raise TreeError(Finding(self.place(node), "", what))
        if not self.tag_is_safe(node, path):
            return None
        entry = Entry(None, self.place(node), key_place or self.place(node))
        self.open.append(node)
        if isinstance(node, yaml.MappingNode):
            entry.value = dict(self.pairs(node, path))
        elif isinstance(node, yaml.SequenceNode):
            # A faulty item leaves an empty one behind, so that the items after it keep their numbers.
            items = [(child, self.build(child, (*path, i), None)) for i, child in enumerate(node.value)]
            entry.value = [item or Entry(FAULTY, self.place(child), self.place(child)) for child, item in items]
        elif isinstance(node, yaml.ScalarNode):
            entry.value = self.scalar(node, path)
        self.open.pop()
        return entry

    def tag_is_safe(self, node: yaml.Node, path: Path) -> bool:
        kind = node.tag.removeprefix("tag:yaml.org,2002:")
        # The resolver of PyYAML gives plain words tags of YAML 1.1, which scalar() does not need.
        if kind in ("map", "seq", "merge", "value", "timestamp", *_TAGS):
            return True
        name = f"!!{kind}" if kind != node.tag else node.tag
        self.note(node, path, f"the tag '{name}' is not allowed, expected a plain value")
        return False

    def scalar(self, node: yaml.ScalarNode, path: Path) -> Any:
        if node.style is not None:
            return node.value
        value = scalar(node.value)
        if isinstance(value, float) and not math.isfinite(value):
            self.note(node, path, f"is {node.value}, expected a finite number")
            return FAULTY
        return value

    def pairs(self, node: yaml.MappingNode, path: Path) -> Iterator[tuple[str, Entry]]:
        """Yield the keys of a mapping with their entries; each key once, those merged in by ``<<`` last."""
        lines: dict[str, int] = {}
        merged: list[yaml.Node] = []
        for key_node, value_node in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else None
            if key == "<<" and key_node.style is None:
                many = isinstance(value_node, yaml.SequenceNode)
                merged += value_node.value if many else [value_node]
                continue
            meaning = scalar(key) if key is not None and key_node.style is None else key
            if key is None or not isinstance(meaning, str):
                what = (
                    "a list or mapping" if key is None else "empty" if meaning is None else f"{key}, which is no text"
                )
                self.note(
                    key_node, path, f"a key is {what}, expected text{' in quotes' if meaning is not None else ''}"
                )
                continue
            if key in lines:
                self.note(key_node, (*path, key), f"duplicate key, expected it once; it stands in line {lines[key]}")
                continue
            lines[key] = key_node.start_mark.line + 1
            entry = self.build(value_node, (*path, key), self.place(key_node))
            yield key, entry or Entry(FAULTY, self.place(value_node), self.place(key_node))
        for other in merged:
            if not isinstance(other, yaml.MappingNode):
                self.note(other, path, "'<<' merges no mapping, expected an alias of one")
                continue
            if any(other is parent for parent in self.open):
                self.note(other, path, "'<<' merges a mapping into itself, expected another one")
                continue
            self.tally(other, path)
            self.open.append(other)
            for key, entry in self.pairs(other, path):
                if key not in lines:
                    lines[key] = other.start_mark.line + 1
                    yield key, replace(entry)
            self.open.pop()


class _Faulty:
    """Stands where a value could not be read, so that nothing more is said about that place."""

    def __repr__(self) -> str:
        return "FAULTY"


FAULTY = _Faulty()

"""Text of a YAML file as plain data, and the position of each of its keys and values.

PyYAML parses; what plain words mean is decided here, after YAML 1.2: ``1e3`` and ``1_000`` are numbers, ``yes``, ``on``
and ``12:30`` are text. Nothing is ever constructed but text, numbers, booleans, null, lists and mappings.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any

import yaml

from crowdsim.config.nodes import (
    MAPPING,
    MAXIMUM_BYTES,
    MAXIMUM_DEPTH,
    MAXIMUM_KEYS,
    MAXIMUM_VALUES,
    SCALAR,
    SEQUENCE,
    TOO_DEEP,
    Node,
    Refused,
    compose,
)

MOST_FINDINGS = 100
"""How many findings are reported of a file."""

_INTEGER = re.compile(r"[-+]?[0-9]+(?:_[0-9]+)*|0x[0-9a-fA-F]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(?:[0-9]+(?:_[0-9]+)*\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)")
_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
# PyYAML tags plain words by YAML 1.1, timestamps among them; scalar() decides what they are.
_TAGS = ("map", "seq", "str", "int", "float", "bool", "null", "merge", "value", "timestamp")
_SURROGATE = re.compile("[\ud800-\udfff]")

Loc = tuple[Any, ...]
"""Keys and indices that lead to a value, as pydantic has them: ``("groups", 0, "count")``."""
Mark = tuple[str, int, int]
"""Source, line and column; the line is 0 where there is only a source, such as an option."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, printed as ``PATH:LINE:COLUMN: key.path: what is wrong, what was expected``.

    Checks name what is to blame; ``Document.place`` adds the source, and line and column, counted from 1.

    Attributes:
        loc: What is to blame; nothing for the whole file.
        message: What is wrong, and what was expected.
        of_key: A location whose key is to blame, not its value.
        source: A file, or an option; empty as long as the finding is not placed.
        line: Line; 0 where there is only a source.
        column: Column.
    """

    loc: Loc
    message: str
    of_key: Loc | None = None
    source: str = ""
    line: int = 0
    column: int = 0

    @property
    def key(self) -> str:
        """The key path in words; empty for the whole file."""
        return key_path(self.loc)

    def __str__(self) -> str:
        where = f"{self.source}:{self.line}:{self.column}" if self.line else self.source
        return " ".join(": ".join(part for part in (where, self.key, self.message) if part).split())


@dataclass
class Document:
    """Plain data of a file, and where its keys and values are written.

    Attributes:
        source: Name of the file.
        data: The data; None where a value could not be read.
        marks: Where each value is written and where its key is: source, line and column.
        unreadable: Locations of values that could not be read; a finding says why.
        nulls: What the values that are null or empty are called.
        findings: What is wrong with the text.
    """

    source: str
    data: Any = None
    marks: dict[Loc, tuple[Mark, Mark]] = field(default_factory=dict)
    unreadable: set[Loc] = field(default_factory=set)
    nulls: dict[Loc, str] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)

    def place(self, finding: Finding) -> Finding:
        """Return a finding with its position, or that of the nearest value above it that is written."""
        of_key = finding.of_key is not None
        source, line, column = self.position(finding.of_key if finding.of_key is not None else finding.loc, of_key)
        return replace(finding, source=source, line=line, column=column)

    def position(self, loc: Loc, of_key: bool = False) -> Mark:
        """Return where a value, or its key, is written, or the nearest value above it that is written."""
        found = loc
        while found and found not in self.marks:
            found = found[:-1]
        marks = self.marks.get(found, ((self.source, 0, 0),) * 2)
        return marks[of_key and found == loc]

    def hides(self, loc: Loc) -> bool:
        """Whether a location is that of a value that could not be read, lies in one or above one."""
        return any(all(a == b for a, b in zip(loc, other, strict=False)) for other in self.unreadable)


def key_path(loc: Loc) -> str:
    """Return a location in words: ``("groups", 0, "count")`` is ``groups[0].count``."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{shortened(str(part))}" for part in loc)
    return "".join(parts).removeprefix(".")


def shortened(text: str, most: int = 60) -> str:
    """Return text for a message, cut off where it is long."""
    return text if len(text) <= most else text[: most - 3] + "..."


def scalar(text: str) -> Any:
    """Return what an unquoted word means: None, a boolean, a number or the text; inf and nan come back as floats."""
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


def read_document(data: bytes, source: str) -> Document:
    """Return the data of a file's bytes with positions, and what is wrong with them as findings."""
    builder = _Builder(Document(source))
    try:
        text = _decode(data)
        builder.lines = text.split("\n")
        node = compose(text)
        builder.document.data = None if node is None else builder.build(node, ())
        return builder.document
    except Enough:
        return Document(source, findings=builder.document.findings)
    except Refused as error:
        line, column, what = error.args
    return Document(source, findings=[Finding((), what, None, source, line, column)])


def _decode(data: bytes) -> str:
    """Return the text of a file's bytes."""
    if len(data) > MAXIMUM_BYTES:
        raise Refused(1, 1, f"the file is too large, expected at most {MAXIMUM_BYTES:,} bytes")
    text = data.decode("utf-8-sig", "surrogateescape")
    wrong = yaml.reader.Reader.NON_PRINTABLE.search(text)
    if wrong is not None:
        before, character = text[: wrong.start()], ord(wrong[0])
        what = f"broken YAML: the character U+{character:04X} is not allowed"
        if 0xDC80 <= character <= 0xDCFF:  # what "surrogateescape" makes of a byte
            what = f"byte 0x{character & 0xFF:02x} is no UTF-8, expected a text file in UTF-8"
        raise Refused(before.count("\n") + 1, len(before) - before.rfind("\n"), what)
    return text


class Enough(Exception):
    """So much is wrong with the text that the file is not read any further."""


class _Builder:
    """Turns nodes into plain data; counts them, so that aliases cannot blow up."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.lines: list[str] = []
        self.count = 0
        self.above: list[Node] = []

    def build(self, node: Node, loc: Loc, key: Node | None = None) -> Any:
        """Return the value of a node; None where a finding says why there is none."""
        source = self.document.source
        mark = (source, node.line, node.column)
        self.document.marks[loc] = mark, mark if key is None else (source, key.line, key.column)
        value = _meaning(node)
        wrong = ""
        if node.tag and node.tag.removeprefix("!!") not in _TAGS:
            wrong = f"the tag '{shortened(node.tag)}' is not allowed, expected a plain value"
        elif isinstance(value, float) and not math.isfinite(value):
            wrong = f"is {node.value}, expected a finite number"
        elif isinstance(value, str):
            wrong = "holds a lone surrogate, expected characters" if _SURROGATE.search(value) else ""
        elif value is node and any(node is other for other in self.above):
            wrong = "refers to itself, expected a value"
        if wrong:
            self.note(node, loc, wrong)
            self.document.unreadable.add(loc)
            return None
        if value is None:
            self.document.nulls[loc] = "is null" if node.value else f"is empty{self.comment_behind(key or node)}"
        self.enter(node)
        if node.kind == MAPPING:
            value = {key: self.build(inner, (*loc, key), at) for key, (at, inner) in self.pairs(node, loc).items()}
        elif node.kind == SEQUENCE:
            value = [self.build(item, (*loc, i)) for i, item in enumerate(node.items)]
        self.above.pop()
        return value

    def comment_behind(self, node: Node) -> str:
        """Say that a comment stands where the value that follows a node should be, such as a colour without quotes."""
        # YAML knows other line breaks, too.
        line = self.lines[node.line - 1] if node.line <= len(self.lines) else ""
        _, mark, rest = line[node.column - 1 :].partition("#")
        word = rest.split(maxsplit=1)[0] if rest[:1].strip() else ""
        return f", since # begins a comment where '#{shortened(word)}' has no quotes" if mark and word else ""

    def pairs(self, node: Node, loc: Loc) -> dict[str, tuple[Node, Node]]:
        """Return the nodes of key and value by key; each key once, those merged in by ``<<`` last."""
        if len(node.items) > 2 * MAXIMUM_KEYS:
            self.note(node, loc, f"a mapping of {len(node.items) // 2:,} keys, expected at most {MAXIMUM_KEYS:,}")
            raise Enough
        pairs: dict[str, tuple[Node, Node]] = {}
        merged: list[Node] = []
        for key_node, value in zip(node.items[::2], node.items[1::2], strict=True):
            key = _meaning(key_node)
            if key == "<<" and key_node.is_plain:
                merged += value.items if value.kind == SEQUENCE else [value]
            elif key is None or key is key_node:
                self.note(key_node, loc, f"a key is {'empty' if key is None else 'a list or mapping'}, expected text")
            elif not isinstance(key, str):
                what = shortened(key_node.value)
                self.note(key_node, loc, f"a key is {what}, which is no text, expected text in quotes")
            elif _SURROGATE.search(key):
                self.note(key_node, loc, "a key holds a lone surrogate, expected characters")
            elif key in pairs:
                line = pairs[key][0].line
                self.note(key_node, (*loc, key), f"duplicate key, expected it once; it is already in line {line}")
            else:
                pairs[key] = key_node, value
        for other in merged:
            if other.kind != MAPPING:
                self.note(other, loc, "'<<' merges no mapping, expected an alias of one")
            elif any(other is one for one in self.above):
                self.note(other, loc, "'<<' merges a mapping into itself, expected another one")
            else:
                self.enter(other, len(other.items) // 2)
                pairs |= {key: nodes for key, nodes in self.pairs(other, loc).items() if key not in pairs}
                self.above.pop()
        return pairs

    def enter(self, node: Node, more: int = 0) -> None:
        """Count a node, and more with it, as one that lies above those to come."""
        self.count += 1 + more
        self.above.append(node)
        if self.count > MAXIMUM_VALUES:
            what = f"the file unfolds to more than {MAXIMUM_VALUES:,} values, expected fewer aliases"
            raise Refused(node.line, node.column, what)
        if len(self.above) > MAXIMUM_DEPTH + 1:
            raise Refused(node.line, node.column, TOO_DEEP)

    def note(self, node: Node, loc: Loc, message: str) -> None:
        """Note what is wrong with a node."""
        self.document.findings.append(Finding(loc, message, None, self.document.source, node.line, node.column))
        if len(self.document.findings) > MOST_FINDINGS:
            raise Enough


def _meaning(node: Node) -> Any:
    """Return what a node of text means; any other node as it is."""
    if node.kind != SCALAR:
        return node
    return scalar(node.value) if node.is_plain else node.value

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

from crowdsim.config.syntax import explain

MAXIMUM_BYTES = 1_048_576
MAXIMUM_VALUES = 100_000
MAXIMUM_DEPTH = 64

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
_TOO_DEEP = f"nested too deeply, expected at most {MAXIMUM_DEPTH} levels"

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
        findings: What is wrong with the text.
    """

    source: str
    data: Any = None
    marks: dict[Loc, tuple[Mark, Mark]] = field(default_factory=dict)
    unreadable: set[Loc] = field(default_factory=set)
    findings: list[Finding] = field(default_factory=list)

    def place(self, finding: Finding) -> Finding:
        """Return a finding with its position, or that of the nearest value above it that is written."""
        loc = finding.loc if finding.of_key is None else finding.of_key
        while loc and loc not in self.marks:
            loc = loc[:-1]
        source, line, column = self.marks.get(loc, ((self.source, 0, 0),) * 2)[loc == finding.of_key]
        return replace(finding, source=source, line=line, column=column)

    def hides(self, loc: Loc) -> bool:
        """Whether a location is that of a value that could not be read, lies in one or above one."""
        return any(all(a == b for a, b in zip(loc, other, strict=False)) for other in self.unreadable)


def key_path(loc: Loc) -> str:
    """Return a location in words: ``("groups", 0, "count")`` is ``groups[0].count``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).removeprefix(".")


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
    builder, text = _Builder(Document(source)), ""
    line, column = 1, 1
    try:
        text = data.decode("utf-8-sig", "surrogateescape")
        if len(data) > MAXIMUM_BYTES:
            raise _Refused(1, 1, f"the file is too large, expected at most {MAXIMUM_BYTES:,} bytes")
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        builder.document.data = None if node is None else builder.build(node, ())
        return builder.document
    except _Refused as error:
        line, column, what = error.args
    except yaml.MarkedYAMLError as error:
        line, column, what = explain(error, text)
    except yaml.reader.ReaderError as error:
        before, character = text[: error.position], ord(text[error.position])
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        what = f"broken YAML: the character U+{character:04X} is not allowed"
        if 0xDC80 <= character <= 0xDCFF:  # what "surrogateescape" makes of a byte
            what = f"byte 0x{character & 0xFF:02x} is no UTF-8, expected a text file in UTF-8"
    except RecursionError:
        what = _TOO_DEEP
    except (ValueError, OverflowError) as error:
        what = f"broken YAML: {error}"
    return Document(source, findings=[Finding((), what, None, source, line, column)])


class _Refused(Exception):
    """The file is not read any further: line, column and message."""


class _Builder:
    """Turns PyYAML's nodes into plain data; counts them, so that aliases cannot blow up."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.count = 0
        self.above: list[yaml.Node] = []

    def build(self, node: yaml.Node, loc: Loc, key: yaml.Node | None = None) -> Any:
        """Return the value of a node; None where a finding says why there is none."""
        self.document.marks[loc] = self.mark(node), self.mark(key or node)
        tag = node.tag.replace("tag:yaml.org,2002:", "!!")
        value = _meaning(node)
        wrong = ""
        if node in self.above:
            wrong = "refers to itself, expected a value"
        elif tag.removeprefix("!!") not in _TAGS:
            wrong = f"the tag '{tag}' is not allowed, expected a plain value"
        elif isinstance(value, float) and not math.isfinite(value):
            wrong = f"is {node.value}, expected a finite number"
        if wrong:
            self.note(node, loc, wrong)
            self.document.unreadable.add(loc)
            return None
        self.enter(node)
        if isinstance(node, yaml.MappingNode):
            value = {key: self.build(inner, (*loc, key), at) for key, (at, inner) in self.pairs(node, loc).items()}
        elif isinstance(node, yaml.SequenceNode):
            value = [self.build(item, (*loc, i)) for i, item in enumerate(node.value)]
        self.above.pop()
        return value

    def pairs(self, node: yaml.MappingNode, loc: Loc) -> dict[str, tuple[yaml.Node, yaml.Node]]:
        """Return the nodes of key and value by key; each key once, those merged in by ``<<`` last."""
        pairs: dict[str, tuple[yaml.Node, yaml.Node]] = {}
        merged: list[yaml.Node] = []
        for key_node, value in node.value:
            key = _meaning(key_node)
            if key == "<<" and key_node.style is None:
                merged += value.value if isinstance(value, yaml.SequenceNode) else [value]
            elif key is None or key is key_node:
                self.note(key_node, loc, f"a key is {'empty' if key is None else 'a list or mapping'}, expected text")
            elif not isinstance(key, str):
                self.note(key_node, loc, f"a key is {key_node.value}, which is no text, expected text in quotes")
            elif key in pairs:
                line = pairs[key][0].start_mark.line + 1
                self.note(key_node, (*loc, key), f"duplicate key, expected it once; it is already in line {line}")
            else:
                pairs[key] = key_node, value
        for other in merged:
            if not isinstance(other, yaml.MappingNode):
                self.note(other, loc, "'<<' merges no mapping, expected an alias of one")
            elif other in self.above:
                self.note(other, loc, "'<<' merges a mapping into itself, expected another one")
            else:
                self.enter(other)
                pairs |= {key: nodes for key, nodes in self.pairs(other, loc).items() if key not in pairs}
                self.above.pop()
        return pairs

    def enter(self, node: yaml.Node) -> None:
        """Count a node, as one that lies above those to come."""
        self.count += 1
        self.above.append(node)
        if self.count > MAXIMUM_VALUES:
            what = f"the file unfolds to more than {MAXIMUM_VALUES:,} values, expected fewer aliases"
            raise _Refused(*self.mark(node)[1:], what)
        if len(self.above) > MAXIMUM_DEPTH + 1:
            raise _Refused(*self.mark(node)[1:], _TOO_DEEP)

    def note(self, node: yaml.Node, loc: Loc, message: str) -> None:
        self.document.findings.append(Finding(loc, message, None, *self.mark(node)))

    def mark(self, node: yaml.Node) -> Mark:
        return self.document.source, node.start_mark.line + 1, node.start_mark.column + 1


def _meaning(node: yaml.Node) -> Any:
    """Return what a node of text means; any other node as it is."""
    if not isinstance(node, yaml.ScalarNode):
        return node
    return scalar(node.value) if node.style is None else node.value

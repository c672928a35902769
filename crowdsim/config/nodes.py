"""YAML text as nodes: what a parser finds, put together without recursion and within limits.

The parser is libyaml where PyYAML has it, since it is thirty times faster. What it refuses is read again by PyYAML's
own parser, whose errors say more, unless that would read far.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from crowdsim.config.schema import join

MAXIMUM_BYTES = 1_048_576
MAXIMUM_VALUES = 100_000
MAXIMUM_DEPTH = 64
MAXIMUM_KEYS = 10_000

TOO_DEEP = f"nested too deeply, expected at most {MAXIMUM_DEPTH} levels"
SCALAR, SEQUENCE, MAPPING = range(3)

_FAST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_LONG = 65_536


class Refused(Exception):
    """The file is not read any further: line, column and message."""


@dataclass(eq=False)
class Node:
    """A value as it is written.

    Attributes:
        kind: ``SCALAR``, ``SEQUENCE`` or ``MAPPING``.
        line, column: Where it begins, from 1.
        tag: Its tag, ``!!`` for YAML's own; empty where it has none.
        value: The text of a scalar.
        is_plain: Whether a scalar has no quotes and is no block.
        items: What is in a sequence; keys and values of a mapping in turn.
    """

    __slots__ = ("column", "is_plain", "items", "kind", "line", "tag", "value")

    kind: int
    line: int
    column: int
    tag: str
    value: str
    is_plain: bool
    items: list[Node]


def compose(text: str) -> Node | None:
    """Return the node of the only document of a text; None where it holds none.

    Raises:
        Refused: It is no YAML, too long or nested too deeply.
    """
    failure: Exception
    try:
        return _compose(yaml.parse(text, Loader=_FAST))
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        failure = error
    if _FAST is not yaml.SafeLoader and _position(failure, text) <= _LONG:
        try:
            _compose(yaml.parse(text, Loader=yaml.SafeLoader))
        except yaml.YAMLError as error:
            failure = error
        except (ValueError, OverflowError):
            # PyYAML stumbles over such escapes; what libyaml says is right.
            pass
    if isinstance(failure, yaml.MarkedYAMLError):
        raise Refused(*explain(failure, text))
    raise Refused(1, 1, f"broken YAML: {failure}")


def _position(failure: Exception, text: str) -> int:
    """Return up to where a text was read before it was refused."""
    mark = failure.problem_mark if isinstance(failure, yaml.MarkedYAMLError) else None
    return len(text) if mark is None else int(mark.index)


def _compose(events: Iterator[Any]) -> Node | None:
    """Put the events of a parser together."""
    documents: list[Node] = []
    above: list[Node] = []
    anchors: dict[str, Node] = {}
    count = 0
    for event in events:
        kind = type(event)
        if kind is yaml.SequenceEndEvent or kind is yaml.MappingEndEvent:
            above.pop()
            continue
        if kind is yaml.AliasEvent:
            if event.anchor not in anchors:
                raise _refused(event, f"broken YAML: found undefined alias {event.anchor[:60]!r}")
            node = anchors[event.anchor]
        elif kind in _KINDS:
            node = _node(event, _KINDS[kind])
            if event.anchor is not None:
                anchors[event.anchor] = node
        elif kind is yaml.DocumentStartEvent and documents:
            raise _refused(event, "another document begins, expected a single one in the file")
        else:
            continue
        count += 1
        if count > 2 * MAXIMUM_VALUES:
            raise _refused(event, f"the file holds more than {MAXIMUM_VALUES:,} values, expected fewer")
        (above[-1].items if above else documents).append(node)
        if kind is yaml.SequenceStartEvent or kind is yaml.MappingStartEvent:
            above.append(node)
            if len(above) > MAXIMUM_DEPTH + 1:
                raise _refused(event, TOO_DEEP)
    return documents[0] if documents else None


_KINDS: dict[type, int] = {yaml.ScalarEvent: SCALAR, yaml.SequenceStartEvent: SEQUENCE, yaml.MappingStartEvent: MAPPING}


def _node(event: Any, kind: int) -> Node:
    mark, tag = event.start_mark, event.tag
    tag = "" if tag is None or tag == "!" else tag.replace("tag:yaml.org,2002:", "!!")
    if kind == SCALAR:
        return Node(kind, mark.line + 1, mark.column + 1, tag, event.value, not event.style, [])
    return Node(kind, mark.line + 1, mark.column + 1, tag, "", False, [])


def _refused(event: Any, what: str) -> Refused:
    return Refused(event.start_mark.line + 1, event.start_mark.column + 1, what)


_KEY = re.compile(
    r"\s*(?:- +)*(?:\"[^\"]*\"\s*|'[^']*'\s*|[^\s#'\"{}\[\],&*!|>%@`:-][^#:]*(?::(?!\s|$)[^#:]*)*):(\s|$)"
)
_NO_BLANK = re.compile(r"\s*(?:- +)*[\w.-]+:[^\s/]")
_OF_LIBYAML = ("did not find expected key", "did not find expected '-' indicator")
_DASHES = re.compile(r"\s*(?:- +)+")


def explain(error: yaml.MarkedYAMLError, text: str) -> tuple[int, int, str]:
    """Return line, column and a message for an error of PyYAML; lines and columns count from 1."""
    mark, start = error.problem_mark or error.context_mark, error.context_mark
    problem = str(error.problem or "cannot be read")
    if mark is None:
        return 1, 1, f"broken YAML: {problem}"
    lines, here = text.splitlines(), (mark.line + 1, mark.column + 1)
    if problem.startswith(("mapping values are not allowed", "expected <block end>", *_OF_LIBYAML)):
        wrong = _wrong_indentation(lines, mark.line)
        if wrong is not None:
            return mark.line + 1, _indentation(lines[mark.line]) + 1, wrong
    if problem == "expected <block end>, but found '-'":
        return *here, "broken YAML: a list item among keys, expected KEY: VALUE"
    if problem == "expected <block end>, but found '?'":
        return *here, "broken YAML: a key among the items of a list, expected '- '"
    if problem.startswith("mapping values are not allowed"):
        above = lines[mark.line - 1] if 0 < mark.line <= len(lines) else ""
        if _NO_BLANK.match(above):
            return mark.line, above.index(":") + 2, "broken YAML: no blank after the ':', expected KEY: VALUE"
        return *here, "broken YAML: a second ':' in a value, expected quotes around text that holds ': '"
    if problem == "could not find expected ':'" and start is not None:
        word = lines[start.line][start.column :].strip() if start.line < len(lines) else ""
        word = word if len(word) <= 60 else word[:57] + "..."
        return start.line + 1, start.column + 1, f"broken YAML: {word!r} has no ':', expected KEY: VALUE"
    if "'\\t'" in problem:
        problem += "; indent with spaces, not with tabs"
    context = f"{error.context}: " if error.context else ""
    return *here, f"broken YAML: {context}{problem}"


def _wrong_indentation(lines: list[str], number: int) -> str | None:
    """Return how far a line should be indented, or None where its indentation is not what is wrong."""
    if number >= len(lines) or not (_KEY.match(lines[number]) or _DASHES.match(lines[number])):
        return None
    own, fitting, least = _indentation(lines[number]), dict[int, int](), 10**9
    for above in range(number - 1, -1, -1):
        line = lines[above]
        if line.strip() and not line.lstrip().startswith("#"):
            dashes = _DASHES.match(line) if _KEY.match(line) else None
            for start in (dashes.end() if dashes else least, _indentation(line)):
                if start < least:
                    fitting.setdefault(start, above + 1)
            least = min(least, _indentation(line))
    if not fitting or own in fitting:
        return None
    choices = [f"{spaces} as in line {line}" for spaces, line in sorted(fitting.items(), reverse=True)]
    return f"wrong indentation of {own} space{'s'[: own != 1]}, expected {join(choices)}"


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip(" "))

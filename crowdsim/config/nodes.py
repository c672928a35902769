"""YAML text as nodes: what a parser finds, put together without recursion and within limits.

The parser is libyaml where PyYAML has it, since it is thirty times faster. What it refuses is read again by PyYAML's
own parser, whose errors say more, unless that would read far.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from crowdsim.config.syntax import explain

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
    """Put the events of a parser together.

    Raises:
        yaml.YAMLError: It is no YAML.
        Refused: There is more than one document, too much of it, or it is nested too deeply.
    """
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


_KINDS: dict[type, int] = {
    yaml.ScalarEvent: SCALAR,
    yaml.SequenceStartEvent: SEQUENCE,
    yaml.MappingStartEvent: MAPPING,
}


def _node(event: Any, kind: int) -> Node:
    mark, tag = event.start_mark, event.tag
    tag = "" if tag is None or tag == "!" else tag.replace("tag:yaml.org,2002:", "!!")
    if kind == SCALAR:
        return Node(kind, mark.line + 1, mark.column + 1, tag, event.value, not event.style, [])
    return Node(kind, mark.line + 1, mark.column + 1, tag, "", False, [])


def _refused(event: Any, what: str) -> Refused:
    return Refused(event.start_mark.line + 1, event.start_mark.column + 1, what)

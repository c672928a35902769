"""Values given beside a file, such as ``groups[0].count=12``, laid over its data."""

from __future__ import annotations

import re
from typing import Any

from crowdsim.config.findings import holds, show, unknown_key
from crowdsim.config.schema import Part, chosen, keys, step, words
from crowdsim.config.tree import Document, Finding, Loc, key_path, read_document, scalar


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

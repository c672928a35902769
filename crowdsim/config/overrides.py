"""Values given beside a file, such as ``groups[0].count=12``, laid over its data."""

from __future__ import annotations

import re
from typing import Any

from crowdsim.config.findings import holds, show, unknown_key
from crowdsim.config.schema import Spot, chosen, step
from crowdsim.config.tree import Document, Finding, Loc, key_path, read_document, scalar


def override(document: Document, text: str, top: Spot) -> list[Finding]:
    """Lay one ``KEY=VALUE`` over the data of a file; return what is wrong with it, not placed.

    Where text is expected, the value is text, be it a number or what looks like a comment, such as a colour.
    """
    key, equals, words = text.partition("=")
    if not equals or not re.fullmatch(r"[^.\[\]]+(\.[^.\[\]]+|\[\d+\])*", key):
        return [Finding((), "is no override, expected KEY=VALUE, such as seed=3 or groups[0].count=12")]
    value: Any = document.data
    spot: Spot | None = top
    loc: Loc = ()
    chain: list[tuple[Any, Any]] = []
    for part in re.findall(r"[^.\[\]]+", key):
        member = chosen(spot, value)
        keys = member.keys if member is not None else []
        # What is no mapping gives way where its key may as well hold one: seconds for a number of frames.
        if value is None or (not isinstance(value, dict) and member is not spot and part in keys):
            value = [] if member is not None and member.is_list else {}
        if isinstance(value, list) and not (part.isdigit() and int(part) < len(value)):
            some = f"an index from 0 to {len(value) - 1}" if value else "none: the list is empty"
            return [Finding(loc, f"there is no item {part}, expected {some}")]
        if not isinstance(value, list | dict):
            return [Finding((*loc, part), f"{key_path(loc)} {show(value)}, expected a mapping")]
        if isinstance(value, dict) and keys and part not in keys:
            return [unknown_key((*loc, part), member)]
        at = int(part) if isinstance(value, list) else part
        chain.append((value, at))
        loc, spot, value = (*loc, at), step(member, at), value[at] if holds(value, at) else None
    given = read_document(words.encode("utf-8", "replace"), "")
    if not given.marks and given.findings:
        given.unreadable.add(())  # it is no YAML
    elif spot is not None and spot.kind is str and not isinstance(given.data, str | dict | list):
        given = given if scalar(words.strip()) is None else Document("", words.strip())
    value = given.data
    for container, at in reversed(chain):
        container[at] = value
        value = container
    mark = (f"--set {text}", 0, 0)
    document.marks = {known: mark for known, mark in document.marks.items() if known[: len(loc)] != loc}
    for end in range(1, len(loc) + 1):
        document.marks.setdefault(loc[:end], (mark, mark))
    document.unreadable = {known for known in document.unreadable if known[: len(loc)] != loc}
    document.unreadable |= {(*loc, *inner) for inner in given.unreadable}
    return [Finding((*loc, *finding.loc), finding.message) for finding in given.findings]

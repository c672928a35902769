"""When health is restored in a run, as its scenario says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any, NamedTuple


class Heal(NamedTuple):
    """Health that is restored to avatars ``first`` to ``stop`` after a time [s]."""

    seconds: float
    first: int
    stop: int


def find_heals(groups: Sequence[Mapping[str, Any]], events: Sequence[Mapping[str, Any]], rate: float) -> list[Heal]:
    """Return when events of a scenario restore health, and to which avatars.

    Args:
        groups: Groups of the resolved scenario, as plain data.
        events: Its events, likewise.
        rate: Control frames a second.
    """
    ends = list(accumulate((int(group["count"]) for group in groups), initial=0))
    numbers = {group["name"]: (first, stop) for group, first, stop in zip(groups, ends[:-1], ends[1:], strict=True)}
    found = []
    for event in events:
        if event["kind"] == "heal":
            when, member = event["when"], event.get("member")
            frame = when["frame"] if when["kind"] == "frame" else round(when["seconds"] * rate)
            first, stop = numbers.get(event.get("group"), (0, ends[-1]))
            if member is not None:
                first, stop = first + member, first + member + 1
            # Strikes of a control frame are those since the one before it.
            found.append(Heal((frame - 1) / rate + 1e-4, first, stop))
    return sorted(found)

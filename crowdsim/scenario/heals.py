"""When health is restored in a run: as its scenario says, and to those that come back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from operator import index
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.types import Array

_ROWS_AT_ONCE = 1 << 24


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
                first, stop = first + index(member), first + member + 1
            found.append(Heal(_before(frame, rate), first, stop))
    return sorted(found)


def find_returns(action: Array, avatars: Sequence[int], rate: float) -> list[Heal]:
    """Return when avatars come back into the scene, which restores their health.

    Those that are away for a single control frame have been put elsewhere, and are as healthy as they were.

    Args:
        action: Actions of a take, negative while avatars are away. Shape (T, N).
        avatars: Numbers of the avatars.
        rate: Control frames a second.
    """
    numbers, found = np.asarray(avatars, np.int64), list[Heal]()
    before, left = np.zeros(len(numbers), bool), np.full(len(numbers), -1)
    rows = max(1, _ROWS_AT_ONCE // max(1, action.shape[1]))
    for low in range(0, len(action), rows):
        there = np.asarray(action[low : low + rows])[:, numbers] >= 0
        changed = there != np.concatenate([before[None], there[:-1]])
        for row, column in np.argwhere(changed).tolist():
            frame, avatar = low + row, int(numbers[column])
            if not there[row, column]:
                left[column] = frame
            elif 0 <= left[column] < frame - 1:
                found.append(Heal(_before(frame, rate), avatar, avatar + 1))
        before = there[-1]
    return found


def _before(frame: int, rate: float) -> float:
    """Return a time before all strikes of a control frame, which are those since the one before it [s]."""
    return (frame - 1) / rate + 1e-4

"""Profiles scenarios: what control costs, for other numbers of avatars and threads too."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim.core.types import Progress
from crowdsim.errors import ScenarioError
from crowdsim.scenario.scenario import Scenario, resolve_scenario

if TYPE_CHECKING:
    from crowdsim.crowd.profile import Profile
    from crowdsim.policy.policy import Policy


_ACROSS = ("radius", "size")
"""What grows with the square root of the number of avatars, so that a crowd stays as dense."""


def parse_counts(text: str, what: str) -> list[int]:
    """Return the numbers that '30,1000,10k,1M' means.

    Raises:
        ScenarioError: One of them is no number of 1 or more.
    """
    found = []
    for word in text.split(","):
        plain = word.strip().lower()
        factor = {"k": 1_000, "m": 1_000_000}.get(plain[-1:], 1)
        digits = plain[:-1] if factor > 1 else plain
        if not digits.isdecimal() or int(digits) < 1:
            raise ScenarioError(
                f"{what} {text!r}: {word.strip()!r} is no number, expected 1 or more, as in 30,1000,10k"
            )
        found.append(int(digits) * factor)
    return found


def with_avatars(scenario: Scenario, count: int) -> Scenario:
    """Return a scenario with about ``count`` avatars, as dense as before: places and arena grow with it.

    Raises:
        ScenarioError: Its avatars are at given points, in a table or on a line, which do not grow.
    """
    factor = count / scenario.avatar_count
    if factor == 1.0:
        return scenario
    across = math.sqrt(factor)
    data = scenario.model_dump(exclude_none=True)
    for index, group in enumerate(data["groups"]):
        placement = group.get("placement", {"kind": "no placement"})
        kind = "enter" if "enter" in group else placement["kind"]
        if kind in ("points", "line", "table", "enter"):
            raise ScenarioError(f"groups[{index}].placement: {kind} does not grow, expected grid, ring, army or disc")
        group["count"] = max(1, round(group["count"] * factor))
        if placement["kind"] == "ring":
            placement["radius"] *= max(1.0, factor)
        _grow(placement, across)
    _grow(data["arena"], across)
    for event in data["events"]:
        if event["when"]["kind"] == "strikes":
            event["when"]["count"] = max(1, round(event["when"]["count"] * factor))
    return resolve_scenario(Scenario.model_validate(data), scenario.folder)


def _grow(place: dict[str, Any], across: float) -> None:
    if place["kind"] == "ring":
        return
    for key in _ACROSS:
        if key in place:
            value = place[key]
            place[key] = [side * across for side in value] if isinstance(value, list | tuple) else value * across
    if place["kind"] == "army":
        place["ranks"] = max(1, round(place["ranks"] * across))


def profile_scenario(
    scenario: Scenario,
    policies: Sequence[Policy],
    avatars: Sequence[int],
    threads: Sequence[int],
    frames: int | None = None,
    progress: Progress | None = None,
    device: str = "cpu",
) -> list[Profile]:
    """Return what control costs for every number of avatars and threads.

    Args:
        scenario: The scenario.
        policies: Its policies.
        avatars: Numbers of avatars; the scenario's own when empty.
        threads: Numbers of threads.
        frames: Control frames to measure; the scenario's duration when None.
        progress: Called with stage, done and total.
        device: Where control runs, one of ``cuda.device.DEVICES``.
    """
    from crowdsim.crowd.draw import draw_crowd
    from crowdsim.crowd.profile import profile_crowd

    found = []
    for count in avatars or [scenario.avatar_count]:
        sized = with_avatars(scenario, count)
        crowd = draw_crowd(sized, policies)
        length = frames or sized.control_frames(crowd.rate)
        for number in threads:
            found.append(
                profile_crowd(
                    replace(crowd, frames=length),
                    length,
                    number,
                    sized.opponents.search,
                    progress=progress and _named(progress, f"{count} avatars, {number} thread{'s'[: number != 1]}"),
                    device=device,
                )
            )
    return found


def _named(progress: Progress, name: str) -> Progress:
    return lambda _, done, total: progress(name, done, total)


def describe(profile: Profile) -> dict[str, Any]:
    """Return a profile as plain data; times in milliseconds a frame."""
    from crowdsim.crowd.profile import profile_verdict

    scopes = float(profile.timings.sum())
    return {
        "avatars": profile.avatars,
        "threads": profile.threads,
        "device": profile.device,
        "search": profile.search,
        "frames": len(profile.timings),
        "stages": {cost.stage: {k: v for k, v in asdict(cost).items() if k != "stage"} for cost in profile.costs},
        "compile_seconds": profile.compiling * 1e-9,
        "whole_milliseconds": profile.whole * 1e-6,
        "scopes_share": scopes / profile.whole if profile.whole else None,
        "times_real_time": profile.times_real_time,
        "verdict": profile_verdict(profile),
        "bytes_per_avatar": profile.bytes_per_avatar,
    }


def write_trace(path: Path, profile: Profile) -> None:
    """Write stages of frames as a trace that Perfetto and chrome://tracing open."""
    from crowdsim.crowd.chunk import STAGES
    from crowdsim.files import write_text

    events: list[dict[str, Any]] = []
    clock = 0.0
    for frame, spent in enumerate(profile.timings.tolist()):
        begun = clock
        for stage, nanoseconds in zip(STAGES, spent, strict=True):
            events.append({"name": stage, "ph": "X", "pid": 1, "tid": 1, "ts": clock, "dur": nanoseconds / 1000})
            clock += nanoseconds / 1000
        events.append({"name": f"frame {frame}", "ph": "X", "pid": 1, "tid": 0, "ts": begun, "dur": clock - begun})
    write_text(path, json.dumps({"traceEvents": events, "displayTimeUnit": "ns"}))

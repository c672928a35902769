"""How well falls and staggers are found in motion alone: in performed motion, whose truth is known, and in capture."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from crowdsim.capture.loading import load_capture
from crowdsim.errors import CrowdsimError
from crowdsim.motion.analysis import analyse_clip
from crowdsim.motion.body import build_body
from crowdsim.performer.session import perform

EARLY, LATE = 0.5, 0.7
"""How much earlier and later than the truth a fall or stagger may begin and end [s]."""
TAKES = 2
"""Takes of each fall and stagger of a seed."""


def detect_falls(seeds: Iterable[int], seconds: float, fps: float) -> dict[str, Any]:
    """Return how many falls and staggers of the performer are found, and how many that are none.

    Args:
        seeds: A session each.
        seconds: Length of its boxing without falls [s].
        fps: Frames a second.
    """
    outcome: dict[str, Any] = {"seconds": 0.0}
    for kind in ("falls", "staggers"):
        outcome.update({kind: 0, f"{kind}_found": 0, f"{kind}_false": 0})
    for seed in seeds:
        for performance in perform(seconds, seed, fps, falls=TAKES):
            clip, truth = performance.clip, performance.truth
            found = analyse_clip(clip, build_body(clip.skeleton)).falls
            outcome["seconds"] += clip.frame_count / fps
            spans = {"falls": list(zip(found.starts, found.stops, strict=True)), "staggers": list(found.staggers)}
            for kind, true in (("falls", truth.falls), ("staggers", truth.staggers)):
                matched = 0
                for one in true:
                    matched += any(
                        abs(start - one.start) < EARLY * fps and abs(stop - one.end) < LATE * fps
                        for start, stop in spans[kind]
                    )
                outcome[kind] += len(true)
                outcome[f"{kind}_found"] += matched
                outcome[f"{kind}_false"] += len(spans[kind]) - matched
    false = outcome["falls_false"] + outcome["staggers_false"]
    return {**outcome, "false_an_hour": 3600.0 * false / outcome["seconds"]}


def count_captured(folder: Path) -> dict[str, Any]:
    """Return how many falls and staggers are found in all BVH files of a folder that hold a human body."""
    outcome = {"files": 0, "seconds": 0.0, "falls": 0, "staggers": 0}
    for path in sorted(folder.rglob("*.bvh")):
        try:
            analysis = load_capture(path).analysis
        except CrowdsimError:
            continue
        if analysis is not None:
            outcome["files"] += 1
            outcome["seconds"] += analysis.clip.frame_count / analysis.clip.fps
            outcome["falls"] += len(analysis.falls.starts)
            outcome["staggers"] += len(analysis.falls.staggers)
    return {**outcome, "found": outcome["falls"] + outcome["staggers"]}

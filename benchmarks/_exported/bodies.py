"""How often and how deep bodies are in one another, from BVH files."""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.capsules import ARMS, Contacts, deepest
from _exported.plain_bvh import Array
from _exported.run import ExportedRun, worst_moments
from _exported.witness import PARTS

DEEP, VERY_DEEP = 0.06, 0.08
"""Depth that counts as penetration, and the depth of an episode [m]."""
PAUSE = 0.1
"""Deep frames that are less than this apart are of one episode [s]."""
KINDS = tuple(dict.fromkeys(part.removeprefix("left_").removeprefix("right_") for part in PARTS))
KIND = np.array([KINDS.index(part.removeprefix("left_").removeprefix("right_")) for part in PARTS])


def count_episodes(deep: Array, pause: int) -> int:
    """Return the number of runs of True along the last axis; pauses of fewer frames than ``pause`` do not end one."""
    count = 0
    for row in np.atleast_2d(deep):
        frames = np.flatnonzero(row)
        count += int(len(frames) > 0) + int(np.count_nonzero(np.diff(frames) > pause))
    return count


def measure_bodies(run: ExportedRun, contacts: Contacts) -> dict[str, Any]:
    """Return shares of avatar-frames, depths and episodes, without arms and with them, and shares by pair of parts."""
    avatars, frames = len(run.figures), run.count
    arms = ARMS[contacts.own] | ARMS[contacts.theirs]
    outcome: dict[str, Any] = {}
    for name, chosen in (("without_arms", ~arms), ("with_arms", np.ones(len(arms), bool))):
        rows = contacts.rows(chosen)
        depths = deepest(rows, avatars, frames)
        worst = worst_moments(
            rows.depths, rows.one, rows.frames, run.fps, other=rows.other,
            parts=[f"{PARTS[own]} in {PARTS[theirs]}" for own, theirs in zip(rows.own, rows.theirs, strict=True)],
        )  # fmt: skip
        outcome[name] = {
            "share": float(np.mean(depths > DEEP)),
            "deepest": float(depths.max()),
            "episodes_per_minute": count_episodes(depths > VERY_DEEP, round(PAUSE * run.fps)) / run.minutes,
            "moments": worst,
        }
    outcome["by_parts"] = _by_parts(run, contacts)
    outcome["arm_in_trunk_or_head"] = _arm_in_body(run, contacts)
    return outcome


def _by_parts(run: ExportedRun, contacts: Contacts) -> dict[str, dict[str, float]]:
    """Share of avatar-frames that are deeper than ``DEEP``, and the greatest depth, by pair of parts."""
    low, high = np.sort([KIND[contacts.own], KIND[contacts.theirs]], axis=0)
    outcome = {}
    for i, j in sorted({*zip(low.tolist(), high.tolist(), strict=True)}):
        depths = deepest(contacts.rows((low == i) & (high == j)), len(run.figures), run.count)
        outcome[f"{KINDS[i]}-{KINDS[j]}"] = {"share": float(np.mean(depths > DEEP)), "deepest": float(depths.max())}
    return dict(sorted(outcome.items(), key=lambda item: -item[1]["share"]))


def _arm_in_body(run: ExportedRun, contacts: Contacts) -> dict[str, Any]:
    """Share of avatar-frames in which a forearm or fist of the avatar is deeper than ``DEEP`` in a torso or head."""
    rows = contacts.both_ways()
    hands = np.isin(KIND[rows.own], [KINDS.index("forearm"), KINDS.index("fist")])
    rows = rows.rows(hands & np.isin(KIND[rows.theirs], [KINDS.index("torso"), KINDS.index("head")]))
    depths = np.zeros((len(run.figures), run.count))
    np.maximum.at(depths, (rows.one, rows.frames), rows.depths)
    parts = [f"{PARTS[own]} in {PARTS[theirs]}" for own, theirs in zip(rows.own, rows.theirs, strict=True)]
    return {
        "share": float(np.mean(depths > DEEP)),
        "deepest": float(depths.max()),
        "moments": worst_moments(rows.depths, rows.one, rows.frames, run.fps, other=rows.other, parts=parts),
    }

"""What ``crowdsim inspect`` reports of a policy: motion, strikes, graph, and what was learned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.graph.states import MotionGraph
from crowdsim.graph.statistics import frames_kept_by_clip, graph_statistics
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.falls import FallSpans
from crowdsim.motion.strike_kinds import HEIGHTS, KINDS, strike_heights, strike_kinds
from crowdsim.motion.strikers import FEET, HANDS, SIDES
from crowdsim.policy.policy import Policy
from crowdsim.policy.rests import Rests, rests_of
from crowdsim.training.pursuit import sustained_speed
from crowdsim.training.ranges import strike_reach, striking_range
from crowdsim.training.solution import Solution
from crowdsim.training.trials import measure_success
from crowdsim.training.weaknesses import find_weaknesses

PAPER_REACH = {"bearing": (-1.114, 1.317), "distance": (0.297, 1.293), "height": (1.266, 1.624)}
"""The region that the paper's strikes reach (section 6): [rad], [m], [m]."""


_PUNCHES = KINDS.index("kick")
"""Kinds before this one are of fists."""


def policy_statistics(policy: Policy, solutions: Mapping[str, Solution]) -> dict[str, Any]:
    """Return the numbers of a policy as plain data; nothing in it depends on time or machine."""
    database, graph = policy.database, policy.graph
    mirrored = np.array([name.endswith("~mirror") for name in database.clip_names])
    own = ~mirrored if mirrored.any() else np.ones(len(mirrored), bool)
    clip_of = np.searchsorted(database.clip_starts * database.stride, database.strike_frames, side="right") - 1
    shown = replace(graph, frames_kept=graph.frames_kept | database.apart)
    kept = frames_kept_by_clip(shown, database.clip_starts)
    frames = np.diff(database.clip_starts)
    report: dict[str, Any] = {
        "motion": {
            "clips": int(own.sum()),
            "frames": int(frames[own].sum()),
            "seconds": float(frames[own].sum() / database.control_rate),
            "frames_kept": int(kept[own].sum()),
            "mirrored": bool(mirrored.any()),
            "strikes": int(own[clip_of].sum()),
            "frames_kept_by_clip": {name: int(count) for name, count in zip(database.clip_names, kept, strict=True)},
        },
        "graph": asdict(graph_statistics(graph, database.control_rate)),
        "sustained_speed": sustained_speed(policy),
        "warnings": list(graph.warnings),
        "behaviours": {},
    }
    if len(database.strike_frames):
        used = len(np.unique(policy.actions.strike_ids)) / len(database.strike_frames)
        report["strikes"] = {**_count_strikes(database, own[clip_of]), "used_share": used, "paper": PAPER_REACH}
    if database.falls.any:
        report["falls"] = _count_falls(database.falls, sum(own) < len(own))
    for behaviour in policy.behaviours:
        solution = solutions[behaviour.name]
        entry_bytes = {"float32": 4, "float16": 2, "int16": 2, "int8": 1}[str(policy.recipe["precision"])]
        report["behaviours"][behaviour.name] = {
            "axes": [asdict(axis) for axis in behaviour.grid.axes],
            "cells": behaviour.grid.cells,
            "entries": len(behaviour.table),
            "bytes": len(behaviour.table) * entry_bytes,
            "lookup": behaviour.lookup,
            "solver": solution.solver,
            "backup": solution.backup,
            "sweeps": solution.sweeps,
            "updates": solution.updates,
            "residual": float(solution.residuals[-1]),
            "converged": solution.converged,
            "scale": behaviour.scale,
            "value_mean": float(np.mean(solution.values, dtype=np.float64)),
            "success": asdict(measure_success(policy, behaviour)),
        }
    return report


def _count_strikes(database: MotionDatabase, own: Array) -> dict[str, Any]:
    """Return what strikes reach, and how many there are of each limb, kind and height, mirror images left out.

    Feet, and kinds that are no punches, are counted where there are any.
    """
    limbs = np.asarray(database.strike_limbs)
    sides, kinds = limbs % 2, strike_kinds(database)
    kicks = np.isin(limbs, FEET)

    def count(names: tuple[str, ...], numbers: Array) -> dict[str, int]:
        return {name: int(np.sum(numbers[own] == number)) for number, name in enumerate(names)}

    return {
        "reach": asdict(strike_reach(database)),
        "striking_range": list(striking_range(database)),
        "by_hand": count(SIDES, np.where(np.isin(limbs, HANDS), sides, -1)),
        **({"by_foot": count(SIDES, np.where(kicks, sides, -1))} if kicks.any() else {}),
        "by_kind": {
            **count(KINDS[:_PUNCHES], kinds),
            **{name: number for name, number in count(KINDS, kinds).items() if name in KINDS[_PUNCHES:] and number},
        },
        "by_height": count(HEIGHTS, strike_heights(database)),
    }


def with_rests(statistics: dict[str, Any], graph: MotionGraph, rests: Rests | None) -> dict[str, Any]:
    """Return statistics of a policy whose recipe asks for rests, with what has been found of them."""
    if rests is None:
        what = (
            "no rests: the recipe asks for them, but nobody in its motion drops the guard, stands at ease for a second "
            "and comes back to a guard like those of the fights; avatars stay in their guard"
        )
        return {**statistics, "warnings": [*statistics["warnings"], what]}
    costs = np.asarray(graph.action_costs, float)[rests.enter]
    figures = {
        "count": int(np.count_nonzero(~rests_of(rests).walked)),
        "states": len(rests.state),
        "walks": len({*rests.walks.row.tolist()}),
        "cost_mean": float(costs.mean()),
        "cost_most": float(costs.max()),
    }
    return {**statistics, "rests": figures}


def _count_falls(falls: FallSpans, mirrored: bool) -> dict[str, list[float]]:
    """Return directions of falls and staggers by time, mirror images left out [rad]."""
    share = 2 if mirrored else 1
    ways = {"directions": falls.directions, "stagger_directions": falls.stagger_directions}
    return {name: [round(float(way), 4) for way in some[: len(some) // share]] for name, some in ways.items()}


def inspect_bundle(policy: Policy, timings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what ``crowdsim inspect BUNDLE`` reports, plain data.

    Without timings (``bundle.read_timings``) the seconds are null.
    """
    by_name = (timings or {}).get("behaviours", {})
    report = {"name": policy.name, **policy.statistics, "fingerprint": policy.fingerprint}
    report["behaviours"] = {
        name: {
            **facts,
            "seconds": by_name.get(name, {}).get("seconds"),
            "updates_per_second": by_name.get(name, {}).get("updates_per_second"),
        }
        for name, facts in policy.statistics["behaviours"].items()
    }
    report["weaknesses"] = [asdict(weakness) for weakness in find_weaknesses(policy.statistics)]
    report["fingerprints"] = dict(policy.fingerprints)
    report["defends"] = policy.defence is not None
    report["timings"] = dict(timings or {})
    return report

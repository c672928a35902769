"""A policy as plain data and arrays, of which a bundle's files are made, and back."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from crowdsim.array_checks import ArrayFault
from crowdsim.core.types import Array
from crowdsim.graph.motion_graph import MotionGraph
from crowdsim.motion.body import Body
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.strikers import GROUPS, LIMBS
from crowdsim.policy.actions import Actions
from crowdsim.policy.checks import BEHIND, DEFENCE, STATE_VALUES, check_arrays, count_behind
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.falls import flatten_falls, read_falls, spans_of
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rests import flatten_rests, read_rests, rests_of
from crowdsim.policy.rewards import AnyTerm, TargetBody


def flatten_policy(policy: Policy) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return a policy as plain data, and its arrays by name."""
    arrays: dict[str, Array] = {}
    database = _split(policy.database, "database", arrays)
    document: dict[str, Any] = {
        "name": policy.name,
        "fingerprint": policy.fingerprint,
        "fingerprints": dict(policy.fingerprints),
        "units": {"length": "m", "time": "s", "angle": "rad"},
        "recipe": dict(policy.recipe),
        "database": database,
        "skeleton": _split(policy.database.skeleton, "skeleton", arrays),
        "body": _split(policy.database.body, "body", arrays),
        "graph": _split(policy.graph, "graph", arrays),
        "target": policy.body.model_dump(),
        "behaviours": [_describe(behaviour) for behaviour in policy.behaviours],
        "statistics": dict(policy.statistics),
    }
    for name, array in zip(policy.actions._fields, policy.actions, strict=True):
        arrays[f"actions_{name}"] = array
    arrays |= flatten_falls(policy.falls) | flatten_rests(policy.rests)
    if policy.defence is not None:
        arrays[DEFENCE] = policy.defence
    half = policy.recipe["precision"] == "float16"
    tables = [behaviour.table.astype(np.float16) if half else behaviour.table for behaviour in policy.behaviours]
    arrays["values"] = np.concatenate(tables)
    behind = [one.state_values.table for one in policy.behaviours if one.state_values is not None]
    if behind:
        arrays[STATE_VALUES] = np.concatenate(behind)
    return document, arrays


def _split(thing: Any, prefix: str, arrays: dict[str, Array]) -> dict[str, Any]:
    """Return the plain fields of a dataclass, and put its arrays with the others."""
    report: dict[str, Any] = {}
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if isinstance(value, np.ndarray):
            arrays[f"{prefix}_{field.name}"] = value
        elif not dataclasses.is_dataclass(value):
            report[field.name] = dict(value) if isinstance(value, Mapping) else value
    return report


def _join(kind: type[Any], prefix: str, report: Mapping[str, Any], arrays: Mapping[str, Array], **parts: Any) -> Any:
    """Return a dataclass from its plain fields, its arrays, and other dataclasses."""
    values = dict(parts)
    for field in dataclasses.fields(kind):
        if f"{prefix}_{field.name}" in arrays:
            values[field.name] = arrays[f"{prefix}_{field.name}"]
        elif field.name in report:
            value = report[field.name]
            values[field.name] = tuple(value) if isinstance(value, list) else value
    return kind(**values)


def _describe(behaviour: Behaviour) -> dict[str, Any]:
    behind = behaviour.state_values
    report = {
        "name": behaviour.name,
        "axes": [dataclasses.asdict(axis) for axis in behaviour.grid.axes],
        "lookup": behaviour.lookup,
        "entries": len(behaviour.table),
        "scale": behaviour.scale,
        "rewards": [term.model_dump() for term in behaviour.terms],
        "discount": behaviour.discount,
        "stored_low": behaviour.low,
        "stored_step": behaviour.step,
    }
    if behind is not None:
        report["state_values"] = {"low": behind.low, "step": behind.step, "spread": behind.spread}
    return report


def assemble_motion(
    document: Mapping[str, Any], arrays: Mapping[str, Array]
) -> tuple[MotionDatabase, MotionGraph, Actions]:
    """Return the motion, the graph and its actions of a policy that was flattened."""
    skeleton = _join(Skeleton, "skeleton", document["skeleton"], arrays)
    body = _join(Body, "body", document["body"], arrays)
    database = _join(MotionDatabase, "database", document["database"], arrays, skeleton=skeleton, body=body)
    graph = _join(MotionGraph, "graph", document["graph"], arrays)
    actions = Actions(*(arrays[f"actions_{name}"] for name in Actions._fields))
    found = replace(database, falls=spans_of(read_falls(arrays), graph), rests=rests_of(read_rests(arrays)))
    return found, graph, actions


def check_flattened(document: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Raise an ``ArrayFault`` if arrays of a policy do not fit its plain data, which has passed its checks.

    Values of states, which are not read with a policy, may be missing.
    """
    behaviours, database = document["behaviours"], document["database"]
    stride = round(database["playback_rate"] / database["control_rate"])
    wanted = STORED[document["recipe"]["precision"]]
    if arrays["values"].dtype != wanted:
        raise ArrayFault("values", f"holds {arrays['values'].dtype}, expected {wanted} for the precision of the recipe")
    states, actions = arrays["graph_state_frames"].size, arrays["graph_action_next"].size - count_behind(arrays)
    cells = [math.prod(axis["count"] for axis in report["axes"]) for report in behaviours]
    for report, count in zip(behaviours, cells, strict=True):
        expected = count * (actions if report["lookup"] == "q" else states)
        if report["entries"] != expected:
            what = f"holds {report['entries']} entries for {report['name']!r}, expected {expected}"
            raise ArrayFault("values", what)
    sizes = {
        "J": len(document["skeleton"]["names"]),
        "M": len(database["clip_names"]),
        "Q": actions,
        "V": sum(report["entries"] for report in behaviours),
        "W": states * sum(count for report, count in zip(behaviours, cells, strict=True) if "state_values" in report),
    }
    check_arrays(arrays, sizes, stride, (STATE_VALUES, DEFENCE, *BEHIND))
    held = {LIMBS[GROUPS["props"][prop["side"]]] for prop in document["body"].get("props", ())}
    struck = {LIMBS[limb] for limb in np.unique(arrays["database_strike_limbs"])}
    lacking = sorted(struck.intersection(LIMBS[limb] for limb in GROUPS["props"]) - held)
    if lacking:
        raise ArrayFault("database_strike_limbs", f"name a {lacking[0]}, which the body does not hold")
    longest = int(arrays["actions_lengths"].max()) + 1
    if len(behaviours) * longest**2 > _MOST_POWERS:
        what = f"are up to {longest - 1} control frames for {len(behaviours)} behaviours"
        raise ArrayFault("actions_lengths", f"{what}, expected shorter actions, or fewer behaviours")


STORED = {"float32": "float32", "float16": "float16", "int16": "uint16", "int8": "uint8"}
"""Types of values on disk, by precision."""
_MOST_POWERS = 1 << 25
"""Most powers of discounts that control tabulates, for each behaviour and each two frames of an action."""


def assemble_policy(document: Mapping[str, Any], arrays: Mapping[str, Array]) -> Policy:
    """Return the policy that was flattened into plain data and arrays, which have passed their checks."""
    database, graph, actions = assemble_motion(document, arrays)
    falls = read_falls(arrays)
    terms: TypeAdapter[Any] = TypeAdapter(tuple[AnyTerm, ...])
    stored = arrays["values"]
    values = stored.astype(np.float32) if stored.dtype == np.float16 else stored
    behaviours, first = [], 0
    for report in document["behaviours"]:
        end = first + report["entries"]
        grid = build_grid(Axis(**axis) for axis in report["axes"])
        behaviours.append(
            Behaviour(
                name=report["name"],
                grid=grid,
                lookup=report["lookup"],
                table=values[first:end],
                scale=report["scale"],
                terms=terms.validate_python(report["rewards"]),
                discount=report["discount"],
                low=report["stored_low"],
                step=report["stored_step"],
            )
        )
        first = end
    return Policy(
        name=document["name"],
        database=database,
        graph=graph,
        actions=actions,
        behaviours=tuple(behaviours),
        body=TargetBody(**document["target"]),
        values=values,
        recipe=document["recipe"],
        statistics=document["statistics"],
        fingerprint=document["fingerprint"],
        fingerprints=document["fingerprints"],
        falls=falls,
        rests=read_rests(arrays),
        defence=arrays.get(DEFENCE),
    )

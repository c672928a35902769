"""Warnings on valid scenarios: what they ask of policies that these cannot do."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.errors import nearest
from crowdsim.scenario.distributions import limits
from crowdsim.scenario.groups import (
    PACES,
    CircleTarget,
    Group,
    KeysTarget,
    Opponents,
    PointsTarget,
    TablePlacement,
    TargetOpponents,
)
from crowdsim.scenario.parts import AvatarType

if TYPE_CHECKING:
    from crowdsim.scenario.scenario import Scenario

_CLEARLY = 0.7
"""Share of a gait's speed below which the motion of a policy is clearly slower."""


def policy_warnings(scenario: Scenario, statistics: Mapping[str, Mapping[str, Any]]) -> list[Finding]:
    """Return a finding for each thing that a scenario asks of its policies and they cannot do, or may not mean.

    Args:
        scenario: The scenario, resolved.
        statistics: Statistics of each policy by its name; types of other policies are passed over.
    """
    return [
        *team_warnings(scenario),
        *speed_warnings(scenario, statistics),
        *fall_warnings(scenario, statistics),
        *rest_warnings(scenario, statistics),
        *gait_warnings(scenario, statistics),
    ]


def team_warnings(scenario: Scenario) -> list[Finding]:
    """Return a finding for each avatar that is alone in a team of a table whose name is nearly that of another team."""
    counts: Counter[str] = Counter()
    for group in scenario.groups:
        counts.update([row.team.text or group.team for row in group.rows] or {group.team: group.count})
    larger = [team for team, count in counts.items() if count > 1]
    findings = []
    for index, group in enumerate(scenario.groups):
        for row in group.rows:
            name = row.team.text
            if isinstance(group.placement, TablePlacement) and name and counts[name] == 1 and nearest(name, larger):
                what = f"team is {name!r}, and no other avatar is of it{nearest(name, larger)}"
                findings.append(
                    Finding(("groups", index, "placement", "file"), group.placement.describe(row.team, what))
                )
    return findings


def rest_warnings(scenario: Scenario, statistics: Mapping[str, Mapping[str, Any]]) -> list[Finding]:
    """Return a finding for each event that lets avatars rest whose policy has no rests."""
    findings = []
    for number, event in enumerate(scenario.events):
        if event.kind != "rest":
            continue
        groups = [group for group in scenario.groups if event.group in (None, group.name)]
        policies = {scenario.types[name].policy for group in groups for name in group.types}
        for policy in sorted(policies & set(statistics)):
            if statistics[policy].get("rests"):
                continue
            what = (
                f"policy {policy!r} has no rests: its avatars keep the distance in their guard; expected a recipe with "
                "'rest: {}', and 'motion.performer.rests' or capture of people who stand at ease"
            )
            findings.append(Finding(("events", number, "kind"), what))
    return findings


def gait_warnings(scenario: Scenario, statistics: Mapping[str, Mapping[str, Any]]) -> list[Finding]:
    """Return a finding for each gait that is clearly faster than the motion of a policy is."""
    groups, findings = scenario.groups, []
    travels: list[tuple[tuple[str | int, ...], str, list[Group]]] = [
        (("groups", i, "enter", "gait"), group.enter.gait, [group])
        for i, group in enumerate(groups)
        if group.enter is not None
    ]
    travels += [
        (("events", j, "gait"), event.gait, [group for group in groups if event.group in (None, group.name)])
        for j, event in enumerate(scenario.events)
        if event.kind == "leave"
    ]
    for loc, gait, concerned in travels:
        policies = {scenario.types[name].policy for group in concerned for name in group.types}
        for policy in sorted(policies & set(statistics)):
            speed = statistics[policy].get("sustained_speed", math.inf)
            if speed < _CLEARLY * PACES[gait]:
                what = f"is {gait!r}, at about {PACES[gait]:g} m/s, but policy {policy!r} sustains {speed:.2g} m/s"
                findings.append(Finding(loc, f"{what}: its avatars travel at that speed"))
    return findings


def fall_warnings(scenario: Scenario, statistics: Mapping[str, Mapping[str, Any]]) -> list[Finding]:
    """Return a finding for each type that can be knocked down, but whose policy has no falls."""
    findings = []
    for name in sorted(scenario.used_types):
        kind = scenario.types[name]
        if kind.damage is None or kind.policy not in statistics or statistics[kind.policy].get("falls"):
            continue
        what = (
            f"policy {kind.policy!r} has no falls: an avatar leaves when it would stay down, and is not knocked down "
            "before; expected a recipe with 'motion.performer.falls', or capture with falls"
        )
        findings.append(Finding(("types", name, "damage"), what))
    return findings


def speed_warnings(scenario: Scenario, statistics: Mapping[str, Mapping[str, Any]]) -> list[Finding]:
    """Return a finding for each scripted target and type of avatars that follows it, but cannot keep up.

    An avatar on the inside of a target's path needs less than the target's speed, and nothing where it never leaves
    the reach of strikes. Types with weights of their own are passed over: what is known is how fast the policy is with
    those of its recipe.

    Args:
        scenario: The scenario, resolved.
        statistics: Statistics of each policy by its name; types of other policies are passed over.
    """
    findings = []
    for name, target in scenario.targets.items():
        if isinstance(target, KeysTarget):
            continue
        for follower in _followers(scenario, name):
            kind = scenario.types[follower]
            report = statistics.get(kind.policy, {})
            if kind.behaviours or "sustained_speed" not in report:
                continue
            most, fastest = _speed_to_keep_up(target, kind, report), abs(target.speed)
            if fastest > most:
                what = (
                    f"is {target.speed:g}, too fast for type {follower!r}, whose policy {kind.policy!r} sustains "
                    f"{report['sustained_speed']:.2g} m/s; expected at most {_rounded_down(most)}"
                )
                findings.append(Finding(("targets", name, "speed"), what))
    return findings


def _followers(scenario: Scenario, target: str) -> list[str]:
    """Return the types of avatars that follow a target from the start, or after an event."""
    found: dict[str, None] = {}
    for group in scenario.groups:
        given: list[Opponents] = [group.opponents or scenario.opponents]
        given += [e.opponents for e in scenario.events if e.kind == "retarget" and e.group in (None, group.name)]
        if any(isinstance(one, TargetOpponents) and one.target == target for one in given):
            found.update(dict.fromkeys(group.types))
    return list(found)


def _speed_to_keep_up(target: CircleTarget | PointsTarget, kind: AvatarType, report: Mapping[str, Any]) -> float:
    """Return the highest speed of a target at which the slowest avatar of a type keeps up with it [m/s]."""
    size = limits(kind.scale)[0]
    speed = report["sustained_speed"] * size * limits(kind.speed)[0]
    reach = report["strikes"]["reach"]["distance"][1] * size if "strikes" in report else 0.0
    if isinstance(target, CircleTarget):
        radius = target.radius
    else:
        points = np.asarray(target.points, dtype=float)
        radius = float(np.hypot(*(points - 0.5 * (points.min(axis=0) + points.max(axis=0))).T).max())
    return speed / (1.0 - reach / radius) if radius > reach else math.inf


def _rounded_down(speed: float) -> str:
    return f"{math.floor(100.0 * speed) / 100.0:g}"

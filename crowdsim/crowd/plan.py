"""From the events of a scenario to a script."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.crowd import ANYONE, SCRIPTED, Crowd
from crowdsim.crowd.kernels.layout import FIGHTS, FLEES, RESTS, WATCHES
from crowdsim.crowd.placement import Placed
from crowdsim.crowd.script import Change, CirclePath, End, LinePath, Script, TargetPath
from crowdsim.crowd.triggers import AtFrame, Downs, HealthBelow, Landed, LandedOn, Near, Trigger
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.scenario.events import (
    AddEvent,
    Condition,
    DownCondition,
    Event,
    FightEvent,
    FleeEvent,
    FrameCondition,
    HealthCondition,
    LandedOnCondition,
    RestEvent,
    RetargetEvent,
    SecondsCondition,
    StrikesCondition,
    WatchEvent,
    WeightsEvent,
)
from crowdsim.scenario.fitness import CountEnd
from crowdsim.scenario.fitness import End as WantedEnd
from crowdsim.scenario.groups import (
    AnyoneOpponents,
    CircleTarget,
    FixedOpponents,
    Opponents,
    OtherTeamOpponents,
    Target,
    TargetOpponents,
)
from crowdsim.scenario.scenario import Scenario

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


def plan_script(
    scenario: Scenario,
    placed: Placed,
    policies: Sequence[Policy],
    crowd: Crowd,
    cohorts: Array,
    owners: Array,
) -> Script:
    """Return what a scenario has planned.

    Args:
        scenario: The scenario, resolved.
        placed: Its avatars at the start.
        policies: The policies that its types use.
        crowd: Its crowd.
        cohorts: Group and type of each cohort. Shape (M, 2).
        owners: Index of the policy of each type. Shape (types,).
    """
    rate = float(policies[0].database.control_rate)
    changes = tuple(
        _change(scenario, placed, policies, crowd, cohorts, owners, event, rate) for event in scenario.events
    )
    paths = tuple(_path(target) for target in scenario.targets.values())
    return Script(paths, changes, _end(scenario.until, scenario.linger))


def weights_of(policy: Policy, given: dict[str, float], width: int, others: float = 0.0) -> Array:
    """Return weights of a policy's behaviours in its order, ``others`` for those not named and up to ``width``."""
    result = [given.get(behaviour.name, others) for behaviour in policy.behaviours]
    return np.array(result + [others] * (width - len(result)))


def hysteresis_of(opponents: Opponents | None) -> float:
    """Return how much nearer another opponent must be [m]."""
    return opponents.hysteresis if isinstance(opponents, OtherTeamOpponents | AnyoneOpponents) else 0.0


def attackers_of(opponents: Opponents | None) -> int:
    """Return how many may attack one opponent, 0 for any number."""
    return (opponents.attackers or 0) if isinstance(opponents, OtherTeamOpponents | AnyoneOpponents) else 0


def set_opponents(
    scenario: Scenario, placed: Placed, who: Array, opponents: Opponents | None, skip: Array, fixed: Array
) -> None:
    """Write the opponents of some avatars as entries of ``Crowd.skip`` and ``Crowd.fixed``."""
    fixed[who] = -1
    if opponents is None or isinstance(opponents, AnyoneOpponents):
        skip[who] = ANYONE
    elif isinstance(opponents, OtherTeamOpponents):
        skip[who] = placed.team[who]
    elif isinstance(opponents, TargetOpponents):
        skip[who] = SCRIPTED
        fixed[who] = -2 - list(scenario.targets).index(opponents.target)
    elif isinstance(opponents, FixedOpponents):
        skip[who] = SCRIPTED
        members = np.flatnonzero(placed.group == placed.groups.index(opponents.group))
        ours = np.flatnonzero(who)
        chosen = members[np.arange(len(ours)) % len(members)] if opponents.member is None else members[opponents.member]
        fixed[ours] = np.where(chosen == ours, -1, chosen)


def _end(until: WantedEnd | None, lingers: float) -> End | None:
    if until is None:
        return None
    if isinstance(until, CountEnd):
        return End("landed", until.landed or 0, lingers) if until.down is None else End("down", until.down, lingers)
    return End(until, lingers=lingers)


def _path(target: Target) -> TargetPath:
    if isinstance(target, CircleTarget):
        return CirclePath(target.radius, target.speed, target.centre, target.height)
    return LinePath(np.array(target.points, dtype=float), target.speed, target.loop, target.height)


def _when(placed: Placed, condition: Condition, rate: float) -> Trigger:
    """Return what a condition waits for."""
    if isinstance(condition, FrameCondition):
        return AtFrame(condition.frame)
    if isinstance(condition, SecondsCondition):
        return AtFrame(round(condition.seconds * rate))
    if isinstance(condition, StrikesCondition):
        return Landed(condition.count, -1 if condition.team is None else placed.teams.index(condition.team))
    if isinstance(condition, LandedOnCondition):
        return LandedOn(placed.groups.index(condition.group), condition.count)
    if isinstance(condition, DownCondition):
        return Downs(condition.count, -1 if condition.group is None else placed.groups.index(condition.group))
    if isinstance(condition, HealthCondition):
        return HealthBelow(placed.groups.index(condition.group), condition.points)
    return Near(placed.groups.index(condition.group), placed.groups.index(condition.to), condition.below)


def _change(
    scenario: Scenario,
    placed: Placed,
    policies: Sequence[Policy],
    crowd: Crowd,
    cohorts: Array,
    owners: Array,
    event: Event,
    rate: float,
) -> Change:
    """An event as a ``Change``."""
    when = _when(placed, event.when, rate)
    group = None if event.group is None else placed.groups.index(event.group)
    who = np.ones(placed.count, bool) if group is None else placed.group == group
    if isinstance(event, WeightsEvent):
        rows = np.ones(len(cohorts), bool) if group is None else cohorts[:, 0] == group
        weights = np.full(crowd.weights.shape, np.nan)
        for row in np.flatnonzero(rows):
            policy = policies[owners[cohorts[row, 1]]]
            weights[row] = weights_of(policy, event.behaviours, crowd.weights.shape[1], np.nan)
        heat = np.where(rows, np.nan if event.temperature is None else event.temperature, np.nan)
        defences = np.where(rows, event.behaviours.get(DEFEND, np.nan), np.nan)
        return Change(when, weights=weights, temperatures=heat, defences=defences)
    if isinstance(event, RetargetEvent):
        skip, fixed = crowd.skip.copy(), crowd.fixed.copy()
        set_opponents(scenario, placed, who, event.opponents, skip, fixed)
        rows = np.ones(len(cohorts), bool) if group is None else cohorts[:, 0] == group
        margin = np.where(rows, hysteresis_of(event.opponents), np.nan)
        limit = np.where(rows, float(attackers_of(event.opponents)), np.nan)
        return Change(when, who=who, skip=skip, fixed=fixed, hysteresis=margin, attackers=limit)
    if isinstance(event, WatchEvent | RestEvent):
        mode = WATCHES if isinstance(event, WatchEvent) else RESTS
        return Change(when, who=who, mode=mode, distance=event.distance)
    if isinstance(event, FleeEvent | FightEvent):
        return Change(when, who=who, mode=FLEES if isinstance(event, FleeEvent) else FIGHTS)
    return Change(when, who=who, present=isinstance(event, AddEvent))

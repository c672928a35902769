"""What a scenario has planned, as a simulation reads it: opponents, paths of targets, changes and the end."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.crowd import ANYONE, SCRIPTED, Crowd
from crowdsim.crowd.kernels.layout import FIGHTS, FLEES, RESTS, WATCHES
from crowdsim.crowd.script import Change, CirclePath, End, KeyPath, LinePath, TargetPath, Travel
from crowdsim.crowd.triggers import AtFrame, Downs, Ended, HealthBelow, Landed, LandedOn, Near, Trigger
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.scenario.events import (
    AddEvent,
    Condition,
    DownCondition,
    EndedCondition,
    Event,
    FightEvent,
    FleeEvent,
    FrameCondition,
    HealEvent,
    HealthCondition,
    LandedOnCondition,
    LeaveEvent,
    PlaceEvent,
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
    PACES,
    AnyoneOpponents,
    CircleTarget,
    FixedOpponents,
    KeysTarget,
    Opponents,
    OtherTeamOpponents,
    Target,
    TargetOpponents,
)
from crowdsim.scenario.scenario import Scenario

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


def plan_changes(scenario: Scenario, crowd: Crowd, cohorts: Array) -> tuple[Change, ...]:
    """Return the events of a scenario as changes of its crowd.

    Args:
        scenario: The scenario, resolved.
        crowd: Its crowd.
        cohorts: Group and type of each cohort. Shape (M, 2).
    """
    enter = [
        Change(AtFrame(0), who=crowd.group == index, present=True)
        for index, group in enumerate(scenario.groups)
        if group.enter is not None and not group.waits
    ]
    travels = itertools.count(int(np.count_nonzero(crowd.entries >= 0)))
    return (*enter, *(_change(scenario, crowd, cohorts, event, travels) for event in scenario.events))


def plan_change(scenario: Scenario, crowd: Crowd, event: Event) -> Change:
    """Return an event that was not planned as a change of a crowd; its avatars do not leave along a path."""
    cohorts = np.unique(np.stack([crowd.group, crowd.cast.types], axis=1), axis=0)
    return _change(scenario, crowd, cohorts, event, iter(()))


def plan_travels(scenario: Scenario, rate: float) -> tuple[Travel, ...]:
    """Return the paths by which groups enter, in their order, and then those by which events let avatars leave."""
    entrances = [
        Travel(
            points=np.array(group.enter.path, dtype=float),
            pace=PACES[group.enter.gait] / rate,
            ends_attacked=group.enter.until == "attacked",
            leaves=False,
            interval=rate / group.enter.rate,
            forms_up=group.placement is not None,
        )
        for group in scenario.groups
        if group.enter is not None
    ]
    exits = [
        Travel(np.array(event.path, dtype=float), PACES[event.gait] / rate, event.until == "attacked", True)
        for event in scenario.events
        if isinstance(event, LeaveEvent)
    ]
    return (*entrances, *exits)


def plan_entries(scenario: Scenario) -> Array:
    """Return the path by which each group enters, an index into those of ``plan_travels``, -1 for none. (groups,)."""
    enters = np.array([group.enter is not None for group in scenario.groups])
    return np.where(enters, np.cumsum(enters) - 1, -1).astype(np.int32)


def weights_of(policy: Policy, given: dict[str, float], width: int, others: float = 0.0) -> Array:
    """Return weights of a policy's behaviours in its order, ``others`` for those not named and up to ``width``."""
    result = [given.get(behaviour.name, others) for behaviour in policy.behaviours]
    return np.array(result + [others] * (width - len(result)))


def interval_of(tempo: float | None, rate: float) -> float:
    """Return how long it takes to recover from a strike at a tempo [strikes/min]; 0 for none [control frames]."""
    return 0.0 if tempo is None else 60.0 * rate / tempo


def reaction_of(reaction: float, rate: float) -> int:
    """Return a time to see what an opponent has decided [s] in control frames."""
    return math.ceil(round(reaction * rate, 6))


def hysteresis_of(opponents: Opponents | None) -> float:
    """Return how much nearer another opponent must be [m]."""
    return opponents.hysteresis if isinstance(opponents, OtherTeamOpponents | AnyoneOpponents) else 0.0


def attackers_of(opponents: Opponents | None) -> int:
    """Return how many may attack one opponent, 0 for any number."""
    return (opponents.attackers or 0) if isinstance(opponents, OtherTeamOpponents | AnyoneOpponents) else 0


def set_opponents(
    scenario: Scenario,
    cast: Cast,
    group: Array,
    who: Array,
    opponents: Opponents | None,
    skip: Array,
    fixed: Array,
) -> None:
    """Write the opponents of some avatars as entries of ``Crowd.skip`` and ``Crowd.fixed``.

    Args:
        scenario: The scenario.
        cast: Its avatars.
        group: Index of the group of each. Shape (N,).
        who: Which of them are concerned. Shape (N,), bool.
        opponents: Their opponents.
        skip: Written. Shape (N,).
        fixed: Written. Shape (N,).
    """
    fixed[who] = -1
    if opponents is None or isinstance(opponents, AnyoneOpponents):
        skip[who] = ANYONE
    elif isinstance(opponents, OtherTeamOpponents):
        skip[who] = cast.teams[who]
    elif isinstance(opponents, TargetOpponents):
        skip[who] = SCRIPTED
        fixed[who] = -2 - list(scenario.targets).index(opponents.target)
    elif isinstance(opponents, FixedOpponents):
        skip[who] = SCRIPTED
        members = np.flatnonzero(group == _group(scenario, opponents.group))
        ours = np.flatnonzero(who)
        chosen = members[np.arange(len(ours)) % len(members)] if opponents.member is None else members[opponents.member]
        fixed[ours] = np.where(chosen == ours, -1, chosen)


def plan_end(until: WantedEnd | None, lingers: float) -> End | None:
    """Return what ends a run before its duration; ``lingers`` is how long it goes on then [s]."""
    if until is None:
        return None
    if isinstance(until, CountEnd):
        return End("landed", until.landed or 0, lingers) if until.down is None else End("down", until.down, lingers)
    return End(until, lingers=lingers)


def plan_path(target: Target, rate: float) -> TargetPath:
    """Return the path of a scripted target at so many control frames a second."""
    if isinstance(target, KeysTarget):
        before = None if target.before is None else plan_path(target.before, rate)
        frames = [frame for frame, *_ in target.keys]
        return KeyPath(rate, frames, [(x, y, z) for _, x, y, z in target.keys], before)
    if isinstance(target, CircleTarget):
        return CirclePath(target.radius, target.speed, target.centre, target.height)
    return LinePath(np.array(target.points, dtype=float), target.speed, target.loop, target.height)


def _group(scenario: Scenario, name: str | None) -> int:
    """Return the index of a group; -1 without a name, which means all of them."""
    return -1 if name is None else [group.name for group in scenario.groups].index(name)


def _when(scenario: Scenario, condition: Condition, rate: float) -> Trigger:
    """Return what a condition waits for."""
    if isinstance(condition, FrameCondition):
        return AtFrame(condition.frame)
    if isinstance(condition, SecondsCondition):
        return AtFrame(round(condition.seconds * rate))
    if isinstance(condition, StrikesCondition):
        return Landed(condition.count, -1 if condition.team is None else scenario.teams.index(condition.team))
    if isinstance(condition, EndedCondition):
        return Ended()
    group = _group(scenario, condition.group)
    if isinstance(condition, LandedOnCondition):
        return LandedOn(group, condition.count)
    if isinstance(condition, DownCondition):
        return Downs(condition.count, group)
    if isinstance(condition, HealthCondition):
        return HealthBelow(group, condition.points)
    return Near(group, _group(scenario, condition.to), condition.below)


def _change(scenario: Scenario, crowd: Crowd, cohorts: Array, event: Event, travels: Iterator[int]) -> Change:
    """Return an event as a ``Change``; one that lets avatars leave takes the next of ``travels``."""
    when = _when(scenario, event.when, crowd.rate)
    group = _group(scenario, event.group)
    who = (crowd.group == group) | (group < 0)
    member = getattr(event, "member", None)
    if member is not None:
        who &= np.arange(crowd.count) == np.flatnonzero(who)[member]
    rows = (cohorts[:, 0] == group) | (group < 0)
    if isinstance(event, WeightsEvent):
        if event.type is not None:
            rows &= cohorts[:, 1] == list(scenario.types).index(event.type)
        kinds, names = list(scenario.types.values()), crowd.cast.policy_names
        weights = np.full(crowd.weights.shape, np.nan)
        for row in np.flatnonzero(rows):
            policy = crowd.policies[names.index(kinds[cohorts[row, 1]].policy)]
            weights[row] = weights_of(policy, event.behaviours, crowd.weights.shape[1], np.nan)
        tempo, reaction = event.tempo, event.reaction
        return Change(
            when,
            weights=weights,
            temperatures=np.where(rows, np.nan if event.temperature is None else event.temperature, np.nan),
            intervals=np.where(rows, np.nan if tempo is None else interval_of(tempo, crowd.rate), np.nan),
            reactions=np.where(rows, np.nan if reaction is None else reaction_of(reaction, crowd.rate), np.nan),
            defences=np.where(rows, event.behaviours.get(DEFEND, np.nan), np.nan),
        )
    if isinstance(event, RetargetEvent):
        skip, fixed = crowd.skip.copy(), crowd.fixed.copy()
        set_opponents(scenario, crowd.cast, crowd.group, who, event.opponents, skip, fixed)
        margin = np.where(rows, hysteresis_of(event.opponents), np.nan)
        limit = np.where(rows, float(attackers_of(event.opponents)), np.nan)
        return Change(when, who=who, skip=skip, fixed=fixed, hysteresis=margin, attackers=limit)
    if isinstance(event, WatchEvent | RestEvent):
        mode = WATCHES if isinstance(event, WatchEvent) else RESTS
        return Change(when, who=who, mode=mode, distance=event.distance)
    if isinstance(event, FleeEvent | FightEvent):
        return Change(when, who=who, mode=FLEES if isinstance(event, FleeEvent) else FIGHTS)
    if isinstance(event, LeaveEvent):
        return Change(when, who=who, travel=next(travels), health_below=event.health_below)
    if isinstance(event, PlaceEvent):
        return Change(when, who=who, point=event.point)
    if isinstance(event, HealEvent):
        return Change(when, who=who, heals=True)
    return Change(when, who=who, present=isinstance(event, AddEvent))

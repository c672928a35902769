"""Draws the crowd of a scenario, by its policies: words become numbers here."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.core.types import Array
from crowdsim.crowd.attachments import attachment_findings, pack_attachments
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.crowd import Crowd, Crowding
from crowdsim.crowd.distributions import draw_numbers, draw_types, is_tempered, temperaments_of
from crowdsim.crowd.obstacles import pack_obstacles
from crowdsim.crowd.placement import groups_of_avatars, place_groups, teams_of_avatars
from crowdsim.crowd.plan import (
    attackers_of,
    hysteresis_of,
    interval_of,
    plan_changes,
    plan_end,
    plan_entries,
    plan_path,
    plan_travels,
    reaction_of,
    set_opponents,
    weights_of,
)
from crowdsim.crowd.stances import draw_stances, stance_findings
from crowdsim.errors import RunError, nearest
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.scenario.distributions import middle
from crowdsim.scenario.events import (
    FightEvent,
    FleeEvent,
    LeaveEvent,
    RemoveEvent,
    RestEvent,
    RetargetEvent,
    WatchEvent,
    WeightsEvent,
)
from crowdsim.scenario.groups import Opponents
from crowdsim.scenario.parts import Arena, AvatarType, CircleArena, RectangleArena
from crowdsim.scenario.scenario import Scenario, check_loaded

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


_DRAWN = {
    "scale": "scales",
    "girth": "girths",
    "speed": "speeds",
    "legs": "legs",
    "arms": "arms",
    "tempo": "tempos",
    "aggression": "aggressions",
    "range": "ranges",
}
"""Keys of types whose values are distributions, and the fields of ``Cast`` that hold what is drawn from them."""
_TRAIN_DEFENCE = "; expected a policy whose recipe has a section 'defend', such as boxer_defender"
_TRAIN_REACTION = "; expected one whose recipe has a section 'defend' or an axis 'impact', such as boxer_defender"
_USUAL_REACTION = AvatarType.model_fields["reaction"].default


def draw_crowd(scenario: Scenario, policies: Sequence[Policy], placed: Array | None = None) -> Crowd:
    """Draw the crowd of a scenario: everything about its avatars that is random at the start, once.

    Avatars of a group and type are a cohort, which shares weights, candidates, temperature and hysteresis.

    Args:
        scenario: The scenario, resolved, as ``load_scenario`` gives it.
        policies: The policies that its types use, as ``load_policies`` gives them.
        placed: Where its avatars are at the start, where that is known (``placement.place_groups``).

    Raises:
        ScenarioError: Not all avatars fit, a type weighs a behaviour that its policy has not learned, or asks for a
            stance in which it has too little motion.
        RunError: The policies' control rates differ.
    """
    check_loaded(scenario)
    by_name = {policy.name: policy for policy in policies}
    rates = {name: float(policy.database.control_rate) for name, policy in by_name.items()}
    if len(set(rates.values())) > 1:
        result = ", ".join(f"{name} has {rate:g}" for name, rate in rates.items())
        raise RunError(f"{scenario.name}: policies of one run need one control rate, but {result}")
    scenario.refuse(missing_policies(scenario, by_name))
    reacting = [name for name, policy in by_name.items() if reacts(policy)]
    scenario.refuse(unlearned_behaviours(scenario, {name: one.learned for name, one in by_name.items()}, reacting))
    scenario.refuse(stance_findings(scenario, by_name))
    scenario.refuse(attachment_findings(scenario, by_name))
    x, z, heading = place_groups(scenario) if placed is None else placed
    rate = float(policies[0].database.control_rate)
    types, group = draw_types(scenario), groups_of_avatars(scenario)
    drawn = {key: draw_numbers(scenario, types, key) for key in _DRAWN}
    cast = _cast(scenario, types, drawn, policies)
    cohorts, cohort = np.unique(np.stack([group, types], axis=1), axis=0, return_inverse=True)
    skip, fixed = np.empty(len(x), np.int32), np.empty(len(x), np.int32)
    for index, one in enumerate(scenario.groups):
        set_opponents(scenario, cast, group, group == index, one.opponents, skip, fixed)
    crowd = Crowd(
        cast=cast,
        policies=tuple(policies),
        x=x,
        z=z,
        heading=heading,
        group=group,
        cohort=cohort.reshape(-1).astype(np.int16),
        skip=skip,
        fixed=fixed,
        present=np.array([not one.comes_later for one in scenario.groups])[group],
        **_preferences(scenario, policies, cohorts, rate),
        arena=pack_arena(scenario.arena),
        parts=pack_obstacles(scenario, rate),
        crowding=_crowding(scenario),
        seed=scenario.seed,
        conditioned=is_conditioned(scenario),
        temperaments=temperaments_of(scenario, types, drawn["tempo"], drawn["aggression"], drawn["range"]),
        targets=tuple(plan_path(target, rate) for target in scenario.targets.values()),
        travels=plan_travels(scenario, rate),
        entries=plan_entries(scenario),
        until=plan_end(scenario.until, scenario.linger),
        frames=scenario.control_frames(rate),
        pre_roll=round(scenario.pre_roll_seconds * rate),
    )
    return replace(crowd, changes=plan_changes(scenario, crowd, cohorts))


def _cast(scenario: Scenario, types: Array, drawn: Mapping[str, Array], policies: Sequence[Policy]) -> Cast:
    """Return what is constant for each avatar; ``drawn`` are its numbers by the keys of types."""
    kinds = list(scenario.types.values())
    has_names = any(group.rows for group in scenario.groups)
    attachments, faces = pack_attachments(scenario, {policy.name: policy for policy in policies})
    colours = [[np.nan] * 3 if kind.colour is None else _rgb(kind.colour) for kind in kinds]
    return Cast(
        names=np.array(scenario.avatar_names()),
        types=types.astype(np.int16),
        teams=teams_of_avatars(scenario),
        policies=_policies_of_types(scenario, policies)[types],
        type_names=tuple(scenario.types),
        team_names=scenario.teams,
        policy_names=tuple(policy.name for policy in policies),
        colours=np.array(colours, float).reshape(-1, 3),
        **{field: drawn[key].astype(np.float32) for key, field in _DRAWN.items()},
        stances=draw_stances(scenario, types),
        groups=groups_of_avatars(scenario) if has_names else np.zeros(0),
        group_names=tuple(scenario.group_names) if has_names else (),
        attachments=attachments,
        faces=faces,
        bodies=tuple((kind.sex, kind.hands) for kind in kinds),
    )


def _rgb(colour: str) -> list[float]:
    return [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]


def _policies_of_types(scenario: Scenario, policies: Sequence[Policy]) -> Array:
    """Return the policy of each type, by index; 0 for a type that no avatar has. Shape (types,), int16."""
    names = [policy.name for policy in policies]
    return np.array(
        [names.index(kind.policy) if kind.policy in names else 0 for kind in scenario.types.values()], np.int16
    )


def _preferences(scenario: Scenario, policies: Sequence[Policy], cohorts: Array, rate: float) -> dict[str, Any]:
    """Return how the avatars of each cohort choose, and what hurts and tires them: fields of ``Crowd``.

    Args:
        scenario: The scenario.
        policies: Its policies.
        cohorts: Group and type of each cohort. Shape (M, 2).
        rate: Control frames a second.
    """
    types, groups = list(scenario.types.values()), [scenario.groups[group] for group, _ in cohorts]
    kinds = [types[kind] for _, kind in cohorts]
    owners = [policies[index] for index in _policies_of_types(scenario, policies)[cohorts[:, 1]]]
    width = max(len(policy.behaviours) for policy in policies)
    weights = [
        weights_of(policy, kind.behaviours, width)
        if kind.behaviours
        else np.pad(policy.weights, (0, width - len(policy.weights)))
        for policy, kind in zip(owners, kinds, strict=True)
    ]
    defences = [
        kind.behaviours.get(DEFEND, 0.0) if kind.behaviours else policy.defence_weight
        for policy, kind in zip(owners, kinds, strict=True)
    ]
    rules = [_rules(kind, group.opponents, rate) for group, kind in zip(groups, kinds, strict=True)]
    return {
        "weights": np.array(weights),
        "defences": np.array(defences),
        "margins": np.array([kind.candidates.margin for kind in kinds]),
        "most": np.array([kind.candidates.maximum for kind in kinds], np.int32),
        "temperatures": np.array([kind.temperature for kind in kinds]),
        "hysteresis": np.array([hysteresis_of(group.opponents) for group in groups]),
        "intervals": np.array(
            [interval_of(None if kind.tempo is None else middle(kind.tempo), rate) for kind in kinds]
        ),
        "varieties": np.array([kind.variety for kind in kinds]),
        "reactions": np.array([reaction_of(kind.reaction, rate) for kind in kinds]),
        "rules": np.array(rules, dtype=float),
    }


def missing_policies(scenario: Scenario, names: Collection[str]) -> list[Finding]:
    """Return a finding for each type that avatars have whose policy is none of some, by their names."""
    return [
        Finding(
            ("types", name, "policy"),
            f"policy {kind.policy!r} is not among those given, {', '.join(names) or 'none'}; "
            "crowdsim.load_policies finds those of a scenario",
        )
        for name, kind in scenario.types.items()
        if name in scenario.used_types and kind.policy not in names
    ]


def sees_strikes(learned: Collection[str], axes: Collection[str]) -> bool:
    """Return whether avatars with some behaviours, on grids of some axes, react to strikes of their opponents."""
    return DEFEND in learned or "impact" in axes


def reacts(policy: Policy) -> bool:
    """Return whether avatars of a policy react to strikes of their opponents."""
    return sees_strikes(policy.learned, {axis.name for one in policy.behaviours for axis in one.grid.axes})


def unlearned_behaviours(
    scenario: Scenario, learned: Mapping[str, Sequence[str]], reacting: Collection[str]
) -> list[Finding]:
    """Return a finding for all that a type or an event asks of behaviours which its policy has not learned.

    Args:
        scenario: The scenario, resolved.
        learned: Behaviours of each policy by its name; types of other policies are passed over.
        reacting: Names of those whose avatars react to strikes.
    """
    findings = []

    def check_reaction(key: tuple[str | int, ...], policies: Collection[str]) -> None:
        if policies and all(name in learned and name not in reacting for name in policies):
            words = ", ".join(map(repr, policies))
            what = f"has no effect, avatars of policy {words} do not react to strikes{_TRAIN_REACTION}"
            findings.append(Finding((*key, "reaction"), what))

    def check(key: tuple[str | int, ...], given: Mapping[str, float], policy: str, passed: Sequence[str] = ()) -> None:
        for name in given:
            names = learned.get(policy, given)
            if name not in names and name not in passed:
                what = f"policy {policy!r} has no such behaviour{nearest(name, names)}; it has {', '.join(names)}"
                what += _TRAIN_DEFENCE if name == DEFEND else ""
                findings.append(Finding((*key, name), what))

    for name, kind in scenario.types.items():
        check(("types", name, "behaviours"), kind.behaviours, kind.policy, scenario.inherited_behaviours(name))
        if kind.reaction != _USUAL_REACTION:
            check_reaction(("types", name), [kind.policy])
    for index, event in enumerate(scenario.events):
        if isinstance(event, WeightsEvent):
            concerned = {
                scenario.types[name].policy: None
                for group in scenario.groups
                if event.group in (None, group.name)
                for name in group.types
                if event.type in (None, name)
            }
            for policy in concerned:
                check(("events", index, "behaviours"), event.behaviours, policy)
            if event.reaction is not None:
                check_reaction(("events", index), concerned)
    return list(dict.fromkeys(findings))


_OF_MODES = (FleeEvent, WatchEvent, RestEvent, FightEvent, RemoveEvent, LeaveEvent)
"""Events that set what avatars do about their opponents, or leave them without any."""


def is_conditioned(scenario: Scenario) -> bool:
    """Return whether avatars can be hurt, tire, watch, flee, wait, rest or travel, or have a temper or a stance."""
    kinds = [scenario.types[name] for name in scenario.used_types]
    opponents = [group.opponents for group in scenario.groups]
    opponents += [event.opponents for event in scenario.events if isinstance(event, RetargetEvent)]
    return (
        any(
            kind.damage is not None or kind.stamina is not None or is_tempered(kind) or kind.stance is not None
            for kind in kinds
        )
        or any(isinstance(event, _OF_MODES) for event in scenario.events)
        or any(group.enter is not None for group in scenario.groups)
        or any(attackers_of(one) > 0 for one in opponents)
    )


def _rules(kind: AvatarType, opponents: Opponents | None, rate: float) -> list[float]:
    """Return what hurts and tires avatars of a type, see ``World.rules``."""
    damage, stamina = kind.damage, kind.stamina
    hurts = [0.0] * 8
    if damage is not None:
        hurts = [damage.health, damage.hit, damage.body, damage.blocked, damage.stagger, damage.knock_down]
        hurts += [round(damage.count * rate), damage.downs]
    tires = [0.0] * 3 if stamina is None else [stamina.strike, stamina.metre, stamina.rest / rate]
    return [*hurts, *tires, attackers_of(opponents)]


def _crowding(scenario: Scenario) -> Crowding:
    """Return how avatars avoid one another; where they wait for one another, or may lie about, they see further."""
    rules = Crowding() if scenario.collision_avoidance else Crowding.none()
    if not scenario.reactions:
        rules = replace(rules, back=0.0, stunned=0.0)
    if any(kind.damage is not None for kind in scenario.types.values()):
        rules = replace(rules, reach=2.2, most=16)
    opponents = [group.opponents for group in scenario.groups]
    opponents += [event.opponents for event in scenario.events if isinstance(event, RetargetEvent)]
    return replace(rules, reach=3.0, most=24) if any(attackers_of(one) > 0 for one in opponents) else rules


def pack_arena(arena: Arena) -> Array:
    """Return an arena as numbers: kind (0 none, 1 circle, 2 rectangle), centre, half the sizes [m]. Shape (5,)."""
    if isinstance(arena, CircleArena):
        return np.array([1.0, *arena.centre, arena.radius, arena.radius])
    if isinstance(arena, RectangleArena):
        return np.array([2.0, *arena.centre, arena.size[0] / 2, arena.size[1] / 2])
    return np.zeros(5)

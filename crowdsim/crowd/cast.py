"""From a scenario and its policies to a crowd and a script: words become numbers here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.core.types import Array
from crowdsim.crowd.crowd import Crowd, Crowding
from crowdsim.crowd.distributions import draw_temperaments, is_tempered
from crowdsim.crowd.placement import Placed
from crowdsim.crowd.plan import attackers_of, hysteresis_of, plan_script, set_opponents, weights_of
from crowdsim.crowd.script import Script
from crowdsim.crowd.stances import draw_stances, stance_findings
from crowdsim.errors import RecipeError, nearest
from crowdsim.policy.checks import DEFENCE
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.policy.flattening import STORED
from crowdsim.scenario.distributions import middle
from crowdsim.scenario.events import (
    FightEvent,
    FleeEvent,
    RemoveEvent,
    RestEvent,
    RetargetEvent,
    WatchEvent,
    WeightsEvent,
)
from crowdsim.scenario.groups import Opponents
from crowdsim.scenario.parts import Arena, AvatarType, CircleArena, RectangleArena
from crowdsim.scenario.scenario import Scenario

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy
    from crowdsim.training.recipe import Recipe


_TRAIN_DEFENCE = "; expected a policy whose recipe has a section 'defend', such as boxer_defender"
_USUAL_REACTION = AvatarType.model_fields["reaction"].default


def policies_of_types(scenario: Scenario, policies: Sequence[Policy]) -> Array:
    """Return the policy of each type, by index; 0 for a type that no avatar has. Shape (types,), int16."""
    names = [policy.name for policy in policies]
    return np.array(
        [names.index(kind.policy) if kind.policy in names else 0 for kind in scenario.types.values()], np.int16
    )


def cast_crowd(scenario: Scenario, placed: Placed, policies: Sequence[Policy]) -> tuple[Crowd, Script]:
    """Return the crowd of a scenario before its first frame, and what is planned.

    Avatars of a group and type are a cohort, which shares weights, candidates, temperature and hysteresis.

    Args:
        scenario: The scenario, resolved.
        placed: Its avatars at the start.
        policies: The policies that its types use.

    Raises:
        ScenarioError: A type weighs a behaviour that its policy has not learned, or asks for a stance in which it has
            too little motion.
    """
    learned = {policy.name: policy.learned for policy in policies}
    scenario.refuse(unlearned_behaviours(scenario, learned))
    scenario.refuse(stance_findings(scenario, {policy.name: policy for policy in policies}))
    cohorts, cohort = np.unique(np.stack([placed.group, placed.type], axis=1), axis=0, return_inverse=True)
    cohort = cohort.reshape(-1)
    owners = policies_of_types(scenario, policies)
    width = max(len(policy.behaviours) for policy in policies)
    rate = float(policies[0].database.control_rate)
    kinds = list(scenario.types.values())
    weights, defences = np.zeros((len(cohorts), width)), np.zeros(len(cohorts))
    for row, (_, kind) in enumerate(cohorts):
        policy = policies[owners[kind]]
        named = kinds[kind].behaviours
        own = policy.weights
        weights[row] = weights_of(policy, named, width) if named else np.pad(own, (0, width - len(own)))
        defences[row] = named.get(DEFEND, 0.0) if named else policy.defence_weight
    skip, fixed = np.empty(placed.count, np.int32), np.full(placed.count, -1, np.int32)
    for index, group in enumerate(scenario.groups):
        set_opponents(scenario, placed, placed.group == index, group.opponents, skip, fixed)
    crowd = Crowd(
        x=placed.x,
        z=placed.z,
        heading=placed.heading,
        policy=owners[placed.type],
        team=placed.team.astype(np.int32),
        group=placed.group.astype(np.int32),
        cohort=cohort.astype(np.int16),
        scale=placed.scale.astype(np.float32),
        girth=placed.girth.astype(np.float32),
        speed=placed.speed.astype(np.float32),
        skip=skip,
        fixed=fixed,
        present=placed.present,
        weights=weights,
        defences=defences,
        **_preferences(scenario, cohorts, rate),
        arena=pack_arena(scenario.arena),
        crowding=_crowding(scenario),
        seed=scenario.seed,
        conditioned=is_conditioned(scenario),
        temperaments=draw_temperaments(scenario, placed.type),
        stances=draw_stances(scenario, placed.type),
    )
    return crowd, plan_script(scenario, placed, policies, crowd, cohorts, owners)


def _preferences(scenario: Scenario, cohorts: Array, rate: float) -> dict[str, Array]:
    """Return how the avatars of each cohort choose, and what hurts and tires them: fields of ``Crowd``."""
    types, groups = list(scenario.types.values()), [scenario.groups[group] for group, _ in cohorts]
    kinds = [types[kind] for _, kind in cohorts]
    rules = [_rules(kind, group.opponents, rate) for group, kind in zip(groups, kinds, strict=True)]
    return {
        "margins": np.array([kind.candidates.margin for kind in kinds]),
        "most": np.array([kind.candidates.maximum for kind in kinds], np.int32),
        "temperatures": np.array([kind.temperature for kind in kinds]),
        "hysteresis": np.array([hysteresis_of(group.opponents) for group in groups]),
        "intervals": np.array([0.0 if kind.tempo is None else 60.0 * rate / middle(kind.tempo) for kind in kinds]),
        "varieties": np.array([kind.variety for kind in kinds]),
        "reactions": np.array([math.ceil(round(kind.reaction * rate, 6)) for kind in kinds]),
        "rules": np.array(rules, dtype=float),
    }


def learned_behaviours(policy: str) -> list[str]:
    """Return the behaviours of a policy by its name, trained or not.

    Raises:
        RecipeError: Its recipe is invalid.
        PolicyError: There is no such policy, or its bundle is damaged.
    """
    recipe, document = _recipe_or_bundle(policy)
    if recipe:
        return [*recipe.behaviours, *([DEFEND] if recipe.defend is not None else [])]
    named = [str(behaviour["name"]) for behaviour in document["behaviours"]]
    return [*named, *([DEFEND] if f"{DEFENCE}.npy" in document["files"] else [])]


def control_rate_of(policy: str) -> float:
    """Return the control rate of a policy by its name, trained or not [Hz].

    Raises:
        RecipeError: Its recipe is invalid.
        PolicyError: There is no such policy, or its bundle is damaged.
    """
    recipe, document = _recipe_or_bundle(policy)
    return float(recipe.control_rate if recipe else document["database"]["control_rate"])


def table_type_of(policies: Sequence[str]) -> str:
    """Return the type of the tables that control reads in a run of some policies, by their names, trained or not.

    Raises:
        RecipeError: A recipe is invalid.
        PolicyError: There is no such policy, or its bundle is damaged.
    """
    found = set()
    for policy in policies:
        recipe, document = _recipe_or_bundle(policy)
        found.add(STORED[recipe.precision if recipe else document["recipe"]["precision"]])
    # float16 is read as float32, and so are tables of several types.
    return found.pop() if found in ({"uint8"}, {"uint16"}) else "float32"


def _recipe_or_bundle(policy: str) -> tuple[Recipe | None, Mapping[str, Any]]:
    """Return the recipe of a policy, or None and what the bundle of a policy without a recipe says."""
    from crowdsim import assets
    from crowdsim.policy.bundle import read_document
    from crowdsim.training.recipe import load_recipe

    try:
        path = assets.find_recipe(policy)
    except RecipeError:
        return None, read_document(assets.find_bundle(policy))
    return load_recipe(path), {}


def unlearned_behaviours(scenario: Scenario, learned: Mapping[str, Sequence[str]]) -> list[Finding]:
    """Return a finding for each behaviour that a type or an event weighs, but its policy has not learned.

    Args:
        scenario: The scenario, resolved.
        learned: Behaviours of each policy by its name; types of other policies are passed over.
    """
    findings = []

    def check(key: tuple[str | int, ...], given: Mapping[str, float], policy: str, passed: Sequence[str] = ()) -> None:
        for name in given:
            names = learned.get(policy, given)
            if name not in names and name not in passed:
                what = f"policy {policy!r} has no such behaviour{nearest(name, names)}; it has {', '.join(names)}"
                what += _TRAIN_DEFENCE if name == DEFEND else ""
                findings.append(Finding((*key, name), what))

    for name, kind in scenario.types.items():
        check(("types", name, "behaviours"), kind.behaviours, kind.policy, scenario.inherited_behaviours(name))
        if kind.reaction != _USUAL_REACTION and DEFEND not in learned.get(kind.policy, [DEFEND]):
            what = f"has no effect, policy {kind.policy!r} has not learned to defend itself"
            findings.append(Finding(("types", name, "reaction"), what + _TRAIN_DEFENCE))
    for index, event in enumerate(scenario.events):
        if isinstance(event, WeightsEvent):
            concerned = {
                scenario.types[name].policy: None
                for group in scenario.groups
                if event.group in (None, group.name)
                for name in ([group.type] if group.type is not None else group.mix or {})
            }
            for policy in concerned:
                check(("events", index, "behaviours"), event.behaviours, policy)
    return list(dict.fromkeys(findings))


_OF_MODES = (FleeEvent, WatchEvent, RestEvent, FightEvent, RemoveEvent)
"""Events that set what avatars do about their opponents, or leave them without any."""


def is_conditioned(scenario: Scenario) -> bool:
    """Return whether avatars of a scenario can be hurt, tire, watch, flee, wait or rest, or have a temper or stance."""
    kinds = [scenario.types[name] for name in scenario.used_types]
    opponents = [group.opponents for group in scenario.groups]
    opponents += [event.opponents for event in scenario.events if isinstance(event, RetargetEvent)]
    return (
        any(
            kind.damage is not None or kind.stamina is not None or is_tempered(kind) or kind.stance is not None
            for kind in kinds
        )
        or any(isinstance(event, _OF_MODES) for event in scenario.events)
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

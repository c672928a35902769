"""Checks a file without using it: scenarios and recipes are told apart by their keys."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from crowdsim.errors import CrowdsimError, PolicyError
from crowdsim.yaml_files import find_faults

if TYPE_CHECKING:
    from crowdsim.crowd.placement import Placed
    from crowdsim.crowd.scenario import Scenario

_RECIPE_KEYS = {"motion", "graph", "control_rate", "playback_rate", "precision"}


def find_file_faults(path: Path) -> list[str]:
    """Return everything that is wrong with a scenario or a recipe, a line each.

    A scenario whose keys are right is placed too, and the behaviours that it weighs are looked up in its policies.
    """
    if _is_recipe(path):
        from crowdsim.policy.recipe import Recipe

        return [str(finding) for finding in find_faults(path, Recipe)]
    from crowdsim.crowd.scenario import find_scenario_faults, load_scenario

    findings = [str(finding) for finding in find_scenario_faults(path)]
    if findings:
        return findings
    try:
        scenario = load_scenario(path)
    except CrowdsimError as error:
        return str(error).splitlines()
    for check in (_check_behaviours, _check_places):
        try:
            check(scenario)
        except CrowdsimError as error:
            findings += str(error).splitlines()
    return findings


def find_file_warnings(path: Path) -> list[str]:
    """Return what a scenario without a fault asks of its policies that they cannot do, a line each.

    Policies that are not trained yet are passed over, since nobody knows what they can do.
    """
    if _is_recipe(path):
        return []
    from crowdsim import assets
    from crowdsim.crowd.scenario import load_scenario
    from crowdsim.crowd.scenario_warnings import speed_warnings
    from crowdsim.policy.bundle import read_document

    scenario = load_scenario(path)
    statistics = {}
    for name in dict.fromkeys(kind.policy for kind in scenario.types.values()) if scenario.targets else ():
        with suppress(PolicyError):
            statistics[name] = read_document(assets.find_bundle(name))["statistics"]
    return speed_warnings(scenario, statistics)


def check_scenario(scenario: Scenario) -> Placed:
    """Check what only shows when a scenario is put together, before anything is trained; return its avatars in place.

    Raises:
        ScenarioError: Behaviours are weighed that are not learned, or not all avatars fit.
        RecipeError: The recipe of a policy is invalid.
        PolicyError: A bundle is damaged.
    """
    _check_behaviours(scenario)
    return _check_places(scenario)


def _check_behaviours(scenario: Scenario) -> None:
    from crowdsim.crowd.cast import check_behaviours, learned_behaviours

    policies = dict.fromkeys(kind.policy for kind in scenario.types.values())
    check_behaviours(scenario, {name: learned_behaviours(name) for name in policies})


def _check_places(scenario: Scenario) -> Placed:
    from crowdsim.crowd.placement import place_groups

    return place_groups(scenario)


def _is_recipe(path: Path) -> bool:
    """Whether a file's top-level keys are those of a recipe; a broken file counts as a scenario unless it has them."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    keys = set()
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.ScalarEvent) and event.start_mark is not None and event.start_mark.column == 0:
                keys.add(event.value)
    except yaml.YAMLError:
        pass
    return bool(keys & _RECIPE_KEYS) and "groups" not in keys

"""Checks a file without using it: scenarios and recipes are told apart by their keys."""

from __future__ import annotations

from pathlib import Path

import yaml

from crowdsim.yaml_files import Finding, find_faults

_RECIPE_KEYS = {"motion", "graph", "control_rate", "playback_rate", "precision"}


def find_file_faults(path: Path) -> list[Finding]:
    """Return everything that is wrong with a scenario or a recipe, in the order of its lines."""
    if _is_recipe(path):
        from crowdsim.policy.recipe import Recipe

        return find_faults(path, Recipe)
    from crowdsim.crowd.scenario import find_scenario_faults

    return find_scenario_faults(path)


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

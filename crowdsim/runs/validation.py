"""Checks a file without using it: scenarios and recipes are told apart by their keys."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from crowdsim import assets
from crowdsim.config.files import find_faults
from crowdsim.errors import CrowdsimError, PolicyError, RecipeError, ScenarioError, nearest
from crowdsim.scenario.frame_ranges import frame_limit, output_frames

if TYPE_CHECKING:
    from crowdsim.crowd.placement import Placed
    from crowdsim.scenario.scenario import Scenario

_RECIPE_KEYS = {"motion", "graph", "control_rate", "playback_rate", "precision"}


def find_checked_file(name: str) -> Path:
    """Return the file that is meant by a path, or by the name of a scenario or a recipe.

    Raises:
        CrowdsimError: There is none; the message names those there are.
    """
    for find, error in ((assets.find_scenario, ScenarioError), (assets.find_recipe, RecipeError)):
        try:
            return find(name)
        except error:
            if Path(name).exists():
                return Path(name)
    names = [*assets.scenario_names(), *assets.recipe_names()]
    raise CrowdsimError(f"{name}: no such file, expected a file or one of {', '.join(names)}{nearest(name, names)}")


def find_file_faults(path: Path) -> list[str]:
    """Return everything that is wrong with a scenario or a recipe, a line each.

    A scenario whose keys are right is checked like one that is to be run. Events after its end are found, too.
    """
    if _is_recipe(path):
        from crowdsim.training.recipe import Recipe

        return [str(finding) for finding in find_faults(path, Recipe)]
    from crowdsim.scenario.scenario import find_scenario_faults, load_scenario

    findings = [str(finding) for finding in find_scenario_faults(path)]
    if findings:
        return findings
    try:
        scenario = load_scenario(path)
    except CrowdsimError as error:
        return str(error).splitlines()
    for check in (_check_behaviours, _check_times, _check_places):
        try:
            check(scenario)
        except CrowdsimError as error:
            findings += str(error).splitlines()
    if not findings:
        findings += late_events(scenario)
    return list(dict.fromkeys(findings))


def find_file_warnings(path: Path) -> list[str]:
    """Return what a scenario without a fault asks of its policies that they cannot do, a line each.

    Policies that are not trained yet are passed over, since nobody knows what they can do.
    """
    if _is_recipe(path):
        return []
    from crowdsim import assets
    from crowdsim.policy.bundle import read_document
    from crowdsim.scenario.scenario import load_scenario
    from crowdsim.scenario.warnings import speed_warnings

    scenario = load_scenario(path)
    statistics = {}
    for name in dict.fromkeys(kind.policy for kind in scenario.types.values()) if scenario.targets else ():
        with suppress(PolicyError):
            statistics[name] = read_document(assets.find_bundle(name))["statistics"]
    return speed_warnings(scenario, statistics)


def check_scenario(scenario: Scenario) -> Placed:
    """Check what only shows when a scenario is put together, before anything is trained; return its avatars in place.

    Raises:
        ScenarioError: Behaviours are weighed that are not learned, policies differ in their control rates, an output
            asks for frames after the end, or not all avatars fit.
        RecipeError: The recipe of a policy is invalid.
        PolicyError: A bundle is damaged.
    """
    _check_behaviours(scenario)
    _check_times(scenario)
    return _check_places(scenario)


def late_events(scenario: Scenario) -> list[str]:
    """Return the events of a scenario that are planned for after its end and so never happen, a line each."""
    rate = _control_rate(scenario)
    frames = scenario.control_frames(rate)
    lines = []
    for index, event in enumerate(scenario.events):
        frame: int | None = None
        if event.when.kind == "frame":
            frame, key = event.when.frame, "frame"
        elif event.when.kind == "seconds":
            frame, key = round(event.when.seconds * rate), "seconds"
        if frame is not None and frame >= frames:
            place = scenario.where("events", index, "when", key)
            value = f"{frame}" if key == "frame" else f"{event.when.seconds:g}"  # type: ignore[union-attr]
            lines.append(
                f"{place}: is {value}, but the run ends after {_length(frames, rate)}, expected a time before that"
            )
    return lines


def _check_behaviours(scenario: Scenario) -> None:
    from crowdsim.crowd.cast import check_behaviours, learned_behaviours

    policies = dict.fromkeys(kind.policy for kind in scenario.types.values())
    check_behaviours(scenario, {name: learned_behaviours(name) for name in policies})


def _check_times(scenario: Scenario) -> None:
    """See to it that all policies have one control rate, and that outputs ask for frames that there will be."""
    rate = _control_rate(scenario)
    count = scenario.control_frames(rate)
    lines = []
    for key, fps, frames in _ranges(scenario):
        if frames[0] >= output_frames(count, rate, fps) or frames[1] > frame_limit(count, rate, fps):
            last = output_frames(count, rate, fps) - 1
            what = f"is {list(frames)}, but the run has frames 0 to {last} at {fps:g} fps, {_length(count, rate)}"
            lines.append(f"{scenario.where('outputs', key, 'frames')}: {what}, expected a range within")
    if lines:
        raise ScenarioError("\n".join(lines))


def _ranges(scenario: Scenario) -> Iterator[tuple[str, float, tuple[int, int]]]:
    """Yield the outputs of a scenario that are cut to some frames: key, rate and range."""
    for key in ("bvh", "ply", "pcd", "render"):
        output = getattr(scenario.outputs, key)
        if output is not None:
            fps = output.fps or scenario.fps
            frames = output.frames_at(fps)
            if frames is not None:
                yield key, fps, frames


def _control_rate(scenario: Scenario) -> float:
    """Return the control rate of a scenario's policies [Hz].

    Raises:
        ScenarioError: They differ.
    """
    from crowdsim.crowd.cast import control_rate_of

    used = {name: kind.policy for name, kind in scenario.types.items() if name in scenario.used_types}
    rates = {policy: control_rate_of(policy) for policy in dict.fromkeys(used.values())}
    first = next(iter(rates.values()))
    for name, policy in used.items():
        if rates[policy] != first:
            told = ", ".join(f"{policy} has {rate:g}" for policy, rate in rates.items())
            place = scenario.where("types", name, "policy")
            raise ScenarioError(f"{place}: policies of one run need one control rate, but {told}")
    return first


def _length(frames: int, rate: float) -> str:
    return f"{frames} control frames ({frames / rate:g} s)"


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

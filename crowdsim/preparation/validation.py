"""Checks a file without using it: scenarios and recipes are recognised by their keys."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from crowdsim import assets
from crowdsim.config.files import Finding, find_faults
from crowdsim.config.nodes import MAXIMUM_BYTES
from crowdsim.errors import CrowdsimError, PolicyError, RecipeError, ScenarioError, nearest
from crowdsim.places.mesh import area_of
from crowdsim.scenario.frame_ranges import output_frames
from crowdsim.scenario.output import Extent, Ranged

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy
    from crowdsim.scenario.scenario import Scenario

_KEY = re.compile(rb"""^['"]?([A-Za-z_]+)['"]?[ ]*:""", re.MULTILINE)
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


def check_file(path: Path) -> tuple[list[str], list[str]]:
    """Return everything that is wrong with a scenario or a recipe, and warnings on one that is right, a line each.

    A scenario whose keys are right is checked like one that is to be run. Events after its end are found, too.
    Warnings say what a scenario asks of its policies that they cannot do.
    """
    if _is_recipe(path):
        from crowdsim.training.recipe import Recipe

        return [str(finding) for finding in find_faults(path, Recipe)], []
    from crowdsim.scenario.scenario import load_scenario

    lines: list[str] = []
    try:
        scenario = load_scenario(path)
    except CrowdsimError as error:
        return str(error).splitlines(), []
    for check in (_behaviour_findings, _time_findings, _stance_findings, _attachment_findings, _output_findings):
        try:
            lines += map(str, scenario.place(check(scenario)))
        except CrowdsimError as error:
            lines += str(error).splitlines()
    from crowdsim.crowd.placement import place_groups

    try:
        place_groups(scenario)
    except ScenarioError as error:
        lines += str(error).splitlines()
    if not lines:
        lines += map(str, scenario.place(late_events(scenario)))
    return list(dict.fromkeys(lines)), [] if lines else _warnings(scenario)


def _warnings(scenario: Scenario) -> list[str]:
    """Return what a scenario asks of its policies that they cannot do, a line each.

    Policies that are not trained yet are passed over, since their abilities are unknown.
    """
    from crowdsim import assets
    from crowdsim.crowd.attachments import attachment_warnings
    from crowdsim.policy.bundle import read_document
    from crowdsim.scenario.warnings import policy_warnings

    statistics = {}
    is_concerned = bool(scenario.targets) or any(group.enter is not None for group in scenario.groups)
    is_concerned |= any(event.kind == "leave" for event in scenario.events)
    is_concerned |= any(kind.damage is not None for kind in scenario.types.values())
    for name in dict.fromkeys(kind.policy for kind in scenario.types.values()) if is_concerned else ():
        with suppress(PolicyError):
            statistics[name] = read_document(assets.find_bundle(name))["statistics"]
    carrying = _trained(kind.policy for kind in scenario.types.values() if kind.attachments)
    warnings = [*policy_warnings(scenario, statistics), *attachment_warnings(scenario, carrying)]
    return [str(warning) for warning in scenario.place(warnings)]


def check_scenario(scenario: Scenario) -> None:
    """Check a scenario against the policies that it names, before anything is trained.

    Raises:
        ScenarioError: Behaviours are weighed that are not learned, policies differ in their control rates, or an
            output asks for frames after the end.
        RecipeError: The recipe of a policy is invalid.
        PolicyError: A bundle is damaged.
    """
    for check in (_behaviour_findings, _time_findings):
        scenario.refuse(check(scenario))


def late_events(scenario: Scenario) -> list[Finding]:
    """Return a finding for each event that is planned for after the end of a scenario and so never happens."""
    rate = control_rate(scenario)
    frames = scenario.control_frames(rate)
    findings = []
    for index, event in enumerate(scenario.events):
        frame: int | None = None
        if event.when.kind == "frame":
            frame, value = event.when.frame, f"{event.when.frame}"
        elif event.when.kind == "seconds":
            frame, value = round(event.when.seconds * rate), f"{event.when.seconds:g}"
        if frame is not None and frame >= frames:
            what = f"is {value}, but the run ends after {_length(frames, rate)}, expected a time before that"
            findings.append(Finding(("events", index, "when", event.when.kind), what))
    return findings + _late_entries(scenario, rate)


def _late_entries(scenario: Scenario, rate: float) -> list[Finding]:
    """Return a finding for each group of whom some would enter after the end of the run, even if nothing delays them.

    Groups that an event adds on a condition are passed over: nobody knows when that is.
    """
    frames, findings = scenario.control_frames(rate), []
    for index, group in enumerate(scenario.groups):
        begin = 0.0
        if group.waits:
            adds = [event for event in scenario.events if event.kind == "add" and event.group == group.name]
            times = [event.when for event in adds if event.when.kind in ("frame", "seconds")]
            if len(times) < len(adds) or not times:
                continue
            begin = min(one.frame if one.kind == "frame" else round(one.seconds * rate) for one in times)
        if group.enter is None or begin >= frames:
            continue
        interval = rate / group.enter.rate
        number = min(group.count, int((frames - 1 - begin) / interval) + 1)
        if number < group.count:
            what = f"is {group.enter.rate:g}, so that {number:,} of {group.count:,} avatars enter before the end after "
            what += f"{_length(frames, rate)}, expected a higher rate, a longer run or fewer avatars"
            findings.append(Finding(("groups", index, "enter", "rate"), what))
    return findings


def _behaviour_findings(scenario: Scenario) -> list[Finding]:
    from crowdsim.crowd.draw import unlearned_behaviours
    from crowdsim.preparation.prepare import learned_behaviours, reacts_to_strikes

    policies = dict.fromkeys(kind.policy for kind in scenario.types.values())
    reacting = [name for name in policies if reacts_to_strikes(name)]
    return unlearned_behaviours(scenario, {name: learned_behaviours(name) for name in policies}, reacting)


def _stance_findings(scenario: Scenario) -> list[Finding]:
    """Return a finding for each stance of which a policy has too little motion."""
    from crowdsim.crowd.stances import stance_findings

    return stance_findings(
        scenario, _trained(kind.policy for kind in scenario.types.values() if kind.stance is not None)
    )


def _attachment_findings(scenario: Scenario) -> list[Finding]:
    """Return a finding for each attachment at a joint that its avatars lack, or whose mesh cannot be read."""
    from crowdsim.crowd.attachments import attachment_findings

    return attachment_findings(scenario, _trained(kind.policy for kind in scenario.types.values() if kind.attachments))


def _output_findings(scenario: Scenario) -> list[Finding]:
    """Return what is wrong with outputs for the policies of their avatars."""
    from crowdsim.preparation.prepare import policy_names

    needed = any(output.reads_policies for output in scenario.outputs.wanted())
    return output_findings(scenario, list(_trained(policy_names(scenario) if needed else ()).values()))


def _trained(names: Iterable[str]) -> dict[str, Policy]:
    """Return the policies of these names that have been trained."""
    from crowdsim.policy.bundle import load_policy

    policies = {}
    for name in dict.fromkeys(names):
        with suppress(PolicyError):
            policies[name] = replace(load_policy(assets.find_bundle(name)), name=name)
    return policies


def _time_findings(scenario: Scenario) -> list[Finding]:
    """Return a finding for each output that asks for frames that there will not be."""
    from crowdsim.crowd.obstacles import pack_obstacles

    rate = control_rate(scenario)
    count = scenario.control_frames(rate)
    findings: list[Finding] = []
    outputs, area = scenario.outputs.resolved(scenario.fps).wanted(), area_of(pack_obstacles(scenario, None))
    extent = Extent(scenario.avatar_count, count, rate, area)
    for output in (output for output in outputs if isinstance(output, Ranged)):
        findings += map(output.place, output.findings_for(extent))
        frames, fps = output.asked_frames(), output.rate
        if frames is None:
            continue
        there_are = output_frames(count, rate, fps)
        if frames[1] > there_are:
            what = (
                f"is {list(frames)}, but the run has frames 0 to {there_are - 1} at {fps:g} fps, {_length(count, rate)}"
            )
            findings.append(output.place(Finding(("frames",), f"{what}, expected a range within")))
    return findings


def output_findings(scenario: Scenario, policies: Sequence[Policy]) -> list[Finding]:
    """Return what is wrong with the outputs of a scenario for its policies."""
    return [one.place(finding) for one in scenario.outputs.wanted() for finding in one.findings_with(policies)]


def control_rate(scenario: Scenario) -> float:
    """Return the control rate of a scenario's policies [Hz].

    Raises:
        ScenarioError: They differ.
    """
    from crowdsim.preparation.prepare import control_rate_of

    used = {name: kind.policy for name, kind in scenario.types.items() if name in scenario.used_types}
    rates = {policy: control_rate_of(policy) for policy in dict.fromkeys(used.values())}
    first = next(iter(rates.values()))
    for name, policy in used.items():
        if rates[policy] != first:
            result = ", ".join(f"{policy} has {rate:g}" for policy, rate in rates.items())
            raise scenario.error(f"policies of one run need one control rate, but {result}", "types", name, "policy")
    return first


def _length(frames: int, rate: float) -> str:
    return f"{frames} control frames ({frames / rate:g} s)"


def _is_recipe(path: Path) -> bool:
    """Whether a file's top-level keys are those of a recipe; a broken file counts as a scenario unless it has them."""
    try:
        with path.open("rb") as file:
            text = file.read(MAXIMUM_BYTES)
    except OSError:
        return False
    keys = {key.decode() for key in _KEY.findall(text)}
    return bool(keys & _RECIPE_KEYS) and "groups" not in keys

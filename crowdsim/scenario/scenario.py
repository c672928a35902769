"""Scenarios: YAML files on avatars, opponents, positions, duration and outputs of a run."""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic import ValidationError, ValidationInfo, model_validator

from crowdsim import assets
from crowdsim.config.files import Faults, Finding, collection_paused, dump_yaml, load_data, load_model
from crowdsim.config.schema import quoted
from crowdsim.core.types import FileName
from crowdsim.errors import ScenarioError, TakeError, nearest
from crowdsim.places.description import Obstacles, PlanObstacle, uneven_findings
from crowdsim.places.description import checksum as plan_checksum
from crowdsim.scenario.checks import name_findings, sense_findings
from crowdsim.scenario.description import MAXIMUM_SEED, Description
from crowdsim.scenario.fitness import CountEnd
from crowdsim.scenario.frame_ranges import parse_length
from crowdsim.scenario.groups import SEARCHES, PointsPlacement, TablePlacement, checksum
from crowdsim.scenario.parts import MAXIMUM_FRAMES, MAXIMUM_SECONDS, AvatarType

VERSION = 1


class Scenario(Description):
    """A scenario: avatars, opponents, positions, duration and outputs of a run.

    Lengths are metres, angles are degrees; x points to the left and z ahead of an avatar with heading 0.
    """

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Scenario:
        findings = [*name_findings(self.model_dump()), *sense_findings(self)]
        if findings:
            raise Faults(findings)
        return self

    @classmethod
    def findings_in(cls, data: Any) -> list[Finding]:
        """Return names that refer to nothing in the plain data of a scenario, be it valid otherwise or not."""
        return [*name_findings(data), *uneven_findings(data)]


@collection_paused()
def load_scenario(
    source: FileName | Mapping[str, Any] | Scenario,
    overrides: str | Sequence[str] = (),
    seed: int | None = None,
    frames: int | str | None = None,
    fraction: float | None = None,
    search: str | None = None,
    policies: Collection[str] | None = None,
) -> Scenario:
    """Return a scenario, resolved: types merged with those they extend, and every default written out.

    Args:
        source: The file, or the name of a scenario that ships or lies in the working folder's ``scenarios/``; or the
            keys of a file as a mapping, whose ``version`` may be left out; or another scenario.
        overrides: ``KEY=VALUE`` each, laid over the file, such as ``groups[0].count=12``.
        seed: Another seed.
        frames: Another duration: control frames, or text such as ``20s``.
        fraction: Share of each group's avatars to keep, above 0 and up to 1; at least one avatar of each stays. An end
            that waits for some to go down waits for as large a share of them.
        search: Another index for nearest opponents.
        policies: Names of the policies that there are; those that can be found by name when None.

    Raises:
        ScenarioError: With every finding in a line of its own, and as the tuple ``findings``.
    """
    known = assets.policy_names() if policies is None else policies
    given = [overrides] if isinstance(overrides, str) else overrides
    file = None
    if isinstance(source, Scenario | Mapping):
        folder = source.folder if isinstance(source, Scenario) else Path()
        data = source.model_dump(mode="json", exclude_none=True) if isinstance(source, Scenario) else source
        name = str(data.get("name", "scenario"))
        context = {"folder": folder, "policies": known}
        scenario = load_data({"version": VERSION, **data}, name, Scenario, ScenarioError, given, context)
    elif isinstance(source, str | os.PathLike):
        file = assets.find_scenario(source)
        folder, name = file.parent, str(file)
        scenario = load_model(file, Scenario, ScenarioError, given, {"folder": folder, "policies": known})
    else:
        what = f"the scenario is of type {type(source).__name__}"
        raise ScenarioError(f"{what}, expected a file, the name of a scenario, or a mapping with its keys")
    scenario = _changed(scenario, name, folder, seed, frames, fraction)
    if search is not None:
        if search not in SEARCHES:
            raise ScenarioError(f"the search is {search!r}, expected {quoted(SEARCHES)}{nearest(search, SEARCHES)}")
        scenario = with_search(scenario, search)
    resolved = resolve_scenario(scenario, folder)
    resolved._source = file
    return resolved


def check_loaded(scenario: Any) -> None:
    """Raise an error unless ``scenario`` is one, since it is easily taken for its name or its keys.

    Raises:
        ScenarioError: It is something else.
    """
    if not isinstance(scenario, Scenario):
        what = f"{scenario!r} is of type {type(scenario).__name__}"[:200]
        raise ScenarioError(f"{what}, expected a scenario, as crowdsim.load_scenario gives it")


def build_scenario(**keys: Any) -> Scenario:
    """Return the scenario with these keys, which are those of a file, resolved and checked as a file is.

    Raises:
        ScenarioError: With every finding in a line of its own, and as the tuple ``findings``.
    """
    return load_scenario(keys)


def _changed(
    scenario: Scenario,
    name: str,
    folder: Path,
    seed: int | None,
    frames: int | str | None,
    fraction: float | None,
) -> Scenario:
    """Return a scenario with another seed or length, or a part of its avatars, see ``load_scenario``."""
    changes: dict[str, Any] = {}
    if seed is not None:
        if not _is_whole(seed) or not 0 <= seed <= MAXIMUM_SEED:
            raise ScenarioError(f"the seed is {seed!r}, expected a whole number from 0 to {MAXIMUM_SEED}")
        changes["seed"] = int(seed)
    if frames is not None:
        changes["duration"] = _duration(frames)
    if fraction is not None:
        if not isinstance(fraction, float | int | np.floating) or not 0 < fraction <= 1:
            raise ScenarioError(f"the fraction is {fraction!r}, expected a number above 0 and up to 1")
        changes["groups"] = [
            {**group.model_dump(), "count": max(1, round(group.count * fraction))} for group in scenario.groups
        ]
        if isinstance(scenario.until, CountEnd) and scenario.until.down is not None:
            changes["until"] = {"down": max(1, int(scenario.until.down * fraction))}
    if changes:
        try:
            changed = Scenario.model_validate({**scenario.model_dump(), **changes}, context={"folder": folder})
        except ValidationError as error:
            reasons = [str(detail.get("ctx", {}).get("error", detail["msg"])) for detail in error.errors()]
            raise ScenarioError(f"{name}: with fraction {fraction}: {'; '.join(reasons)}") from None
        # A validated copy counts every key as set; types must keep which keys their file sets, to be merged.
        scenario = scenario.model_copy(update={key: getattr(changed, key) for key in changes})
    return scenario


def _is_whole(value: Any) -> bool:
    """Whether a value is a whole number, be it numpy's."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _duration(frames: int | str) -> int | dict[str, float]:
    """Return a length in control frames, or in text such as ``20s``, as the key ``duration`` has it."""
    if isinstance(frames, str):
        try:
            length, in_seconds = parse_length(frames)
        except TakeError as error:
            raise ScenarioError(str(error)) from None
        if in_seconds and not length <= MAXIMUM_SECONDS:
            raise ScenarioError(f"the length is {length:g} s, expected seconds above 0 and up to 1000000")
        if in_seconds:
            return {"seconds": length}
        frames = int(length)
    if not _is_whole(frames):
        raise ScenarioError(f"the length is {frames!r}, expected control frames, or text such as '20s'")
    if not 1 <= frames <= MAXIMUM_FRAMES:
        raise ScenarioError(f"the number of control frames is {frames}, expected one from 1 to 100000000")
    return int(frames)


def resolve_scenario(scenario: Scenario, folder: FileName = ".") -> Scenario:
    """Return the scenario with types merged with those they extend, groups named, and every default written out.

    Args:
        scenario: A valid scenario.
        folder: Folder that files named in the scenario lie in.

    Raises:
        ScenarioError: A file of points cannot be read.
    """
    folder = Path(folder)
    groups = []
    for i, group in enumerate(scenario.groups):
        placement = group.placement
        if isinstance(placement, PointsPlacement | TablePlacement) and placement.file is not None:
            try:
                found = checksum(folder / placement.file)
            except OSError as error:
                raise ScenarioError(f"{folder / placement.file}: cannot be read: {error.strerror}") from None
            placement = placement.model_copy(update={"sha256": found})
        groups.append(
            group.model_copy(
                update={
                    "name": group.name or f"group{i + 1}",
                    "opponents": group.opponents or scenario.opponents,
                    "placement": placement,
                }
            )
        )
    resolved = scenario.model_copy(
        update={
            "pre_roll": scenario.pre_roll_seconds,
            "types": _merged_types(scenario),
            "groups": tuple(groups),
            "obstacles": _with_checksums(scenario.obstacles, folder),
            "outputs": scenario.outputs.resolved(scenario.fps).named(scenario.members, scenario.cameras),
        }
    )
    resolved = with_search(resolved, scenario.opponents.search)
    resolved._folder = folder
    resolved._written_types = dict(scenario.types)
    return resolved


def _with_checksums(obstacles: Obstacles, folder: Path) -> Obstacles:
    """Return obstacles, floor plans with the checksums of their files."""

    def checked(one: Any) -> Any:
        if not isinstance(one, PlanObstacle):
            return one
        try:
            return one.model_copy(update={"sha256": plan_checksum(folder / one.file)})
        except OSError as error:
            raise ScenarioError(f"{folder / one.file}: cannot be read: {error.strerror}") from None

    return checked(obstacles) if isinstance(obstacles, PlanObstacle) else tuple(map(checked, obstacles))


def with_search(scenario: Scenario, search: str) -> Scenario:
    """Return the scenario with another index for nearest opponents, wherever it names one."""

    def searched(thing: Any) -> Any:
        found = getattr(thing, "opponents", None)
        if found is None or found.search == search:
            return thing
        return thing.model_copy(update={"opponents": found.model_copy(update={"search": search})})

    changed = searched(scenario)
    things = {key: tuple(map(searched, getattr(scenario, key))) for key in ("groups", "events")}
    return cast(Scenario, changed.model_copy(update=things))


def dump_scenario(scenario: Scenario) -> str:
    """Return a scenario as YAML; a resolved one, with its ``files`` beside it, loads again to an equal scenario."""
    return dump_yaml(scenario.model_dump(mode="json", exclude_none=True))


def scenario_schema() -> str:
    """Return the JSON Schema of scenario files as text; editors complete and check scenarios by it."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Scenario.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _merged_types(scenario: Scenario) -> dict[str, AvatarType]:
    """Return all types with their own settings over those of the types that they extend, mappings key by key."""
    merged: dict[str, AvatarType] = {}
    for start in scenario.types:
        chain: list[str] = []
        name: str | None = start
        while name is not None and name not in merged:
            chain.append(name)
            name = scenario.types[name].extends
        for one in reversed(chain):
            own = scenario.types[one]
            said = own.model_dump(exclude_unset=True)
            if own.extends is not None:
                base = merged[own.extends].model_dump()
                for key in ("behaviours", "candidates"):
                    said[key] = {**base[key], **said.get(key, {})}
                for key in ("damage", "stamina"):
                    if base[key] is not None and said.get(key) is not None:
                        said[key] = {**base[key], **said[key]}
                said = {**base, **said}
            merged[one] = AvatarType.model_validate({**said, "extends": None})
    return {name: merged[name] for name in scenario.types}

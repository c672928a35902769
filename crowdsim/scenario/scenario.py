"""Scenarios: YAML files on avatars, opponents, positions, duration and outputs of a run."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError, ValidationInfo, model_validator

from crowdsim import assets
from crowdsim.config.collection import collection_paused
from crowdsim.config.files import Faults, Finding, dump_yaml, load_model
from crowdsim.config.schema import quoted
from crowdsim.core.types import FileName
from crowdsim.errors import ScenarioError, nearest
from crowdsim.scenario.checks import name_findings, sense_findings
from crowdsim.scenario.description import MAXIMUM_SEED, Description
from crowdsim.scenario.fitness import CountEnd
from crowdsim.scenario.groups import (
    SEARCHES,
    PointsPlacement,
    checksum,
)
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
        return name_findings(data)


@collection_paused()
def load_scenario(
    path: FileName,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    frames: int | tuple[float, bool] | None = None,
    fraction: float | None = None,
    search: str | None = None,
    policies: Collection[str] | None = None,
) -> Scenario:
    """Return the scenario of a file, resolved: types merged with those they extend, and every default written out.

    Args:
        path: The file, or the name of a scenario that ships or lies in the working folder's ``scenarios/``.
        overrides: ``KEY=VALUE`` each, laid over the file, such as ``groups[0].count=12``.
        seed: Another seed.
        frames: Another duration [control frames]; or a length, and whether it is in seconds.
        fraction: Share of each group's avatars to keep, above 0 and up to 1; at least one avatar of each stays. An end
            that waits for some to go down waits for as large a share of them.
        search: Another index for nearest opponents.
        policies: Names of the policies that there are; those that can be found by name when None.

    Raises:
        ScenarioError: With every finding in a line of its own, and as the tuple ``findings``.
    """
    file = assets.find_scenario(path)
    scenario = load_model(file, Scenario, ScenarioError, overrides, _context(file, policies))
    scenario = _changed(scenario, file, seed, frames, fraction)
    if search is not None:
        if search not in SEARCHES:
            raise ScenarioError(f"the search is {search!r}, expected {quoted(SEARCHES)}{nearest(search, SEARCHES)}")
        scenario = with_search(scenario, search)
    resolved = resolve_scenario(scenario, file.parent)
    resolved._source = file
    return resolved


def _changed(
    scenario: Scenario, file: Path, seed: int | None, frames: int | tuple[float, bool] | None, fraction: float | None
) -> Scenario:
    """Return a scenario with another seed or length, or a part of its avatars, see ``load_scenario``."""
    changes: dict[str, Any] = {}
    if seed is not None:
        if not 0 <= seed <= MAXIMUM_SEED:
            raise ScenarioError(f"the seed is {seed}, expected a whole number from 0 to {MAXIMUM_SEED}")
        changes["seed"] = seed
    if frames is not None:
        length, in_seconds = frames if isinstance(frames, tuple) else (frames, False)
        if in_seconds and not 0 < length <= MAXIMUM_SECONDS:
            raise ScenarioError(f"the length is {length:g} s, expected seconds above 0 and up to 1000000")
        if not in_seconds and not 1 <= length <= MAXIMUM_FRAMES:
            raise ScenarioError(f"the number of control frames is {length:.0f}, expected one from 1 to 100000000")
        changes["duration"] = {"seconds": length} if in_seconds else int(length)
    if fraction is not None:
        if not 0 < fraction <= 1:
            raise ScenarioError(f"the fraction is {fraction}, expected a number above 0 and up to 1")
        changes["groups"] = [
            {**group.model_dump(), "count": max(1, round(group.count * fraction))} for group in scenario.groups
        ]
        if isinstance(scenario.until, CountEnd) and scenario.until.down is not None:
            changes["until"] = {"down": max(1, int(scenario.until.down * fraction))}
    if changes:
        try:
            changed = Scenario.model_validate({**scenario.model_dump(), **changes})
        except ValidationError as error:
            reasons = [str(detail.get("ctx", {}).get("error", detail["msg"])) for detail in error.errors()]
            raise ScenarioError(f"{file}: with fraction {fraction}: {'; '.join(reasons)}") from None
        # A validated copy counts every key as set; types must keep which keys their file sets, to be merged.
        scenario = scenario.model_copy(update={key: getattr(changed, key) for key in changes})
    return scenario


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
        if isinstance(placement, PointsPlacement) and placement.file is not None:
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
            "types": _merged_types(scenario),
            "groups": tuple(groups),
            "outputs": scenario.outputs.resolved(scenario.fps),
        }
    )
    resolved = with_search(resolved, scenario.opponents.search)
    resolved._folder = folder
    resolved._written_types = dict(scenario.types)
    return resolved


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


def _context(file: Path, policies: Collection[str] | None = None) -> dict[str, Any]:
    return {"folder": file.parent, "policies": assets.policy_names() if policies is None else policies}


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

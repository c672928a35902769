"""Scenarios: YAML files that say who fights whom, where, how long, and what a run writes."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationError, ValidationInfo, model_validator

from crowdsim import assets
from crowdsim.crowd.scenario_checks import name_faults, sense_faults
from crowdsim.crowd.scenario_events import Event
from crowdsim.crowd.scenario_groups import (
    AnyoneOpponents,
    Group,
    Opponents,
    PointsPlacement,
    Search,
    Target,
    checksum,
)
from crowdsim.crowd.scenario_outputs import Outputs
from crowdsim.crowd.scenario_parts import Arena, AvatarType, Name, NoArena
from crowdsim.errors import ScenarioError, nearest
from crowdsim.yaml_files import Fault, Faults, Finding, StrictModel, dump_yaml, find_faults, load_model, where
from crowdsim.yaml_schema import Words, join, spot_of
from crowdsim.yaml_tree import key_path

VERSION = 1
MAXIMUM_SEED = 2**63 - 1

FileName = str | PathLike[str]


_LENGTH = re.compile(r"\s*(\d+(?:\.\d+)?)\s*s\s*")


class Seconds(StrictModel):
    """A length of time."""

    seconds: float = Field(gt=0, le=1_000_000, description="Length of time [s].")


def _read_length(value: Any) -> Any:
    """Return text such as ``20s`` as plain data; anything else as it is."""
    match = _LENGTH.fullmatch(value) if isinstance(value, str) else None
    return value if match is None else {"seconds": float(match[1])}


def _allow_length_text(schema: dict[str, Any]) -> None:
    schema["anyOf"].insert(1, {"type": "string", "pattern": f"^{_LENGTH.pattern}$"})


class Scenario(StrictModel):
    """A scenario: who fights whom, where, how long, and what a run writes.

    Lengths are metres, angles are degrees; x points to the left and z ahead of an avatar with heading 0.
    """

    version: Literal[1] = Field(description="Version of this format.")
    name: Name = Field(description="Name of the scenario, and of the folder that a run writes.")
    description: str = Field(default="", description="What the scenario shows, in words.")
    seed: int = Field(default=0, ge=0, le=MAXIMUM_SEED, description="Seed of everything random.")
    duration: Annotated[
        Annotated[int, Field(ge=1, le=100_000_000)] | Seconds,
        BeforeValidator(_read_length),
        Words("text such as 20s", besides=True),
    ] = Field(
        description="Length in control frames, or in seconds: text such as `20s`, or a mapping with `seconds`.",
        json_schema_extra=_allow_length_text,
    )
    fps: float = Field(
        default=60.0, ge=1, le=1000, description="Frames per second of outputs that name no rate of their own."
    )
    arena: Arena = Field(default_factory=lambda: NoArena(kind="none"), description="Where avatars turn back.")
    types: dict[Name, AvatarType] = Field(min_length=1, description="Types of avatars by name.")
    groups: tuple[Group, ...] = Field(
        min_length=1, description="Groups of avatars; avatars are numbered in this order."
    )
    opponents: Opponents = Field(
        default_factory=lambda: AnyoneOpponents(kind="anyone"),
        description="Opponents of avatars whose group names none.",
    )
    keep_apart: bool = Field(
        default=True,
        description="Whether avatars avoid collisions; else they walk through one another.",
    )
    reactions: bool = Field(default=True, description="Whether avatars react to strikes that land on them.")
    targets: dict[Name, Target] = Field(default_factory=dict, description="Scripted targets by name.")
    events: tuple[Event, ...] = Field(default=(), description="Changes during the run; each happens once.")
    outputs: Outputs = Field(default_factory=Outputs, description="What a run writes beside its take.")

    _folder: Path = PrivateAttr(default=Path())
    _source: Path | None = PrivateAttr(default=None)
    _written_types: dict[str, AvatarType] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Scenario:
        faults = [*self.faults_in(self.model_dump()), *sense_faults(self)]
        if faults:
            raise Faults(faults)
        return self

    @classmethod
    def faults_in(cls, data: Any) -> list[Fault]:
        """Return names that refer to nothing in the plain data of a scenario, be it valid otherwise or not."""
        return name_faults(data)

    def __eq__(self, other: object) -> bool:
        """Scenarios are equal when they say the same, wherever they lie."""
        return isinstance(other, Scenario) and self.model_dump() == other.model_dump()

    @property
    def folder(self) -> Path:
        """Folder that files named in the scenario lie in."""
        return self._folder

    @property
    def avatar_count(self) -> int:
        """Number of avatars N, waiting groups included."""
        return sum(group.count for group in self.groups)

    @property
    def teams(self) -> tuple[str, ...]:
        """Names of the teams in the order in which groups name them."""
        return tuple(dict.fromkeys(group.team for group in self.groups))

    @property
    def files(self) -> tuple[str, ...]:
        """Files that the scenario reads, as paths in its folder; a copy of the scenario needs them beside it."""
        named = [group.placement.file for group in self.groups if isinstance(group.placement, PointsPlacement)]
        return tuple(dict.fromkeys(file for file in named if file is not None))

    @property
    def used_types(self) -> set[str]:
        """Names of the types that avatars have."""
        return {
            name
            for group in self.groups
            for name in (
                [group.type] if group.type is not None else [one for one, share in (group.mix or {}).items() if share]
            )
        }

    def where(self, *key: str | int) -> str:
        """Return where a key stands, for messages: file, line, column and key path, or the scenario's name and key."""
        return where(self._source, key) if self._source else f"{self.name}: {key_path(key)}"

    def inherited_behaviours(self, name: str) -> list[str]:
        """Return behaviours that a resolved type of the same policy as the one it extends only takes over from that."""
        written = self._written_types.get(name)
        if written is None or written.extends is None or self.types[written.extends].policy != self.types[name].policy:
            return []
        return [
            behaviour for behaviour in self.types[written.extends].behaviours if behaviour not in written.behaviours
        ]

    def control_frames(self, rate: float) -> int:
        """Return the length in control frames at ``rate`` control frames a second; at least 1."""
        if isinstance(self.duration, int):
            return self.duration
        return max(1, round(self.duration.seconds * rate))

    def avatar_names(self) -> list[str]:
        """Return the name of every avatar, its group's and a number that grows from 0: ``red_07``."""
        return [
            f"{group.name or f'group{i + 1}'}_{number:0{len(str(group.count - 1))}d}"
            for i, group in enumerate(self.groups)
            for number in range(group.count)
        ]

    def avatar_name(self, avatar: int) -> str:
        """Return the name of an avatar, its group's and a number that grows from 0: ``red_07``."""
        for i, group in enumerate(self.groups):
            if avatar < group.count:
                return f"{group.name or f'group{i + 1}'}_{avatar:0{len(str(group.count - 1))}d}"
            avatar -= group.count
        raise IndexError(f"there are {self.avatar_count} avatars")


def load_scenario(
    path: FileName,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    frames: int | tuple[float, bool] | None = None,
    fraction: float | None = None,
    search: str | None = None,
) -> Scenario:
    """Return the scenario of a file, resolved: types merged with those they extend, and every default written out.

    Args:
        path: The file, or the name of a scenario that ships or lies in the working folder's ``scenarios/``.
        overrides: ``KEY=VALUE`` each, laid over the file, such as ``groups[0].count=12``.
        seed: Another seed.
        frames: Another duration [control frames]; or a length, and whether it is in seconds.
        fraction: Share of each group's avatars to keep, above 0 and up to 1; at least one avatar of each stays.
        search: Another index for nearest opponents.

    Raises:
        ScenarioError: With every finding in a line of its own, and as the tuple ``findings``.
    """
    file = assets.find_scenario(path)
    scenario = load_model(file, Scenario, ScenarioError, overrides, _context(file))
    changes: dict[str, Any] = {}
    if seed is not None:
        if not 0 <= seed <= MAXIMUM_SEED:
            raise ScenarioError(f"the seed is {seed}, expected a whole number from 0 to {MAXIMUM_SEED}")
        changes["seed"] = seed
    if frames is not None:
        length, in_seconds = frames if isinstance(frames, tuple) else (frames, False)
        if in_seconds and not 0 < length <= 1_000_000:
            raise ScenarioError(f"the length is {length:g} s, expected seconds above 0 and up to 1000000")
        if not in_seconds and not 1 <= length <= 100_000_000:
            raise ScenarioError(f"the number of control frames is {length:.0f}, expected one from 1 to 100000000")
        changes["duration"] = {"seconds": length} if in_seconds else int(length)
    if fraction is not None:
        if not 0 < fraction <= 1:
            raise ScenarioError(f"the fraction is {fraction}, expected a number above 0 and up to 1")
        changes["groups"] = [
            {**group.model_dump(), "count": max(1, round(group.count * fraction))} for group in scenario.groups
        ]
    if changes:
        try:
            changed = Scenario.model_validate({**scenario.model_dump(), **changes})
        except ValidationError as error:
            reasons = [str(detail.get("ctx", {}).get("error", detail["msg"])) for detail in error.errors()]
            raise ScenarioError(f"{file}: with fraction {fraction}: {'; '.join(reasons)}") from None
        # A validated copy counts every key as set; types must still know what their file says to be merged.
        scenario = scenario.model_copy(update={key: getattr(changed, key) for key in changes})
    if search is not None:
        choices = spot_of(Search).words
        if search not in choices:
            raise ScenarioError(
                f"the search is {search!r}, expected {join([repr(word) for word in choices])}{nearest(search, choices)}"
            )
        scenario = with_search(scenario, search)
    resolved = resolve_scenario(scenario, file.parent)
    resolved._source = file
    return resolved


def find_scenario_faults(path: FileName, overrides: Sequence[str] = ()) -> list[Finding]:
    """Return everything that is wrong with a scenario file, in the order of its lines."""
    return find_faults(path, Scenario, overrides, _context(Path(path)))


def resolve_scenario(scenario: Scenario, folder: FileName = ".") -> Scenario:
    """Return the scenario with types merged with those they extend, groups named, and every default written out.

    Args:
        scenario: A valid scenario.
        folder: Folder that files named in the scenario lie in.
    """
    folder = Path(folder)
    groups = []
    for i, group in enumerate(scenario.groups):
        placement = group.placement
        if isinstance(placement, PointsPlacement) and placement.file is not None:
            placement = placement.model_copy(update={"sha256": checksum(folder / placement.file)})
        groups.append(
            group.model_copy(
                update={
                    "name": group.name or f"group{i + 1}",
                    "opponents": group.opponents or scenario.opponents,
                    "placement": placement,
                }
            )
        )
    outputs: dict[str, Any] = {}
    for key in ("bvh", "ply", "pcd"):
        output = getattr(scenario.outputs, key)
        if output is not None:
            fps = output.fps or scenario.fps
            outputs[key] = output.model_copy(update={"fps": fps, "frames": output.frames_at(fps)})
    render = scenario.outputs.render
    if render is not None:
        outputs["render"] = render.model_copy(update={"frames": render.frames_at(render.fps)})
    resolved = scenario.model_copy(
        update={
            "types": {name: _merged_type(scenario, name) for name in scenario.types},
            "groups": tuple(groups),
            "outputs": scenario.outputs.model_copy(update=outputs),
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
        if found is None:
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


def _context(file: Path) -> dict[str, Any]:
    return {"folder": file.parent, "policies": assets.policy_names()}


def _merged_type(scenario: Scenario, name: str) -> AvatarType:
    """Return a type with what it says itself over what the types say that it extends, mappings key by key."""
    own = scenario.types[name]
    said = own.model_dump(exclude_unset=True)
    if own.extends is not None:
        base = _merged_type(scenario, own.extends).model_dump()
        for key in ("behaviours", "candidates"):
            said[key] = {**base[key], **said.get(key, {})}
        said = {**base, **said}
    return AvatarType.model_validate({**said, "extends": None})

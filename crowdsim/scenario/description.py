"""The keys of a scenario."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, PrivateAttr

from crowdsim.config.files import Finding, StrictModel, place
from crowdsim.errors import ScenarioError
from crowdsim.places.description import Obstacles, PlanObstacle
from crowdsim.scenario.cameras import Cameras
from crowdsim.scenario.events import Event
from crowdsim.scenario.fitness import LINGERS, End
from crowdsim.scenario.groups import AnyoneOpponents, Group, Opponents, Target
from crowdsim.scenario.outputs import Outputs
from crowdsim.scenario.parts import MAXIMUM_FRAMES, MAXIMUM_SECONDS, Arena, AvatarType, Name, NoArena
from crowdsim.scenario.rates import Rate

MAXIMUM_SEED = 2**63 - 1
PRE_ROLL = 3.0
"""How long the pre-roll is of a scenario that does not say so [s]."""
_MOST_PRE_ROLLED = 1000
"""Most avatars of such a scenario that have one."""
_MOST = 10_000
"""How many types, groups and events there may be."""

_LENGTH = re.compile(r"\s*(\d+(?:\.\d+)?)\s*s\s*")


class Seconds(StrictModel):
    """A length of time."""

    seconds: float = Field(gt=0, le=MAXIMUM_SECONDS, description="Length of time [s].")


def _read_length(value: Any) -> Any:
    """Return text such as ``20s`` as plain data; anything else as it is."""
    match = _LENGTH.fullmatch(value) if isinstance(value, str) else None
    return value if match is None else {"seconds": float(match[1])}


def _allow_length_text(schema: dict[str, Any]) -> None:
    schema["anyOf"].append({"type": "string", "pattern": f"^{_LENGTH.pattern}$", "examples": ["20s"]})


class Description(StrictModel):
    """The keys of a scenario, and what follows from them.

    Lengths are metres, angles are degrees; x points to the left and z ahead of an avatar with heading 0.
    """

    renamed: ClassVar[dict[str, str]] = {"keep_apart": "collision_avoidance"}

    version: Literal[1] = Field(description="Version of this format.")
    name: Name = Field(description="Name of the scenario, and of the folder that a run writes.")
    description: str = Field(default="", description="What the scenario shows, in words.")
    seed: int = Field(default=0, ge=0, le=MAXIMUM_SEED, description="Seed of everything random.")
    duration: Annotated[
        Annotated[int, Field(ge=1, le=MAXIMUM_FRAMES)] | Seconds,
        BeforeValidator(_read_length),
    ] = Field(
        description="Length in control frames, or in seconds: text such as `20s`, or a mapping with `seconds`.",
        json_schema_extra=_allow_length_text,
    )
    pre_roll: float | None = Field(
        default=None,
        ge=0,
        le=60,
        description="For how long avatars stand on guard before the first frame, so that a take begins in motion [s]; "
        "null: 3 s for up to 1000 avatars, else 0 s.",
    )
    fps: Rate = Field(
        default=60.0, description="Frames per second of outputs that name no rate of their own, or a fraction."
    )
    arena: Arena = Field(default_factory=lambda: NoArena(kind="none"), description="Where avatars turn back.")
    obstacles: Obstacles = Field(
        default=(),
        description="Walls, boxes, discs and ropes that avatars cannot pass; or a mapping with the `file` of a floor "
        "plan.",
    )
    types: dict[Name, AvatarType] = Field(min_length=1, max_length=_MOST, description="Types of avatars by name.")
    groups: tuple[Group, ...] = Field(
        min_length=1, max_length=_MOST, description="Groups of avatars; avatars are numbered in this order."
    )
    opponents: Opponents = Field(
        default_factory=lambda: AnyoneOpponents(kind="anyone"),
        description="Opponents of avatars whose group names none.",
    )
    collision_avoidance: bool = Field(
        default=True,
        description="Whether avatars avoid collisions; else they walk through one another.",
    )
    reactions: bool = Field(
        default=True,
        description="Whether strikes that land move those whom they hit, push them back and stun them, by their "
        "impulse.",
    )
    until: End | None = Field(
        default=None,
        description="What ends the run before its duration: `last_standing` (one avatar is left that is not down for "
        "good), `last_team` (those left are of one team), or a mapping with `down` or `landed`; null: nothing does.",
    )
    linger: float = Field(
        default=LINGERS, ge=0, le=3600, description="For how long the run goes on once `until` is met [s]."
    )
    targets: dict[Name, Target] = Field(default_factory=dict, description="Scripted targets by name.")
    events: tuple[Event, ...] = Field(
        default=(), max_length=_MOST, description="Changes during the run; each happens once."
    )
    cameras: Cameras = Field(
        default_factory=dict,
        max_length=_MOST,
        description="Cameras by name, for `outputs.render`, its shots and `crowdsim render`; they change no take.",
    )
    outputs: Outputs = Field(
        default_factory=Outputs, description="What a run writes beside its take; what is null is not written."
    )

    _folder: Path = PrivateAttr(default=Path())
    _source: Path | None = PrivateAttr(default=None)
    _written_types: dict[str, AvatarType] = PrivateAttr(default_factory=dict)

    def __eq__(self, other: object) -> bool:
        """Scenarios are equal when their values are, whatever their files."""
        return isinstance(other, Description) and self.model_dump() == other.model_dump()

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
        return tuple(dict.fromkeys(team for group in self.groups for team in group.teams))

    @property
    def files(self) -> tuple[str, ...]:
        """Files that the scenario reads, as paths in its folder; a copy of the scenario needs them beside it."""
        named = [getattr(group.placement, "file", None) for group in self.groups]
        plans = (self.obstacles,) if isinstance(self.obstacles, PlanObstacle) else self.obstacles
        named += [plan.file for plan in plans if isinstance(plan, PlanObstacle)]
        named += [getattr(one, "file", None) for kind in self.types.values() for one in kind.attachments or ()]
        return tuple(dict.fromkeys(file for file in named if file is not None))

    @property
    def used_types(self) -> set[str]:
        """Names of the types that avatars have."""
        return {name for group in self.groups for name in group.types}

    def place(self, findings: Iterable[Finding]) -> list[Finding]:
        """Return findings with their positions in the scenario's file, or with its name where it is of none."""
        if self._source is not None:
            return place(self._source, findings)
        return [replace(finding, source=self.name) for finding in findings]

    def error(self, message: str, *loc: str | int) -> ScenarioError:
        """Return the error that reports what is wrong at a key, and where that is."""
        return ScenarioError(str(self.place([Finding(loc, message)])[0]))

    def refuse(self, findings: Sequence[Finding]) -> None:
        """Raise findings as one error, a line for each; do nothing where there are none.

        Raises:
            ScenarioError: There are findings.
        """
        if findings:
            raise ScenarioError("\n".join(map(str, self.place(findings))))

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

    @property
    def pre_roll_seconds(self) -> float:
        """How long the pre-roll is [s]."""
        if self.pre_roll is not None:
            return self.pre_roll
        return PRE_ROLL if self.avatar_count <= _MOST_PRE_ROLLED else 0.0

    @property
    def group_names(self) -> list[str]:
        """Names of the groups; those without a name of their own are called group1, group2, ..."""
        return [group.name or f"group{i + 1}" for i, group in enumerate(self.groups)]

    def avatar_names(self) -> list[str]:
        """Return the name of every avatar: a table's, or its group's and a number that grows from 0, ``red_07``."""
        return [
            avatar
            for group, name in zip(self.groups, self.group_names, strict=True)
            for avatar in group.avatar_names(name)
        ]

    def members(self, name: str) -> list[int] | None:
        """Return the numbers of the avatars that a name of an avatar, group or team means; None for other names."""
        prefix, _, number = name.rpartition("_")
        first = 0
        of_group: list[int] = []
        of_team: list[int] = []
        for group, own in zip(self.groups, self.group_names, strict=True):
            for i, row in enumerate(group.rows):
                if row.name.text == name:
                    return [first + i]
                of_team += [first + i] if name == (row.team.text or group.team) else []
            if not group.rows and prefix == own and number.isdecimal() and int(number) < group.count:
                return [first + int(number)]
            of_group += range(first, first + group.count) if name == own else ()
            of_team += range(first, first + group.count) if not group.rows and name == group.team else ()
            first += group.count
        return of_group or of_team or None

    def avatar_name(self, avatar: int) -> str:
        """Return the name of an avatar, see ``avatar_names``."""
        for group, name in zip(self.groups, self.group_names, strict=True):
            if avatar < group.count:
                row = group.rows[avatar : avatar + 1]
                return row[0].name.text if row else f"{name}_{avatar:0{len(str(group.count - 1))}d}"
            avatar -= group.count
        raise IndexError(f"there are {self.avatar_count} avatars")

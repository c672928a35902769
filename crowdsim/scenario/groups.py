"""Groups of a scenario: their avatars, placement and opponents."""

from __future__ import annotations

import hashlib
import math
import os
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from crowdsim.config.files import Fault, Faults, Finding, StrictModel
from crowdsim.config.findings import show
from crowdsim.scenario.names import is_portable
from crowdsim.scenario.parts import FARTHEST, MAXIMUM_FRAMES, Name, Point, Weights
from crowdsim.scenario.tables import Cell, Row, TableError, at, read_table

MAXIMUM_AVATARS = 10_000_000
_LEAST_LEG = 0.1
"""How far apart the points of a path are at the least [m]."""

Distance = Annotated[float, Field(ge=0.1, le=1000)]
Degrees = Annotated[float, Field(ge=-360, le=360)]

_RENAMED = {"turn": "rotation"}


class GridPlacement(StrictModel):
    """Rows and columns."""

    renamed: ClassVar[dict[str, str]] = _RENAMED

    kind: Literal["grid"] = Field(description="Rows and columns; avatars look along the columns.")
    spacing: Distance = Field(default=1.5, description="Distance between neighbours [m].")
    columns: int | None = Field(
        default=None, ge=1, le=MAXIMUM_AVATARS, description="Avatars in a row; without it a square."
    )
    centre: Point = Field(default=(0.0, 0.0), description="Centre, x and z [m].")
    rotation: Degrees = Field(default=0.0, description="Rotation of the whole about its centre [degrees].")


class RingPlacement(StrictModel):
    """A circle, evenly spaced."""

    renamed: ClassVar[dict[str, str]] = _RENAMED

    kind: Literal["ring"] = Field(description="On a circle, evenly spaced; avatars face its centre.")
    radius: float = Field(gt=0, le=100_000, description="Radius [m].")
    distance: Distance = Field(default=0.5, description="Least distance between neighbours [m].")
    centre: Point = Field(default=(0.0, 0.0), description="Centre, x and z [m].")
    rotation: Degrees = Field(default=0.0, description="Angle from +z at which the first avatar is [degrees].")


class LinePlacement(StrictModel):
    """A line, evenly spaced."""

    kind: Literal["line"] = Field(description="On a line, evenly spaced; avatars look across it.")
    start: Point = Field(description="Position of the first avatar, x and z [m].")
    end: Point = Field(description="Position of the last avatar, x and z [m].")
    distance: Distance = Field(default=0.5, description="Least distance between neighbours [m].")


class ArmyPlacement(StrictModel):
    """One of two armies that face each other."""

    renamed: ClassVar[dict[str, str]] = _RENAMED

    kind: Literal["army"] = Field(description="One of two armies that face each other across a gap.")
    side: Literal["left", "right"] = Field(description="`left` is at x > 0, `right` at x < 0 of the centre.")
    gap: float = Field(default=4.0, ge=0.1, le=100_000, description="Distance between the two front ranks [m].")
    ranks: int = Field(default=5, ge=1, le=100_000, description="Number of ranks of the army.")
    spacing: Distance = Field(default=1.2, description="Distance between neighbours [m].")
    depth: Distance | None = Field(
        default=None, description="Distance between ranks [m]; without it, as between neighbours."
    )
    offset: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="How far every other rank is offset along its line, over the distance between neighbours: with 0.5 "
        "its avatars are behind the gaps of the rank before it.",
    )
    centre: Point = Field(default=(0.0, 0.0), description="Middle of the gap, x and z [m].")
    rotation: Degrees = Field(default=0.0, description="Rotation of the whole about its centre [degrees].")


class DiscPlacement(StrictModel):
    """At random in a disc."""

    kind: Literal["disc"] = Field(description="At random in a disc, a least distance apart; avatars face its centre.")
    radius: float = Field(gt=0, le=100_000, description="Radius [m].")
    distance: Distance = Field(
        default=0.8,
        description="Least distance between avatars [m], also to those of groups earlier in the file.",
    )
    centre: Point = Field(default=(0.0, 0.0), description="Centre, x and z [m].")


class PointsPlacement(StrictModel):
    """At given points."""

    kind: Literal["points"] = Field(description="At given points, in their order; from a file or written here.")
    file: str | None = Field(
        default=None,
        description="A CSV or NPY file in the scenario's folder: x and z [m] and, if there is a third column, the "
        "heading [degrees].",
    )
    points: tuple[Point, ...] | None = Field(default=None, description="Points, x and z each [m].")
    sha256: str | None = Field(default=None, description="Checksum of the file; the resolved scenario fills it in.")

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> PointsPlacement:
        if (self.file is None) == (self.points is None):
            raise Fault("has {} 'file' {} 'points', expected one of them".format(*_both_or_none(self.file)))
        if self.file is not None:
            _find_file(self.file, self.sha256, (".csv", ".npy"), info)
        return self


class TablePlacement(StrictModel):
    """As a table says, which names each avatar."""

    kind: Literal["table"] = Field(
        description="As a table says, which names each avatar, and may give it a heading, a type and a team."
    )
    file: str = Field(
        description="A CSV file in the scenario's folder with a row for each avatar, below the names of columns: "
        "`name`, `x` and `z` [m], and, if wanted, `heading` [degrees], `type`, `team`, and `number`, the avatar's own "
        "in the group from 0. What a row leaves empty is as the group says.",
    )
    sha256: str | None = Field(default=None, description="Checksum of the file; the resolved scenario fills it in.")

    _path: Path = PrivateAttr(default=Path())
    _rows: tuple[Row, ...] = PrivateAttr(default=())

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows of the table by the numbers of their avatars."""
        return self._rows

    def describe(self, cell: Cell, message: str) -> str:
        """Return what is wrong with a cell, with its file, line and column."""
        return f"{self._path}:{at(cell, message)}"

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> TablePlacement:
        path = _find_file(self.file, self.sha256, (".csv",), info)
        if path is None:
            raise Fault(f"{show(self.file)}, expected a folder that it is read from", "file")
        try:
            self._path, self._rows = path, read_table(path)
        except TableError as error:
            raise Faults(Finding(("file",), f"{path}:{fault}") for fault in error.faults) from None
        except OSError as error:
            raise Fault(f"{show(self.file)}, which cannot be read: {error.strerror}", "file") from None
        return self


def _find_file(file: str, sha256: str | None, suffixes: tuple[str, ...], info: ValidationInfo) -> Path | None:
    """Return the path of a placement's file in the scenario's folder; None where no folder is known.

    Raises:
        Fault: There is no such file, it may not be used, or it is another than that of the checksum.
    """
    inner = PurePosixPath(file.replace("\\", "/"))
    kinds = " or ".join(suffixes)
    if inner.is_absolute() or ".." in inner.parts or ":" in file:
        raise Fault(f"{show(file)}, expected a path inside the scenario's folder", "file")
    if not all(map(is_portable, inner.parts)):
        raise Fault(f"{show(file)}, expected a name that Windows allows, since runs hold the file too", "file")
    if inner.suffix.lower() not in suffixes:
        raise Fault(f"{show(file)}, expected a file that ends in {kinds}", "file")
    folder: Path | None = (info.context or {}).get("folder")
    if folder is None:
        return None
    path = folder / inner
    # Whatever the name is: Path.is_file fails on very long ones.
    if not os.path.isfile(path):
        near = sorted(other.name for other in folder.glob("*") if other.suffix.lower() in suffixes)
        words = kinds.replace(".", "").upper().replace("OR", "or")
        choice = f"one of {', '.join(near[:10])}" if near else f"a {words} file; the folder has none"
        raise Fault(f"{show(file)}, and {folder} holds no such file, expected {choice}", "file")
    if not path.resolve().is_relative_to(folder.resolve()):
        raise Fault(f"{show(file)}, a link that leaves the scenario's folder, expected a file in it", "file")
    try:
        has_changed = sha256 is not None and checksum(path) != sha256
    except OSError as error:
        raise Fault(f"{show(file)}, which cannot be read: {error.strerror}", "file") from None
    if has_changed:
        raise Fault("the file has changed, expected the checksum of the resolved scenario", "sha256")
    return path


Placement = Annotated[
    GridPlacement | RingPlacement | LinePlacement | ArmyPlacement | DiscPlacement | PointsPlacement | TablePlacement,
    Field(discriminator="kind"),
]
PACES = {"walk": 1.2, "run": 2.6}
"""The speed that avatars of scale 1 are to travel at [m/s]; they run a little slower."""
Gait = Annotated[
    Literal["walk", "run"],
    Field(
        description="How avatars travel, in their guard and as far as their policy's motion allows: `walk`, at about "
        "1.3 m/s, or `run`, at about 2.4 m/s."
    ),
]
Until = Literal["attacked", "end"]


def check_path(points: tuple[Point, ...], least: int) -> None:
    """Raise a fault where a path has too few points, or two in a row that are one.

    Raises:
        Fault: The path is none.
    """
    if len(points) < least:
        what = "where avatars appear, and where they go" if least > 1 else "where avatars go"
        raise Fault(f"has {len(points)} point{'s'[: len(points) != 1]}, expected {least} or more: {what}", "path")
    for i in range(1, len(points)):
        if math.dist(points[i - 1], points[i]) < _LEAST_LEG:
            what = f"is nearer than {_LEAST_LEG} m to the point before it, expected a way between them"
            raise Fault(what, "path", i)


class Entrance(StrictModel):
    """Avatars enter one by one along a path."""

    path: tuple[Point, ...] = Field(
        description="Points, x and z each [m]: avatars appear at the first one, and travel to the others in turn."
    )
    rate: float = Field(
        default=0.5,
        gt=0,
        le=100,
        description="Avatars that enter per second, while the start is free; it takes each about a second to leave it.",
    )
    gait: Gait = "walk"
    until: Until = Field(
        default="attacked",
        description="`attacked`: an avatar at which another one strikes fights from then on; `end`: none fights before "
        "it is at the end of its path.",
    )

    @model_validator(mode="after")
    def _check(self) -> Entrance:
        check_path(self.path, 2)
        return self


Facing = Literal["placement", "centre", "outwards", "enemies", "random"] | Degrees

Hysteresis = Annotated[float, Field(ge=0, le=100)]
Attackers = Annotated[
    int | None,
    Field(ge=1, le=12, description="How many avatars may attack one opponent; others wait around it. null: all."),
]
SearchName = Literal["auto", "kd_tree", "scipy"]
SEARCHES: tuple[str, ...] = get_args(SearchName)
"""Indices for nearest opponents, by name."""
Search = Annotated[
    SearchName,
    Field(
        description="How nearest opponents are found, for all groups alike; the take does not depend on it. `auto`: "
        "direct comparison in a small crowd, else `kd_tree`; `kd_tree`: our own tree for any number of avatars; "
        "`scipy`: scipy's tree, built for each frame."
    ),
]


class OtherTeamOpponents(StrictModel):
    """The nearest avatar of another team."""

    kind: Literal["other_team"] = Field(
        description="The nearest avatar of another team, rather one that fights back: see `anyone`."
    )
    hysteresis: Hysteresis = Field(
        default=0.3, description="How much nearer [m] another one must seem before an avatar changes its opponent."
    )
    attackers: Attackers = None
    search: Search = "auto"


class AnyoneOpponents(StrictModel):
    """The nearest avatar, whatever its team."""

    kind: Literal["anyone"] = Field(
        description="The nearest avatar, whatever its team. Of several near ones rather one that is ahead, looks at "
        "the avatar, fights it or has just hit it.",
    )
    hysteresis: Hysteresis = Field(
        default=0.3, description="How much nearer [m] another one must seem before an avatar changes its opponent."
    )
    attackers: Attackers = None
    search: Search = "auto"


class FixedOpponents(StrictModel):
    """One opponent for good."""

    kind: Literal["fixed"] = Field(description="One opponent for good: an avatar of a named group.")
    group: Name = Field(description="Group that the opponent belongs to.")
    member: int | None = Field(
        default=None,
        ge=0,
        description="Number of the opponent in that group, from 0; without it the n-th fights the n-th.",
    )
    search: Search = "auto"


class TargetOpponents(StrictModel):
    """A scripted target."""

    kind: Literal["target"] = Field(description="A scripted target of this scenario.")
    target: Name = Field(description="Name of the target.")
    search: Search = "auto"


Opponents = Annotated[
    OtherTeamOpponents | AnyoneOpponents | FixedOpponents | TargetOpponents, Field(discriminator="kind")
]


_Metres = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
Key = tuple[Annotated[int, Field(ge=0, le=MAXIMUM_FRAMES)], _Metres, Annotated[float, Field(gt=0, le=10)], _Metres]
"""Control frame, x, height and z of a target [m]."""


class CircleTarget(StrictModel):
    """A target that moves along a circle."""

    kind: Literal["circle"] = Field(description="Goes round in a circle, from +z on towards +x.")
    radius: float = Field(gt=0, le=100_000, description="Radius [m].")
    speed: float = Field(
        default=0.5, ge=-20, le=20, description="Speed along the circle [m/s]; below 0 in the opposite direction."
    )
    centre: Point = Field(default=(0.0, 0.0), description="Centre, x and z [m].")
    height: float = Field(default=1.6, gt=0, le=10, description="Height of the target, the centre of its head [m].")

    @model_validator(mode="after")
    def _check(self) -> CircleTarget:
        reach = self.radius + max(map(abs, self.centre))
        if reach > FARTHEST:
            raise Fault(
                f"is {self.radius:g}, so that the target would be at {reach:g}, expected x and z up to {FARTHEST} m",
                "radius",
            )
        return self


class PointsTarget(StrictModel):
    """A target that moves from point to point."""

    kind: Literal["points"] = Field(description="Moves from point to point on straight lines.")
    points: tuple[Point, ...] = Field(
        min_length=1, description="Points, x and z each [m]; with one point the target is still."
    )
    speed: float = Field(default=0.5, ge=0, le=20, description="Speed along the lines [m/s].")
    loop: bool = Field(
        default=True, description="Whether it returns to the first point after the last one, or stops there."
    )
    height: float = Field(default=1.6, gt=0, le=10, description="Height of the target, the centre of its head [m].")


class KeysTarget(StrictModel):
    """A target that goes from key to key, as one that was dragged."""

    kind: Literal["keys"] = Field(
        description="Goes straight from key to key, such as one dragged in `crowdsim play`; avatars do not know "
        "beforehand where it goes."
    )
    keys: tuple[Key, ...] = Field(
        min_length=1,
        max_length=1_000_000,
        description="Control frame, x, height and z of the target then [m]; frames ascend. It stays at the last.",
    )
    before: Annotated[CircleTarget | PointsTarget, Field(discriminator="kind")] | None = Field(
        default=None,
        description="How it moves before the first key, which avatars know; without it, it waits where that one is.",
    )

    @model_validator(mode="after")
    def _check(self) -> KeysTarget:
        for i in range(1, len(self.keys)):
            if self.keys[i][0] <= self.keys[i - 1][0]:
                what = f"is at frame {self.keys[i][0]}, expected one after {self.keys[i - 1][0]} of the key before it"
                raise Fault(what, "keys", i)
        return self


Target = Annotated[CircleTarget | PointsTarget | KeysTarget, Field(discriminator="kind")]


def _without_default(schema: dict[str, Any]) -> None:
    del schema["default"]


class Group(StrictModel):
    """Avatars that are placed and led together."""

    name: Name | None = Field(
        default=None, description="Name, for events and fixed opponents; without it group1, group2, ..."
    )
    team: Name = Field(default="one", description="Name of the team.")
    type: Name | None = Field(default=None, description="Type of all avatars of the group.")
    mix: Weights | None = Field(default=None, description="Instead of `type`: types by weight, drawn for each avatar.")
    count: int = Field(
        default=0,
        ge=1,
        le=MAXIMUM_AVATARS,
        description="Number of avatars; of a placement `table`, without it as many as the table has rows.",
        json_schema_extra=_without_default,
    )
    placement: Placement | None = Field(
        default=None,
        description="Positions at the start; of a group that enters along a path, where each avatar goes behind it: "
        "without it none goes any further.",
    )
    enter: Entrance | None = Field(
        default=None,
        description="How avatars enter one by one along a path, and fight at its end; without it they are there at "
        "once. With `waits` the first one enters when an event adds the group.",
    )
    facing: Facing = Field(
        default="placement",
        description="Headings at the start: `placement` (as the placement says), `centre` or `outwards` (to or "
        "from the placement's centre), `enemies` (to the middle of all other teams), `random`, or a heading [degrees].",
    )
    opponents: Opponents | None = Field(default=None, description="Their opponents; without it those of the scenario.")
    waits: bool = Field(default=False, description="Whether the group stays away until an event adds it.")

    @model_validator(mode="after")
    def _check(self) -> Group:
        if self.mix is not None and not sum(self.mix.values()) > 0:
            raise Fault("all weights are 0, expected one above 0", "mix")
        if self.placement is None and self.enter is None:
            raise Fault("missing, expected a mapping with 'kind', or 'enter' with a path", "placement")
        if self.enter is not None and self.facing != "placement":
            raise Fault("has no effect with 'enter', since avatars look along their path, expected no facing", "facing")
        if not isinstance(self.placement, TablePlacement):
            if (self.type is None) == (self.mix is None):
                raise Fault("has {} 'type' {} 'mix', expected one of them".format(*_both_or_none(self.type)))
            if not self.count:
                raise Fault(f"missing, expected a whole number from 1 to {MAXIMUM_AVATARS}", "count")
            return self
        rows, file = self.placement.rows, self.placement.file
        if not self.count:
            object.__setattr__(self, "count", len(rows))
        if self.count > len(rows):
            raise Fault(f"is {self.count}, but {file} has {len(rows)} rows, expected at most as many", "count")
        if self.type is not None and self.mix is not None:
            raise Fault("has both 'type' and 'mix', expected one of them")
        if self.enter is not None and any(row.heading is not None for row in rows):
            what = f"is {file!r}, whose headings have no effect with 'enter', since avatars look along their path"
            raise Fault(f"{what}, expected no column 'heading'", "placement", "file")
        untyped = next((row for row in self.rows if not row.type.text), None)
        if untyped is not None and self.type is None and self.mix is None:
            what = f"has neither 'type' nor 'mix', and {file} has no type in line {untyped.type.line}"
            raise Fault(f"{what}, expected one of these")
        return self

    @property
    def rows(self) -> tuple[Row, ...]:
        """The rows of the table that places the avatars, one for each; none where no table does."""
        return self.placement.rows[: self.count] if isinstance(self.placement, TablePlacement) else ()

    @property
    def comes_later(self) -> bool:
        """Whether its avatars enter during the run, by an event or along a path."""
        return self.waits or self.enter is not None

    @property
    def types(self) -> list[str]:
        """Names of the types that avatars of the group have, or may draw."""
        own = [row.type.text for row in self.rows]
        drawn = [self.type] if self.type is not None else [name for name, share in (self.mix or {}).items() if share]
        return list(dict.fromkeys([*filter(None, own), *(drawn if not all(own) or not own else [])]))

    @property
    def teams(self) -> list[str]:
        """Names of the teams that avatars of the group are of."""
        return list(dict.fromkeys([row.team.text or self.team for row in self.rows] or [self.team]))

    def avatar_names(self, name: str) -> list[str]:
        """Return the names of its avatars: those of a table, or the group's and a number that grows from 0."""
        width = len(str(self.count - 1))
        return [row.name.text for row in self.rows] or [f"{name}_{number:0{width}d}" for number in range(self.count)]


def _both_or_none(one: object) -> tuple[str, str]:
    """Return the words for two keys that are both given, or both left out."""
    return ("neither", "nor") if one is None else ("both", "and")


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    with path.open("rb") as file:
        digest = hashlib.sha256()
        while chunk := file.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()

"""Groups of a scenario: their avatars, placement and opponents."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path, PurePosixPath
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field, ValidationInfo, model_validator

from crowdsim.config.files import Fault, StrictModel
from crowdsim.config.findings import show
from crowdsim.scenario.names import is_portable
from crowdsim.scenario.parts import FARTHEST, Name, Point, Weights

MAXIMUM_AVATARS = 10_000_000

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
        if self.file is None:
            return self
        inner = PurePosixPath(self.file.replace("\\", "/"))
        if inner.is_absolute() or ".." in inner.parts or ":" in self.file:
            raise Fault(f"{show(self.file)}, expected a path inside the scenario's folder", "file")
        if not all(map(is_portable, inner.parts)):
            raise Fault(f"{show(self.file)}, expected a name that Windows allows, since runs hold the file too", "file")
        if inner.suffix.lower() not in (".csv", ".npy"):
            raise Fault(f"{show(self.file)}, expected a file that ends in .csv or .npy", "file")
        folder: Path | None = (info.context or {}).get("folder")
        if folder is not None:
            path = folder / inner
            # Whatever the name is: Path.is_file fails on very long ones.
            if not os.path.isfile(path):
                near = sorted(other.name for other in folder.glob("*") if other.suffix.lower() in (".csv", ".npy"))
                choice = f"one of {', '.join(near[:10])}" if near else "a CSV or NPY file; the folder has none"
                raise Fault(f"{show(self.file)}, and {folder} holds no such file, expected {choice}", "file")
            if not path.resolve().is_relative_to(folder.resolve()):
                raise Fault(
                    f"{show(self.file)}, a link that leaves the scenario's folder, expected a file in it", "file"
                )
            try:
                has_changed = self.sha256 is not None and checksum(path) != self.sha256
            except OSError as error:
                raise Fault(f"{show(self.file)}, which cannot be read: {error.strerror}", "file") from None
            if has_changed:
                raise Fault("the file has changed, expected the checksum of the resolved scenario", "sha256")
        return self


Placement = Annotated[
    GridPlacement | RingPlacement | LinePlacement | ArmyPlacement | DiscPlacement | PointsPlacement,
    Field(discriminator="kind"),
]
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


Target = Annotated[CircleTarget | PointsTarget, Field(discriminator="kind")]


class Group(StrictModel):
    """Avatars that are placed and led together."""

    name: Name | None = Field(
        default=None, description="Name, for events and fixed opponents; without it group1, group2, ..."
    )
    team: Name = Field(default="one", description="Name of the team.")
    type: Name | None = Field(default=None, description="Type of all avatars of the group.")
    mix: Weights | None = Field(default=None, description="Instead of `type`: types by weight, drawn for each avatar.")
    count: int = Field(ge=1, le=MAXIMUM_AVATARS, description="Number of avatars.")
    placement: Placement = Field(description="Positions at the start.")
    facing: Facing = Field(
        default="placement",
        description="Headings at the start: `placement` (as the placement says), `centre` or `outwards` (to or "
        "from the placement's centre), `enemies` (to the middle of all other teams), `random`, or a heading [degrees].",
    )
    opponents: Opponents | None = Field(default=None, description="Their opponents; without it those of the scenario.")
    waits: bool = Field(default=False, description="Whether the group stays away until an event adds it.")

    @model_validator(mode="after")
    def _check(self) -> Group:
        if (self.type is None) == (self.mix is None):
            raise Fault("has {} 'type' {} 'mix', expected one of them".format(*_both_or_none(self.type)))
        if self.mix is not None and not sum(self.mix.values()) > 0:
            raise Fault("all weights are 0, expected one above 0", "mix")
        return self


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

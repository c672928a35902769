"""Obstacles as scenarios describe them."""

from __future__ import annotations

import hashlib
import math
import os
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, model_validator

from crowdsim.config.files import Fault, Finding, StrictModel
from crowdsim.config.findings import show
from crowdsim.config.schema import Expected

FARTHEST = 4_000
"""How far from the origin avatars, targets and obstacles may be along x and z [m]. Takes and exports have single
precision, whose steps are a quarter of a millimetre there; twice as far away planted feet would be seen to slide."""
PLANS = (".geojson", ".json", ".svg")
"""How files of floor plans end."""
UNEVEN = ("slope", "ramp", "stairs", "steps", "step", "hill", "terrain", "heightmap", "ground", "platform")
"""What cannot be an obstacle, since every avatar moves on one plane."""

_Coordinate = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
Point = Annotated[tuple[_Coordinate, _Coordinate], Expected("a list of two numbers, x and z [m]")]
_Thickness = Annotated[float, Field(gt=0, le=10, description="Thickness [m].")]
_Height = Annotated[float, Field(gt=0, le=100, description="Height [m].")]
_Seconds = Annotated[float, Field(ge=0, le=1_000_000)]


class Door(StrictModel):
    """A gap in a wall, which may be closed at first."""

    at: float = Field(ge=0, le=100_000, description="Where its middle is: distance along the wall from its start [m].")
    width: float = Field(default=1.0, ge=0.6, le=100, description="Width [m]; a body needs 0.6 m.")
    opens: _Seconds | None = Field(
        default=0.0, description="When it opens [s]; 0: it is open from the start; null: it stays closed."
    )
    closes: _Seconds | None = Field(default=None, description="When it closes again [s]; null: it stays open.")

    @model_validator(mode="after")
    def _check(self) -> Door:
        if self.closes is not None and (self.opens is None or self.closes <= self.opens):
            opens = "stays closed" if self.opens is None else f"opens at {self.opens:g} s"
            raise Fault(f"is {self.closes:g}, but the door {opens}, expected a time after it opens", "closes")
        return self


class WallObstacle(StrictModel):
    """A wall along a line of points, with doors in it."""

    kind: Literal["wall"] = Field(description="A wall along a line of points.")
    points: tuple[Point, ...] = Field(min_length=2, max_length=10_000, description="Points, x and z each [m].")
    closed: bool = Field(default=False, description="Whether the wall leads back from its last point to its first.")
    thickness: _Thickness = 0.2
    height: _Height = 2.5
    doors: tuple[Door, ...] = Field(default=(), max_length=1000, description="Doors, gaps in the wall.")

    @model_validator(mode="after")
    def _check(self) -> WallObstacle:
        lengths = line_lengths(self.points, self.closed)
        if not sum(lengths) > 0.0:
            raise Fault("all points are one, expected a line", "points")
        ends: list[tuple[float, float, int]] = []
        for index, door in enumerate(self.doors):
            first, last = door.at - door.width / 2, door.at + door.width / 2
            if first < -1e-9 or last > sum(lengths) + 1e-9:
                what = f"is {door.at:g}, so that the door leads nowhere: it reaches from {first:g} to {last:g} m of a "
                what += f"wall of {sum(lengths):g} m, expected {door.width / 2:g} to {sum(lengths) - door.width / 2:g}"
                raise Fault(what, "doors", index, "at")
            for other_first, other_last, other in ends:
                if first < other_last and other_first < last:
                    raise Fault(f"is {door.at:g}, where doors[{other}] is, expected doors apart", "doors", index, "at")
            ends.append((first, last, index))
        return self


class SolidObstacle(WallObstacle):
    """A wall around an outline of a floor plan that is solid inside, but for its holes."""

    holes: tuple[tuple[Point, ...], ...] = ()


class BoxObstacle(StrictModel):
    """A box."""

    kind: Literal["box"] = Field(description="A box, such as a car or a crate.")
    centre: Point = Field(description="Centre, x and z [m].")
    size: tuple[Annotated[float, Field(gt=0, le=10_000)], Annotated[float, Field(gt=0, le=10_000)]] = Field(
        description="Width along x and depth along z, before it is rotated [m]."
    )
    rotation: float = Field(default=0.0, ge=-360, le=360, description="Rotation about its centre [degrees].")
    height: _Height = 1.0


class DiscObstacle(StrictModel):
    """A round obstacle."""

    kind: Literal["disc"] = Field(description="A round obstacle, such as a pillar or a tree.")
    centre: Point = Field(description="Centre, x and z [m].")
    radius: float = Field(gt=0, le=10_000, description="Radius [m].")
    height: _Height = 2.5


class RopesObstacle(StrictModel):
    """Ropes around a place: everyone starts, and stays, inside."""

    kind: Literal["ropes"] = Field(description="Ropes around a place: everyone starts, and stays, inside.")
    points: tuple[Point, ...] = Field(min_length=3, max_length=10_000, description="Corners, x and z each [m].")
    height: _Height = 1.3


class PlanObstacle(StrictModel):
    """A floor plan from a file."""

    kind: Literal["plan"] = Field(default="plan", description="A floor plan from a file.")
    file: str = Field(
        description="A GeoJSON file in the scenario's folder: lines are walls, points with a `radius` are discs, "
        "polygons are solid, or walls where their `kind` is `room`. Or an SVG: lines and outlines are walls, filled "
        "rectangles are solid, circles are discs. The file's x and y are x and z."
    )
    scale: float = Field(
        default=1.0, gt=0, le=100_000, description="Metres to a unit of the file, along both of its axes."
    )
    centre: Point | None = Field(
        default=None, description="Where the middle of the plan is, x and z [m]; null: where its coordinates say."
    )
    thickness: _Thickness = 0.2
    height: _Height = 2.5
    sha256: str | None = Field(default=None, description="Checksum of the file; the resolved scenario fills it in.")

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> PlanObstacle:
        if "\\" in self.file:
            raise Fault(f"{show(self.file)}, expected / between folders", "file")
        inner = PurePosixPath(self.file)
        if inner.is_absolute() or ".." in inner.parts or ":" in self.file:
            raise Fault(f"{show(self.file)}, expected a path inside the scenario's folder", "file")
        if inner.suffix.lower() not in PLANS:
            raise Fault(f"{show(self.file)}, expected a file that ends in {', '.join(PLANS)}", "file")
        folder: Path | None = (info.context or {}).get("folder")
        if folder is None:
            return self
        path = folder / inner
        if not os.path.isfile(path):
            near = sorted(other.name for other in folder.glob("*") if other.suffix.lower() in PLANS)
            choice = f"one of {', '.join(near[:10])}" if near else "a floor plan; the folder has none"
            raise Fault(f"{show(self.file)}, and {folder} holds no such file, expected {choice}", "file")
        if not path.resolve().is_relative_to(folder.resolve()):
            raise Fault(f"{show(self.file)}, a link that leaves the scenario's folder, expected a file in it", "file")
        if self.sha256 is not None and checksum(path) != self.sha256:
            raise Fault("the file has changed, expected the checksum of the resolved scenario", "sha256")
        return self


Obstacle = Annotated[
    WallObstacle | BoxObstacle | DiscObstacle | RopesObstacle | PlanObstacle, Field(discriminator="kind")
]
Shape = WallObstacle | BoxObstacle | DiscObstacle | RopesObstacle
"""An obstacle that is no file."""


Obstacles = Annotated[tuple[Obstacle, ...], Field(max_length=100_000)] | PlanObstacle


def uneven_findings(data: Any) -> list[Finding]:
    """Return a finding for each key and obstacle of a scenario's plain data that would be uneven ground."""
    data = data if isinstance(data, dict) else {}
    found: list[tuple[str | int, ...]] = [(key,) for key in UNEVEN if key in data]
    obstacles = data.get("obstacles")
    for index, one in enumerate(obstacles if isinstance(obstacles, list) else ()):
        kind = one.get("kind") if isinstance(one, dict) else None
        if isinstance(kind, str) and kind in UNEVEN:
            found.append(("obstacles", index, "kind"))
    what = "uneven ground is not supported: every avatar moves on the plane y = 0"
    return [Finding(loc, what) for loc in found]


def line_lengths(points: tuple[Point, ...], closed: bool) -> list[float]:
    """Return the length of each stretch of a line of points [m]."""
    ends = [*points[1:], *points[:1]] if closed else points[1:]
    return [math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in zip(points, ends, strict=False)]


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()

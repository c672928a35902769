"""Floor plans from files: what they draw becomes walls, boxes and discs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from crowdsim.config.tree import shortened
from crowdsim.files import read_plain
from crowdsim.places.description import (
    FARTHEST,
    BoxObstacle,
    DiscObstacle,
    PlanObstacle,
    Shape,
    SolidObstacle,
    WallObstacle,
)
from crowdsim.places.geojson import read_geojson
from crowdsim.places.sketch import Line, PlanError, Sketch
from crowdsim.places.svg import read_svg

Model = TypeVar("Model", bound=BaseModel)

MOST_BYTES = 50_000_000
_MOST_POINTS = 100_000
_SMALLEST = 0.5
"""Least extent of a floor plan [m]."""
_SQUARE = 1e-3
"""Cosine of an angle up to which it counts as a right one."""


def read_plan(path: Path, plan: PlanObstacle) -> list[Shape]:
    """Return the shapes of a floor plan.

    Args:
        path: The file.
        plan: How it is laid out.

    Raises:
        PlanError: It cannot be read, or is no floor plan.
    """
    try:
        text = read_plain(path.parent, path.name, MOST_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise PlanError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise PlanError(f"{path}: is no UTF-8, expected a text file") from None
    sketch = (read_svg if path.suffix.lower() == ".svg" else read_geojson)(path, text)
    return _laid_out(path, sketch, plan)


def _laid_out(path: Path, sketch: Sketch, plan: PlanObstacle) -> list[Shape]:
    """Return the shapes of a sketch where its plan puts them."""
    points = sketch.points()
    if not points:
        raise PlanError(f"{path}: is no floor plan: it draws nothing, expected lines, outlines or circles")
    if len(points) > _MOST_POINTS:
        raise PlanError(f"{path}: has {len(points):,} points, expected at most {_MOST_POINTS:,}")
    low = [min(point[axis] for point in points) for axis in (0, 1)]
    high = [max(point[axis] for point in points) for axis in (0, 1)]
    extent = plan.scale * max(high[0] - low[0], high[1] - low[1], *(2 * radius for _, radius, *_ in sketch.discs), 0.0)
    if extent < _SMALLEST:
        what = f"{path}: is {extent:.3g} m large, expected {_SMALLEST} m or more; "
        what += "'scale' says how many metres a unit of the file is"
        is_map = path.suffix.lower() != ".svg"
        raise PlanError(what + (", degrees are projected to metres by the program that exports it" if is_map else ""))
    shift = (0.0, 0.0)
    if plan.centre is not None:
        shift = tuple(plan.centre[axis] - plan.scale * (low[axis] + high[axis]) / 2 for axis in (0, 1))  # type: ignore[assignment]

    def place(point: tuple[float, float]) -> tuple[float, float]:
        x, z = (plan.scale * point[axis] + shift[axis] for axis in (0, 1))
        if not (abs(x) <= FARTHEST and abs(z) <= FARTHEST):
            what = f"{path}: a point is at {x:.6g}, {z:.6g}, expected x and z up to {FARTHEST} m; "
            raise PlanError(what + "'centre' moves the plan, 'scale' makes it smaller")
        return x, z

    found: list[Shape] = []
    for line, closed, keys, where in sketch.walls:
        if len(set(line)) > 1:
            given = {"kind": "wall", "thickness": plan.thickness, "height": plan.height, "closed": closed, **keys}
            points = [place(point) for point in line]
            found.append(_made(WallObstacle, f"{where}: the wall from", points[0], points=points, **given))
    for rings, keys, where in sketch.solids:
        height = keys.get("height", plan.height)
        corners, *holes = ([place(point) for point in ring] for ring in rings)
        box = None if holes else _as_box(corners)
        if box is not None:
            found.append(_made(BoxObstacle, f"{where}: the box at", corners[0], kind="box", height=height, **box))
            continue
        given = {"thickness": min(plan.thickness, 0.1), "height": height, "closed": True, "kind": "wall"}
        given["points"], given["holes"] = corners, holes
        found.append(_made(SolidObstacle, f"{where}: the outline from", corners[0], **given))
        del given["holes"]
        found += [
            _made(WallObstacle, f"{where}: the hole from", hole[0], **{**given, "points": hole}) for hole in holes
        ]
    for middle, radius, keys, where in sketch.discs:
        given = {"centre": place(middle), "radius": plan.scale * radius, "height": keys.get("height", plan.height)}
        found.append(_made(DiscObstacle, f"{where}: the disc at", given["centre"], kind="disc", **given))
    return found


def _made(model: type[Model], name: str, at: tuple[float, float], **keys: Any) -> Model:
    """Return an obstacle of some keys; what is wrong with it is said with its name and where it is placed."""
    try:
        return model(**keys)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        expected = first["msg"].replace("Input should be", "expected a number")
        what = f"{where}: is {shortened(str(first['input']))}, {expected}"
        raise PlanError(f"{name} {at[0]:g}, {at[1]:g}: {first.get('ctx', {}).get('error', what)}") from None


def _as_box(corners: Line) -> dict[str, Any] | None:
    """Return keys of the box that four corners are those of; None where they are those of no rectangle."""
    if len(corners) != 4:
        return None
    sides = [(b[0] - a[0], b[1] - a[1]) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    lengths = [math.hypot(*side) for side in sides]
    if min(lengths) <= 0.0:
        return None
    for (ax, az), (bx, bz), a, b in zip(sides, sides[1:], lengths, lengths[1:], strict=False):
        if abs(ax * bx + az * bz) > _SQUARE * a * b:
            return None
    centre = sum(point[0] for point in corners) / 4, sum(point[1] for point in corners) / 4
    rotation = math.degrees(math.atan2(-sides[0][1], sides[0][0]))
    return {"centre": centre, "size": (lengths[0], lengths[1]), "rotation": rotation}

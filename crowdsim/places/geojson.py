"""Floor plans from GeoJSON files (RFC 7946): x and y of positions are x and z."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from crowdsim.config.files import load_data
from crowdsim.config.tree import shortened
from crowdsim.errors import ScenarioError
from crowdsim.places.description import Door
from crowdsim.places.sketch import Line, PlanError, Sketch


def read_geojson(path: Path, text: str) -> Sketch:
    """Return what a GeoJSON file draws.

    Lines are walls, with the `doors` of their properties; polygons are solid, or walls where their property `kind` is
    `room`; points are discs where they have a `radius`. `thickness` and `height` stand in for those of the plan.

    Raises:
        PlanError: It is no GeoJSON, or what it holds cannot be a floor plan.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        where = f"line {error.lineno}: " if isinstance(error, json.JSONDecodeError) else ""
        raise PlanError(f"{path}: {where}is no JSON, expected a GeoJSON file") from None
    sketch = Sketch()
    if not isinstance(data, dict) or not isinstance(data.get("type"), str):
        raise PlanError(f"{path}: is no GeoJSON, expected an object with a type, such as FeatureCollection")
    features = data.get("features") if data["type"] == "FeatureCollection" else [data]
    if not isinstance(features, list):
        raise PlanError(f"{path}: has no list 'features', expected one")
    for index, feature in enumerate(features):
        where = f"features[{index}]" if data["type"] == "FeatureCollection" else data["type"]
        if not isinstance(feature, dict):
            raise PlanError(f"{path}: {where}: is no object, expected a feature")
        is_feature = feature.get("type") == "Feature"
        geometry = feature.get("geometry") if is_feature else feature
        given = (feature.get("properties") if is_feature else None) or {}
        if not isinstance(given, dict):
            raise PlanError(f"{path}: {where}.properties: is no object, expected one or null")
        if isinstance(geometry, dict):
            try:
                _add_geometry(f"{path}: {where}", geometry, given, sketch)
            except RecursionError:
                raise PlanError(f"{path}: {where}: collections are too deep, expected few in one another") from None
    return sketch


def _add_geometry(where: str, geometry: dict[str, Any], given: dict[str, Any], sketch: Sketch) -> None:
    """Add a geometry to a sketch; properties of no meaning are passed over."""
    kind, at = geometry.get("type"), geometry.get("coordinates")
    keys: dict[str, Any] = {
        name: _number(f"{where}.properties.{name}", given[name])
        for name in ("thickness", "height")
        if given.get(name) is not None
    }
    if kind == "GeometryCollection":
        for one in _list(where, geometry.get("geometries")):
            if isinstance(one, dict):
                _add_geometry(where, one, given, sketch)
    elif kind in ("LineString", "MultiLineString"):
        doors = given.get("doors") or []
        if not isinstance(doors, list):
            raise PlanError(f"{where}.properties.doors: is no list, expected one of doors")
        if doors:
            keys["doors"] = tuple(_door(f"{where}.properties.doors[{i}]", door) for i, door in enumerate(doors))
        for line in [at] if kind == "LineString" else _list(where, at):
            points = _line(where, line, sketch)
            closed = len(points) > 3 and points[0] == points[-1]
            sketch.walls.append((points[:-1] if closed else points, closed, keys, where))
    elif kind in ("Polygon", "MultiPolygon"):
        for polygon in [at] if kind == "Polygon" else _list(where, at):
            rings = [_ring(where, ring, sketch) for ring in _list(where, polygon)]
            if given.get("kind") == "room":
                sketch.walls += [(ring, True, keys, where) for ring in rings]
            elif rings:
                sketch.solids.append((rings, keys, where))
    elif kind in ("Point", "MultiPoint"):
        radius = given.get("radius")
        if radius is not None:
            for point in [at] if kind == "Point" else _list(where, at):
                middle = _line(where, [point], sketch)[0]
                sketch.discs.append((middle, _number(f"{where}.properties.radius", radius), keys, where))
    else:
        raise PlanError(f"{where}: geometry of type {kind!r}, expected LineString, Polygon or Point")


def _list(where: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise PlanError(f"{where}: coordinates are no list, expected one")
    return value


def _door(where: str, value: Any) -> Door:
    if not isinstance(value, dict):
        raise PlanError(f"{where}: is {shortened(repr(value))}, expected a door, such as {{'at': 2, 'width': 1}}")
    try:
        return Door.model_validate(value)
    except (ValidationError, OverflowError):
        try:
            return load_data(value, where, Door, ScenarioError)
        except ScenarioError as error:
            raise PlanError(str(error).replace("\n", "; ")) from None


def _number(where: str, value: Any) -> float:
    try:
        if not isinstance(value, bool) and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    except OverflowError:
        pass
    raise PlanError(f"{where}: is {shortened(repr(value))}, expected a number")


def _ring(where: str, value: Any, sketch: Sketch) -> Line:
    """Return an outline without its last position, which is its first."""
    points = _line(where, value, sketch)
    if len(set(points)) < 3:
        raise PlanError(f"{where}: an outline has {len(set(points))} corners, expected 3 or more that differ")
    return points[:-1] if points[0] == points[-1] else points


def _line(where: str, value: Any, sketch: Sketch) -> Line:
    """Return a line of positions; those that differ in height from others of the file are refused."""
    found: Line = []
    for position in _list(where, value):
        if not isinstance(position, list) or not 2 <= len(position) <= 3:
            raise PlanError(f"{where}: a position is {str(position)[:40]}, expected two numbers")
        x, z, *height = (_number(f"{where}: a position", number) for number in position)
        sketch.heights.update(height)
        found.append((x, z))
    if len(sketch.heights) > 1:
        low, high = min(sketch.heights), max(sketch.heights)
        what = f"{where}: positions are {low:g} to {high:g} m high: uneven ground is not supported, "
        raise PlanError(what + "every avatar moves on the plane y = 0, expected one height in the whole file")
    return found

"""Floor plans from GeoJSON files (RFC 7946): x and y of positions are x and z."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

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
            _add_geometry(f"{path}: {where}", geometry, given, sketch)
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
        for one in geometry.get("geometries") or []:
            if isinstance(one, dict):
                _add_geometry(where, one, given, sketch)
    elif kind in ("LineString", "MultiLineString"):
        doors = given.get("doors") or []
        if not isinstance(doors, list):
            raise PlanError(f"{where}.properties.doors: is no list, expected one of doors")
        if doors:
            keys["doors"] = tuple(Door.model_validate(door) for door in doors)
        for line in [at] if kind == "LineString" else _list(where, at):
            points = _line(where, line)
            closed = len(points) > 3 and points[0] == points[-1]
            sketch.walls.append((points[:-1] if closed else points, closed, keys))
    elif kind in ("Polygon", "MultiPolygon"):
        for rings in [at] if kind == "Polygon" else _list(where, at):
            for ring in _list(where, rings):
                points = _line(where, ring)
                points = points[:-1] if len(points) > 1 and points[0] == points[-1] else points
                if given.get("kind") == "room":
                    sketch.walls.append((points, True, keys))
                else:
                    sketch.solids.append((points, keys))
    elif kind in ("Point", "MultiPoint"):
        radius = given.get("radius")
        if radius is not None:
            for point in [at] if kind == "Point" else _list(where, at):
                middle = _line(where, [point])[0]
                sketch.discs.append((middle, _number(f"{where}.properties.radius", radius), keys))
    else:
        raise PlanError(f"{where}: geometry of type {kind!r}, expected LineString, Polygon or Point")


def _list(where: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise PlanError(f"{where}: coordinates are no list, expected one")
    return value


def _number(where: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PlanError(f"{where}: is {value!r}, expected a number")
    return float(value)


def _line(where: str, value: Any) -> Line:
    """Return a line of positions; those that differ in height are refused."""
    found: Line = []
    heights = set()
    for position in _list(where, value):
        if not isinstance(position, list) or not 2 <= len(position) <= 3:
            raise PlanError(f"{where}: a position is {str(position)[:40]}, expected two numbers")
        x, z, *height = (_number(f"{where}: a position", number) for number in position)
        heights.update(height)
        found.append((x, z))
    if len(heights) > 1:
        what = f"{where}: positions are {min(heights):g} to {max(heights):g} m high: uneven ground is not supported, "
        raise PlanError(what + "every avatar moves on the plane y = 0, expected one height")
    return found

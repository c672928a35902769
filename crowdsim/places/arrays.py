"""Obstacles as flat arrays, which compiled code can be handed whole: parts, a grid over them, and ways around."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.places.description import BoxObstacle, DiscObstacle, RopesObstacle, Shape, WallObstacle
from crowdsim.places.kernels.distance import CLEAR, REACH, clear_ways, gaps_at, list_parts
from crowdsim.places.kernels.records import BORDER, BOX, DISC, DOOR, PART, ROPES, WALL
from crowdsim.places.kernels.routes import CORNERS, link_corners, list_seen

ROPE = 0.03
"""Half the thickness of ropes [m]."""
_CELL, _MOST_CELLS = 0.25, 250_000
_WAYS_CELL, _MOST_WAYS_CELLS = 0.5, 40_000
_BESIDE = (0.45, 0.32)
"""How far from parts the corners of ways are, where there is room, and where there is less [m]."""
_MOST_CORNERS, _LOOKED_AT = 1200, 48
_MARGIN = 3.0


class Grid(NamedTuple):
    """Square cells over the ground: their corner, size [m], columns and rows."""

    x: float
    z: float
    size: float
    columns: float
    rows: float


class Places(NamedTuple):
    """Obstacles; n parts, V corners that ways lead over, P sets of open doors.

    Attributes:
        parts: The parts. Shape (n,), ``PART``.
        grid: Cells that list the parts near them.
        offsets: CSR: the parts of cell i are ``listed[offsets[i]:offsets[i + 1]]``. Shape (cells + 1,), int32.
        listed: The parts, int32, the nearest first.
        gaps: How far each of these is from any point of its cell at least [m], float64.
        clear: How far from any point of each cell the nearest part is at least, open doors included [m]. (cells,).
        phases: Control frames from which on each set of doors is open, the first from ever on. Shape (P,).
        corners: Corners, x and z [m]. Shape (V, 2).
        apart: Length of the shortest way between each two corners [m], infinite where there is none. Shape (P, V, V).
        ways_grid: Cells that list the corners seen from them.
        seen: The nearest corners seen from each cell, -1 behind the last. Shape (P, cells, ``CORNERS``), int32.
    """

    parts: Array
    grid: Grid
    offsets: Array
    listed: Array
    gaps: Array
    clear: Array
    phases: Array
    corners: Array
    apart: Array
    ways_grid: Grid
    seen: Array


def pack_parts(shapes: Sequence[tuple[int, Shape]], rate: float | None) -> Array:
    """Return the parts of obstacles.

    Args:
        shapes: Number of each obstacle in its scenario, and its shape.
        rate: Control frames a second, by which doors open; they open by seconds when None.

    Returns:
        Shape (n,), ``PART``.
    """
    found: list[tuple[float | int, ...]] = []
    always = (math.inf, math.inf)

    def add(
        ends: tuple[float, float, float, float], radius: float, height: float, kind: int, number: int,
        times: tuple[float, float] = always,
    ) -> None:  # fmt: skip
        x, z, to_x, to_z = ends
        length = math.hypot(to_x - x, to_z - z)
        ux, uz = ((to_x - x) / length, (to_z - z) / length) if length > 0.0 else (1.0, 0.0)
        middle = (x + to_x) / 2, (z + to_z) / 2
        found.append((*middle, ux, uz, length / 2, 0.0, radius, height, *times, kind, number))

    for number, shape in shapes:
        if isinstance(shape, WallObstacle):
            for ends, times in _stretches(shape, rate):
                add(ends, shape.thickness / 2, shape.height, WALL if times is None else DOOR, number, times or always)
        elif isinstance(shape, BoxObstacle):
            turn = math.radians(shape.rotation)
            # Rotations are about +y, from +z towards +x.
            along = math.cos(turn), -math.sin(turn)
            half = shape.size[0] / 2, shape.size[1] / 2
            found.append((*shape.centre, *along, *half, 0.0, shape.height, *always, BOX, number))
        elif isinstance(shape, DiscObstacle):
            add((*shape.centre, *shape.centre), shape.radius, shape.height, DISC, number)
        elif isinstance(shape, RopesObstacle):
            for a, b in zip(shape.points, [*shape.points[1:], shape.points[0]], strict=True):
                add((*a, *b), ROPE, shape.height, ROPES, number)
    return np.array(found, PART)


def _stretches(
    wall: WallObstacle, rate: float | None
) -> list[tuple[tuple[float, float, float, float], tuple[float, float] | None]]:
    """Return the stretches of a wall between its corners and doors, and its doors with the frames of opening."""

    def moment(seconds: float) -> float:
        return seconds if rate is None else float(round(seconds * rate))

    points = [*wall.points, *(wall.points[:1] if wall.closed else ())]
    lengths = [math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(points)]
    total = sum(lengths)
    cuts: list[tuple[float, float, tuple[float, float] | None]] = []
    at = 0.0
    for door in sorted(wall.doors, key=lambda one: one.at):
        first, last = max(door.at - door.width / 2, 0.0), min(door.at + door.width / 2, total)
        opens = math.inf if door.opens is None else -math.inf if door.opens == 0.0 else moment(door.opens)
        closes = math.inf if door.closes is None else moment(door.closes)
        # The round ends of what is beside a door must not narrow it.
        half = wall.thickness / 2
        cuts += [(at, first - half, None), (first, last, (opens, closes))]
        at = last + half
    cuts.append((at, total, None))
    found = []
    for first, last, times in cuts:
        began = 0.0
        for (ax, az), (bx, bz), length in zip(points[:-1], points[1:], lengths, strict=True):
            low, high = max(first, began), min(last, began + length)
            if length > 0.0 and low < high:
                a, b = (low - began) / length, (high - began) / length
                dx, dz = bx - ax, bz - az
                found.append(((ax + a * dx, az + a * dz, ax + b * dx, az + b * dz), times))
            began += length
    return found


def build_places(parts: Array, with_ways: bool = True) -> Places:
    """Return obstacles, ready for kernels; without parts arrays are empty, and no kernel looks at them.

    Args:
        parts: The parts, ``pack_parts``. Shape (n,), ``PART``.
        with_ways: Whether ways around them are worked out, which takes most of the time.
    """
    if not len(parts):
        none, nowhere = np.zeros(0, np.int32), Grid(0.0, 0.0, 1.0, 0.0, 0.0)
        return Places(
            np.zeros(0, PART), nowhere, np.zeros(1, np.int32), none, np.zeros(0), np.zeros(0), np.zeros(1),
            np.zeros((0, 2)), np.zeros((1, 0, 0)), nowhere, np.zeros((1, 0, CORNERS), np.int32),
        )  # fmt: skip
    grid = _grid_over(parts, REACH, _CELL, _MOST_CELLS)
    offsets, clear = np.zeros(int(grid.columns * grid.rows) + 1, np.int32), np.empty(int(grid.columns * grid.rows))
    held = list_parts(parts, grid, REACH, offsets, np.zeros(0, np.int32), np.zeros(0), clear)
    listed, gaps = np.empty(held, np.int32), np.empty(held)
    list_parts(parts, grid, REACH, offsets, listed, gaps, clear)
    order = np.lexsort([gaps, np.repeat(np.arange(len(clear)), np.diff(offsets))])
    times = np.concatenate([parts["opens"], parts["closes"]])
    phases = np.append(-np.inf, np.unique(times[np.isfinite(times)]))
    ways_grid = _grid_over(parts, _MARGIN, _WAYS_CELL, _MOST_WAYS_CELLS if with_ways else 1)
    cells = int(ways_grid.columns * ways_grid.rows)
    places = Places(
        parts, grid, offsets, listed[order], gaps[order], clear, phases, np.zeros((0, 2)),
        np.zeros((len(phases), 0, 0)), ways_grid, np.full((len(phases), cells, CORNERS), -1, np.int32),
    )  # fmt: skip
    if not with_ways:
        return places
    corners = _find_corners(places._replace(parts=_opened(parts)))
    places = places._replace(corners=corners, apart=np.empty((len(phases), len(corners), len(corners))))
    if not len(corners):
        return places
    from scipy.sparse.csgraph import shortest_path
    from scipy.spatial import cKDTree

    column, row = np.arange(cells) % int(ways_grid.columns), np.arange(cells) // int(ways_grid.columns)
    middles = np.column_stack([column + 0.5, row + 0.5]) * ways_grid.size + [ways_grid.x, ways_grid.z]
    near = cKDTree(corners).query(middles, k=np.arange(1, min(_LOOKED_AT, len(corners)) + 1))[1].astype(np.int32)
    for phase, frame in enumerate(phases):
        links = places.apart[phase]
        link_corners(places, frame, links)
        places.apart[phase] = shortest_path(np.where(np.isfinite(links), links, 0.0), directed=False)
        list_seen(places, frame, near, places.seen[phase])
    return places


def _grid_over(parts: Array, margin: float, cell: float, most: int) -> Grid:
    """Return a grid over parts and a margin, of no more than about some number of cells."""
    around = parts["half_along"] + parts["half_across"] + parts["radius"] + margin
    x, z = (parts["x"] - around).min(), (parts["z"] - around).min()
    wide, deep = (parts["x"] + around).max() - x, (parts["z"] + around).max() - z
    size = max(cell, math.sqrt(wide * deep / most), wide / most, deep / most)
    return Grid(float(x), float(z), float(size), float(int(wide / size) + 1), float(int(deep / size) + 1))


def _find_corners(places: Places) -> Array:
    """Return points beside the ends and corners of parts, over which ways around them lead. Shape (V, 2)."""
    found: list[Array] = []
    # The border of an arena is convex, so that no way bends around it.
    for part in places.parts[(places.parts["kind"] != DOOR) & (places.parts["obstacle"] != BORDER)]:
        beside, wide = np.empty((0, 2)), np.zeros(0, bool)
        for room in _BESIDE:
            points = _around(part, room)
            gaps = gaps_of(places, points, 0.0)
            if len(beside):
                points, gaps = points[~wide], gaps[~wide]
            wide = gaps >= 0.95 * room
            beside = np.concatenate([beside, points[wide]])
            if wide.all():
                break
        found.append(beside)
    for part in places.parts[places.parts["kind"] == DOOR]:
        ahead = np.array([-part["uz"], part["ux"]]) * (part["radius"] + _BESIDE[1])
        found.append(np.array([part["x"], part["z"]]) + np.array([[0.0, 0.0], ahead, -ahead]))
    points = np.concatenate([np.empty((0, 2)), *found])
    # Corners of neighbouring parts lie in the same places.
    _, first = np.unique(np.round(points / 0.2).astype(np.int64), axis=0, return_index=True)
    points = points[np.sort(first)]
    if len(points) > _MOST_CORNERS:
        points = points[np.linspace(0, len(points) - 1, _MOST_CORNERS).astype(np.int64)]
    return np.ascontiguousarray(points)


def _around(part: Array, room: float) -> Array:
    """Return points around the corners of a part, a little further from it than some room. Shape (m, 2)."""
    far = float(part["radius"]) + room
    if part["half_along"] == 0.0 and part["half_across"] == 0.0:
        angle = 2.0 * np.pi * np.arange(8) / 8
        local = far / math.cos(np.pi / 8) * np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        a, b = float(part["half_along"]) + far, float(part["half_across"]) + far
        local = np.array([[a, b], [a, -b], [-a, b], [-a, -b]])
    ux, uz = float(part["ux"]), float(part["uz"])
    turned = np.column_stack([local[:, 0] * ux - local[:, 1] * uz, local[:, 0] * uz + local[:, 1] * ux])
    return np.asarray(turned + np.array([float(part["x"]), float(part["z"])]))


def as_at_first(parts: Array) -> Array:
    """Return parts with all doors as they are at the start, for good."""
    first = parts.copy()
    is_open = parts["opens"] <= 0.0
    first["opens"], first["closes"] = np.where(is_open, -math.inf, math.inf), math.inf
    return first


def _opened(parts: Array) -> Array:
    """Return parts with all doors open."""
    opened = parts.copy()
    opened["opens"][parts["kind"] == DOOR], opened["closes"][parts["kind"] == DOOR] = -math.inf, math.inf
    return opened


def gaps_of(places: Places, points: Array, frame: float) -> Array:
    """Return how far points (n, 2) are from the nearest obstacle in a control frame [m], see ``gap_at``. Shape (n,)."""
    gaps = np.empty(len(points))
    gaps_at(places, float(frame), np.ascontiguousarray(points, dtype=float), gaps)
    return gaps


def are_ways_clear(parts: Array, starts: Array, ends: Array, room: float = CLEAR) -> Array:
    """Return whether ways from points to others (n, 2) keep some room [m] from all parts, doors included.

    Returns:
        Shape (n,), bool.
    """
    clear = np.ones(len(starts), bool)
    clear_ways(parts, np.ascontiguousarray(starts, float), np.ascontiguousarray(ends, float), room, clear)
    return clear

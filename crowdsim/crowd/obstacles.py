"""Obstacles of a scenario, and what is wrong with them: starts inside, doors to nowhere, places without a way out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.core.types import Array
from crowdsim.crowd.entering import REACH, points_around
from crowdsim.places.arrays import Places, build_places, gaps_of, pack_parts
from crowdsim.places.description import (
    BoxObstacle,
    Obstacles,
    PlanObstacle,
    RopesObstacle,
    Shape,
    SolidObstacle,
    WallObstacle,
    line_lengths,
)
from crowdsim.places.kernels.distance import CLEAR
from crowdsim.places.kernels.records import BORDER, DOOR, PART
from crowdsim.places.plans import read_plan
from crowdsim.places.sketch import PlanError
from crowdsim.scenario.groups import FixedOpponents, OtherTeamOpponents, TargetOpponents
from crowdsim.scenario.parts import SCALES, Arena, CircleArena, NoArena
from crowdsim.scenario.scenario import Scenario

_SAGITTA = 0.02
"""How far ropes along a circle are inside it [m]."""
_NARROWEST = 0.28
"""How far from obstacles bodies can pass [m]."""
_MOST_SQUARES = 500_000
_SQUARE = 0.4
"""Width of the rows that fill solid outlines [m]: the middle of a square is at most ``CLEAR`` from all of it."""
_PROBED = 0.5
"""How far before and behind a door there must be room [m]."""
_LEAST_WIDTH = 0.6
"""How wide a door is at least, as the crow flies [m]."""


def scenario_shapes(scenario: Scenario) -> list[tuple[int, Shape]]:
    """Return the obstacles of a scenario by their numbers, those of files as their shapes.

    Raises:
        ScenarioError: A floor plan cannot be read.
    """
    try:
        return obstacle_shapes(scenario.obstacles, scenario.arena, scenario.folder)
    except PlanError as error:
        raise scenario.error(str(error), *_key(scenario, error.obstacle), "file") from None


def obstacle_shapes(obstacles: Obstacles, arena: Arena, folder: Path) -> list[tuple[int, Shape]]:
    """Return obstacles by their numbers, those of files in a folder as their shapes, and the ropes of a solid arena.

    Raises:
        PlanError: A floor plan cannot be read.
    """
    found: list[tuple[int, Shape]] = []
    for number, one in enumerate((obstacles,) if isinstance(obstacles, PlanObstacle) else obstacles):
        if isinstance(one, PlanObstacle):
            try:
                found += [(number, shape) for shape in read_plan(folder / one.file, one)]
            except PlanError as error:
                error.obstacle = number
                raise
        else:
            found.append((number, one))
    if isinstance(arena, NoArena) or not arena.solid:
        return found
    x, z = arena.centre
    if isinstance(arena, CircleArena):
        sides = max(16, math.ceil(math.pi / math.acos(max(1.0 - _SAGITTA / arena.radius, 0.0))))
        angles = [2.0 * math.pi * side / sides for side in range(sides)]
        points = [(x + arena.radius * math.sin(angle), z + arena.radius * math.cos(angle)) for angle in angles]
    else:
        wide, deep = arena.size[0] / 2, arena.size[1] / 2
        points = [(x - wide, z - deep), (x - wide, z + deep), (x + wide, z + deep), (x + wide, z - deep)]
    return [*found, (BORDER, RopesObstacle.model_construct(kind="ropes", points=tuple(points), height=1.3))]


def pack_obstacles(scenario: Scenario, rate: float | None) -> Array:
    """Return the parts of a scenario's obstacles, see ``places.arrays.pack_parts``. Shape (n,), ``PART``.

    Args:
        scenario: The scenario.
        rate: Control frames a second; doors open by seconds when None.
    """
    shapes = scenario_shapes(scenario)
    return pack_parts(shapes, rate) if shapes else np.zeros(0, PART)


def fill_solids(shapes: Sequence[tuple[int, Shape]]) -> Array:
    """Return boxes inside of solid outlines, which leave no room beyond ``CLEAR`` of these. Shape (n,), ``PART``."""
    boxes: list[tuple[int, Shape]] = []
    for number, shape in shapes:
        if not isinstance(shape, SolidObstacle):
            continue
        low, high = np.min(shape.points, axis=0), np.max(shape.points, axis=0)
        xs, zs = (np.arange(low[axis] + _SQUARE / 2, high[axis], _SQUARE) for axis in (0, 1))
        inside = _solids_at([(number, shape)], np.stack(np.meshgrid(xs, zs), axis=-1).reshape(-1, 2)) > BORDER
        for z, row in zip(zs, inside.reshape(len(zs), len(xs)), strict=True):
            ends = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]])))
            for first, stop in ends.reshape(-1, 2):
                wide = float(_SQUARE * (stop - first))
                centre = float(xs[first]) + (wide - _SQUARE) / 2, float(z)
                boxes.append((number, BoxObstacle.model_construct(
                    kind="box", centre=centre, size=(wide, _SQUARE), rotation=0.0, height=1.0
                )))  # fmt: skip
    return pack_parts(boxes, 1.0) if boxes else np.zeros(0, PART)


def obstacle_findings(
    scenario: Scenario, shapes: Sequence[tuple[int, Shape]], places: Places, x: Array, z: Array
) -> list[Finding]:
    """Return what is wrong with obstacles, as shapes and built, and the positions of avatars at the start (N,)."""
    if not shapes:
        return []
    is_door = places.parts["kind"] == DOOR
    opened = build_places(places.parts[~is_door], with_ways=False) if is_door.any() else places
    findings = _start_findings(scenario, shapes, places, x, z)
    findings += _door_findings(scenario, shapes, opened)
    findings += _path_findings(scenario, shapes, opened)
    findings += _point_findings(scenario, shapes, opened)
    return findings or _enclosed_findings(scenario, _Regions(places), x, z)


def _key(scenario: Scenario, number: int) -> tuple[str | int, ...]:
    """Return where an obstacle is in its scenario."""
    if number == BORDER:
        return ("arena", "solid")
    return ("obstacles",) if isinstance(scenario.obstacles, PlanObstacle) else ("obstacles", number)


def _words(scenario: Scenario, number: int) -> str:
    """Return an obstacle in words."""
    if number == BORDER:
        return "the arena's ropes"
    return "the floor plan" if isinstance(scenario.obstacles, PlanObstacle) else f"obstacles[{number}]"


def _start_findings(
    scenario: Scenario, shapes: Sequence[tuple[int, Shape]], places: Places, x: Array, z: Array
) -> list[Finding]:
    """Return a finding for each group with avatars that start in obstacles, too near to them, or outside of ropes."""
    points = np.column_stack([x, z])
    solid = _solids_at(shapes, points)
    gaps = np.where(solid > BORDER, -CLEAR, gaps_of(places, points, 0.0))
    bad = gaps < CLEAR - 1e-6
    outside = np.zeros(len(points), bool)
    for _, shape in shapes:
        if isinstance(shape, RopesObstacle):
            outside |= ~_is_inside(shape.points, points)
    findings, first = [], 0
    for index, group in enumerate(scenario.groups):
        here = slice(first, first + group.count)
        for wrong, how in ((outside[here], "outside of ropes"), (bad[here] & ~outside[here], "")):
            numbers = first + np.flatnonzero(wrong)
            if not len(numbers):
                continue
            one = int(numbers[0])
            names = ", ".join(scenario.avatar_name(int(number)) for number in numbers[:3])
            names += f" and {len(numbers) - 3} more" if len(numbers) > 3 else ""
            at = f"{scenario.avatar_name(one)} at {x[one]:.2f}, {z[one]:.2f}"
            if how:
                what = f"{len(numbers)} of {group.count} avatars start {how}, {names}; {at}, expected all inside"
            else:
                number = int(solid[one]) if solid[one] > BORDER else _nearest_obstacle(places, points[one])
                how = f"{gaps[one]:.2f} m from" if gaps[one] > 0.0 else "inside"
                what = f"{len(numbers)} of {group.count} avatars start in or near obstacles, {names}; {at} is {how} "
                what += f"{_words(scenario, number)}, expected {CLEAR} m or more from all"
                free = _nearest_free(shapes, places, points[one])
                what += "" if free is None else f", such as {free[0]:.2f}, {free[1]:.2f}"
            findings.append(Finding(("groups", index, "placement"), what))
        first += group.count
    return findings


def _nearest_obstacle(places: Places, point: Array) -> int:
    """Return the number of the obstacle nearest to a point."""
    parts = places.parts
    dx, dz = point[0] - parts["x"], point[1] - parts["z"]
    over = np.abs(dx * parts["ux"] + dz * parts["uz"]) - parts["half_along"]
    beside = np.abs(dz * parts["ux"] - dx * parts["uz"]) - parts["half_across"]
    gaps = np.hypot(np.maximum(over, 0.0), np.maximum(beside, 0.0)) + np.minimum(np.maximum(over, beside), 0.0)
    return int(parts["obstacle"][int(np.argmin(gaps - parts["radius"]))])


def _solids_at(shapes: Sequence[tuple[int, Shape]], points: Array) -> Array:
    """Return the number of the solid outline that each of the points (n, 2) is inside; ``BORDER`` in none. (n,)."""
    found = np.full(len(points), BORDER)
    for number, shape in shapes:
        if isinstance(shape, SolidObstacle):
            inside = _is_inside(shape.points, points)
            for hole in shape.holes:
                inside &= ~_is_inside(hole, points)
            found[inside] = number
    return found


def _nearest_free(shapes: Sequence[tuple[int, Shape]], places: Places, point: Array) -> Array | None:
    """Return the nearest point, of a lattice, that is free."""
    steps = np.arange(-40, 41) * 0.1
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offsets = offsets[np.argsort(np.hypot(*offsets.T), kind="stable")]
    is_free = gaps_of(places, point + offsets, 0.0) >= CLEAR + 0.01
    free = np.flatnonzero(is_free & (_solids_at(shapes, point + offsets) == BORDER))
    return None if not len(free) else np.asarray(point + offsets[free[0]])


def _is_inside(corners: Sequence[tuple[float, float]], points: Array) -> Array:
    """Return whether points (n, 2) are inside a polygon, by even and odd crossings. Shape (n,), bool."""
    inside = np.zeros(len(points), bool)
    for (ax, az), (bx, bz) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if az != bz:
            crosses = (az > points[:, 1]) != (bz > points[:, 1])
            inside ^= crosses & (points[:, 0] < ax + (points[:, 1] - az) / (bz - az) * (bx - ax))
    return inside


def _paths(scenario: Scenario) -> Iterator[tuple[tuple[str | int, ...], Sequence[tuple[float, float]]]]:
    """Yield where each path is in a scenario, and its points."""
    for i, group in enumerate(scenario.groups):
        if group.enter is not None:
            yield ("groups", i, "enter", "path"), group.enter.path
    for i, event in enumerate(scenario.events):
        if event.kind == "leave":
            yield ("events", i, "path"), event.path


def _path_findings(scenario: Scenario, shapes: Sequence[tuple[int, Shape]], places: Places) -> list[Finding]:
    """Return a finding for each point of a path that is in or near an obstacle that is no door."""
    findings = []
    for key, path in _paths(scenario):
        points = np.array(path, float)
        solid = _solids_at(shapes, points)
        gaps = np.where(solid > BORDER, -CLEAR, gaps_of(places, points, 0.0))
        for i in np.flatnonzero(gaps < CLEAR - 1e-6).tolist():
            number = int(solid[i]) if solid[i] > BORDER else _nearest_obstacle(places, points[i])
            how = f"{gaps[i]:.2f} m from" if gaps[i] > 0.0 else "inside"
            what = (
                f"{points[i, 0]:g}, {points[i, 1]:g} is {how} {_words(scenario, number)}, expected {CLEAR} m or more "
            )
            free = _nearest_free(shapes, places, points[i])
            what += "from all" + ("" if free is None else f", such as {free[0]:.2f}, {free[1]:.2f}")
            findings.append(Finding((*key, i), what))
    return findings


def _point_findings(scenario: Scenario, shapes: Sequence[tuple[int, Shape]], places: Places) -> list[Finding]:
    """Return a finding for each point at which obstacles other than doors leave no room for an avatar of any size."""
    findings = []
    for i, event in enumerate(scenario.events):
        if event.kind != "place":
            continue
        point = np.array(event.point, float)
        if (
            gaps_of(places, point + np.concatenate([np.zeros((1, 2)), points_around()]), 0.0) < CLEAR * SCALES[0]
        ).all():
            obstacle = _words(scenario, _nearest_obstacle(places, point))
            what = f"{point[0]:g}, {point[1]:g} is in or near {obstacle}, and no point within {REACH:g} m has room; "
            free = _nearest_free(shapes, places, point)
            what += f"expected one that is {CLEAR} m or more from all"
            what += "" if free is None else f", such as {free[0]:.2f}, {free[1]:.2f}"
            findings.append(Finding(("events", i, "point"), what))
    return findings


def _door_findings(scenario: Scenario, shapes: Sequence[tuple[int, Shape]], places: Places) -> list[Finding]:
    """Return a finding for each door that is narrow across a corner, or leads into an obstacle other than a door."""
    walls = [(number, shape) for number, shape in shapes if isinstance(shape, WallObstacle) and shape.doors]
    findings = []
    for number, shape in walls:
        points = np.array([*shape.points, *(shape.points[:1] if shape.closed else ())])
        lengths = np.cumsum([0.0, *line_lengths(shape.points, shape.closed)])
        for index, door in enumerate(shape.doors):
            ends = np.array([door.at - door.width / 2, door.at + door.width / 2])
            first, last = np.column_stack([np.interp(ends, lengths, points[:, axis]) for axis in (0, 1)])
            across, middle = last - first, (first + last) / 2
            wide = float(np.hypot(*across))
            what = f"the door {door.at:g} m along "
            if wide < _LEAST_WIDTH - 1e-9:
                what += f"is across a corner of its wall, where it leaves a gap of {wide:.2f} m at {middle[0]:.2f}, "
                what += f"{middle[1]:.2f}, expected {_LEAST_WIDTH} m or more: move it along the wall, or widen it"
            else:
                ahead = np.array([-across[1], across[0]]) / wide * (shape.thickness / 2 + _PROBED)
                gaps = gaps_of(places, np.stack([middle + ahead, middle - ahead]), 0.0)
                if (gaps >= 0.25).all():
                    continue
                x, z = (middle + ahead) if gaps[0] < gaps[1] else (middle - ahead)
                blocked = _nearest_obstacle(places, np.array([x, z]))
                what += f"leads nowhere: {_words(scenario, blocked)} is behind it at {x:.2f}, {z:.2f}, "
                what += f"expected {_PROBED} m of room on both sides"
            key = _key(scenario, number)
            is_plan = isinstance(scenario.obstacles, PlanObstacle) or isinstance(
                scenario.obstacles[number], PlanObstacle
            )
            findings.append(Finding(key if is_plan else (*key, "doors", index), what))
    return findings


class _Regions:
    """Stretches of ground that no way joins; doors that ever open count as open."""

    def __init__(self, places: Places) -> None:
        from scipy import ndimage

        parts = places.parts.copy()
        parts["opens"][np.isfinite(parts["opens"])] = -math.inf
        parts["closes"] = math.inf
        grid = places.grid
        wide, deep = grid.columns * grid.size, grid.rows * grid.size
        size = max(0.1, math.sqrt(wide * deep / _MOST_SQUARES))
        columns, rows = int(wide / size) + 1, int(deep / size) + 1
        xs, zs = grid.x + (np.arange(columns) + 0.5) * size, grid.z + (np.arange(rows) + 0.5) * size
        squares = np.stack(np.meshgrid(xs, zs), axis=-1).reshape(-1, 2)
        # A gap that bodies fit through is a few squares wide, however these lie.
        room = _NARROWEST - 0.5 * size
        free = gaps_of(places._replace(parts=parts), squares, 0.0).reshape(rows, columns) > room
        self._labels, _ = ndimage.label(free, np.ones((3, 3), int))
        self._grid, self._size = grid, size
        self.count = int(self._labels.max()) + 1

    def at(self, x: Array, z: Array) -> Array:
        """Return the number of the region of each point (n,). Shape (n,)."""
        rows, columns = self._labels.shape
        column, row = ((x - self._grid.x) / self._size).astype(int), ((z - self._grid.z) / self._size).astype(int)
        beyond = (column < 0) | (row < 0) | (column >= columns) | (row >= rows)
        region = np.asarray(self._labels[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)])
        region[beyond] = self._labels[0, 0]  # the corners of the grid are open ground
        return region


def _enclosed_findings(scenario: Scenario, regions: _Regions, x: Array, z: Array) -> list[Finding]:
    """Return a finding for each group that no way leads to avatars that it could fight, and for each path likewise."""
    region = regions.at(x, z)
    starts = np.concatenate([[0], np.cumsum([group.count for group in scenario.groups])])
    names: list[str] = []
    for group in scenario.groups:  # rows of a table may name teams of their own
        names += [row.team.text or group.team for row in group.rows] or [group.team] * group.count
    team = np.array(names)
    findings = []
    for index, group in enumerate(scenario.groups):
        opponents = group.opponents or scenario.opponents
        if isinstance(opponents, TargetOpponents):
            continue
        mine = np.arange(starts[index], starts[index + 1])
        closed, has_opponents = 0, False
        for own in np.unique(team[mine]):
            others = np.ones(len(x), bool)
            if isinstance(opponents, OtherTeamOpponents):
                others = team != own
            elif isinstance(opponents, FixedOpponents):
                others = np.repeat([one.name == opponents.group for one in scenario.groups], np.diff(starts))
            some = mine[team[mine] == own]
            count = np.bincount(region[others], minlength=regions.count)
            closed += np.count_nonzero(count[region[some]] - others[some] <= 0)
            has_opponents |= bool(others.sum() > others[some[0]])
        if closed == len(mine) and has_opponents:
            one = int(mine[0])
            what = f"obstacles close the group in at {x[one]:.2f}, {z[one]:.2f}: no way leads to an opponent of any of "
            what += f"its avatars, expected a gap or a door of {2 * CLEAR:g} m or more"
            findings.append(Finding(("groups", index, "placement"), what))
    for key, path in _paths(scenario):
        here = regions.at(*np.array(path, float).T)
        for i in np.flatnonzero(here[1:] != here[:-1])[:1].tolist():
            (ax, az), (bx, bz) = path[i], path[i + 1]
            what = f"obstacles part {bx:g}, {bz:g} from {ax:g}, {az:g} before it, expected a gap or a door of "
            findings.append(Finding((*key, i + 1), f"{what}{2 * CLEAR:g} m or more"))
        named = scenario.events[int(key[1])].group if key[0] == "events" else None
        for index, group in enumerate(scenario.groups) if key[0] == "events" and not findings else ():
            is_meant = named is None or group.name == named
            if is_meant and (region[starts[index] : starts[index + 1]] != here[0]).all():
                what = f"obstacles part {path[0][0]:g}, {path[0][1]:g} from where {group.name} begins, expected a gap "
                findings.append(Finding((*key, 0), f"{what}or a door of {2 * CLEAR:g} m or more"))
    return findings

"""Positions and headings of avatars at the start."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.placement import Disc, Squares, first_conflict, insert_points, throw_darts
from crowdsim.crowd.obstacles import fill_solids, obstacle_findings, scenario_shapes
from crowdsim.crowd.placement_points import read_points
from crowdsim.crowd.random import Purpose, stream, uniform
from crowdsim.places.arrays import Places, build_places, pack_parts
from crowdsim.places.kernels.records import PART
from crowdsim.scenario.groups import (
    ArmyPlacement,
    DiscPlacement,
    GridPlacement,
    LinePlacement,
    PointsPlacement,
    RingPlacement,
    TablePlacement,
)
from crowdsim.scenario.parts import FARTHEST, Arena, CircleArena, RectangleArena
from crowdsim.scenario.scenario import Scenario

LEAST_DISTANCE = 0.1
_DARTS = 24


def place_groups(scenario: Scenario) -> Array:
    """Place all groups of a scenario, in their order; the same seed gives the same bytes.

    Returns:
        Positions x and z [m] and headings [rad] of all avatars, those that wait included. Shape (3, N).

    Raises:
        ScenarioError: Not all avatars fit; the message holds how many did.
    """
    groups = scenario.groups
    starts = np.concatenate([[0], np.cumsum([group.count for group in groups])])
    placed = np.empty((3, int(starts[-1])))
    x, z, headings = placed
    shapes = scenario_shapes(scenario)
    parts, solids = pack_parts(shapes, 1.0) if shapes else np.zeros(0, PART), fill_solids(shapes)
    obstacles = build_places(parts, with_ways=False)
    places = build_places(np.concatenate([parts, solids]), with_ways=False) if len(solids) else obstacles
    for i in range(len(groups)):
        start, stop = int(starts[i]), int(starts[i + 1])
        _place(scenario, i, start, stop, x, z, headings, places)
        _check_distance(scenario, i, start, x[start:stop], z[start:stop])
        if groups[i].placement is not None:
            _check_arena(scenario, i, start, x[start:stop], z[start:stop])
    _check_conflicts(scenario, starts, x, z)
    scenario.refuse(obstacle_findings(scenario, shapes, obstacles, x, z))
    team = teams_of_avatars(scenario)
    for i in range(len(groups)):
        _set_headings(scenario, i, slice(int(starts[i]), int(starts[i + 1])), team, x, z, headings)
    return placed


def groups_of_avatars(scenario: Scenario) -> Array:
    """Return the index of each avatar's group. Shape (N,), int32."""
    counts = [group.count for group in scenario.groups]
    return np.repeat(np.arange(len(counts), dtype=np.int32), counts)


def teams_of_avatars(scenario: Scenario) -> Array:
    """Return the index of each avatar's team in ``scenario.teams``. Shape (N,), int16."""
    numbers = {name: number for number, name in enumerate(scenario.teams)}
    teams = np.array([numbers.get(group.team, 0) for group in scenario.groups], np.int16)[groups_of_avatars(scenario)]
    first = 0
    for group in scenario.groups:
        for i, row in enumerate(group.rows):
            teams[first + i] = numbers[row.team.text or group.team]
        first += group.count
    return teams


def _place(
    scenario: Scenario, index: int, start: int, stop: int, x: Array, z: Array, heading: Array, places: Places
) -> None:
    """Write positions and the placement's own headings of one group."""
    group = scenario.groups[index]
    placement, count, here = group.placement, group.count, slice(start, stop)
    if placement is None and group.enter is not None:
        (x[here], z[here]), there = group.enter.path[0], group.enter.path[1]
        heading[here] = _bearing(there, x[here], z[here])
    elif isinstance(placement, DiscPlacement):
        _throw(scenario, index, placement, start, stop, x, z, places)
        heading[here] = _bearing(placement.centre, x[here], z[here])
    elif isinstance(placement, GridPlacement):
        columns = min(placement.columns or int(np.ceil(np.sqrt(count))), count)
        row, column = np.divmod(np.arange(count), columns)
        # The first row is in front; a last row that is not full is centred.
        filled = np.where(row == count // columns, count - count // columns * columns, columns)
        across = ((filled - 1) / 2 - column) * placement.spacing
        ahead = (-(-count // columns) - 1) / 2 - row
        x[here], z[here] = _rotated(placement.centre, placement.rotation, across, ahead * placement.spacing)
        heading[here] = np.radians(placement.rotation)
    elif isinstance(placement, RingPlacement):
        ratio = placement.distance / (2 * placement.radius)
        room = 1 if ratio > 1 else int(np.pi / np.arcsin(ratio) + 1e-9)
        where = f"on a ring of radius {placement.radius:g} m"
        least = placement.distance / 2 / np.sin(np.pi / count) if count > 1 else 0.0
        _check_room(scenario, index, room, where, placement.distance, f"a radius of {_up(least)} m")
        angle = np.radians(placement.rotation) + 2 * np.pi * np.arange(count) / count
        x[here] = placement.centre[0] + placement.radius * np.sin(angle)
        z[here] = placement.centre[1] + placement.radius * np.cos(angle)
        heading[here] = angle + np.pi
    elif isinstance(placement, LinePlacement):
        dx, dz = placement.end[0] - placement.start[0], placement.end[1] - placement.start[1]
        length = float(np.hypot(dx, dz))
        room = int(length / placement.distance + 1e-9) + 1
        where = f"on a line of {length:g} m"
        _check_room(
            scenario, index, room, where, placement.distance, f"a line of {_up((count - 1) * placement.distance)} m"
        )
        along = np.linspace(0.0, 1.0, count) if count > 1 else np.array([0.5])
        x[here], z[here] = placement.start[0] + along * dx, placement.start[1] + along * dz
        heading[here] = np.arctan2(-dz, dx)
    elif isinstance(placement, ArmyPlacement):
        files = -(-count // placement.ranks)
        rank, file = np.divmod(np.arange(count), files)
        filled = np.where(rank == count // files, count - count // files * files, files)
        sign = 1.0 if placement.side == "left" else -1.0
        away = sign * (placement.gap / 2 + rank * (placement.depth or placement.spacing))
        # Where ranks are offset, one that is not full keeps to the files of the others.
        beside = np.floor((files - filled) / 2) if placement.offset else (files - filled) / 2
        along = (file + beside - (files - 1) / 2 + rank % 2 * placement.offset) * placement.spacing
        x[here], z[here] = _rotated(placement.centre, placement.rotation, away, along)
        heading[here] = np.radians(placement.rotation) - sign * np.pi / 2
    elif isinstance(placement, PointsPlacement):
        points = read_points(scenario, index, placement)
        if len(points) < count:
            what = f"{len(points)} of {count} avatars fit, for there are {len(points)} points, expected {count} or more"
            raise scenario.error(what, "groups", index, "placement")
        x[here], z[here] = points[:count, 0], points[:count, 1]
        centre = (float(x[here].mean()), float(z[here].mean()))
        heading[here] = np.radians(points[:count, 2]) if points.shape[1] == 3 else _bearing(centre, x[here], z[here])
    elif isinstance(placement, TablePlacement):
        x[here], z[here] = [row.x for row in group.rows], [row.z for row in group.rows]
        given = np.array([np.nan if row.heading is None else np.radians(row.heading) for row in group.rows])
        inwards = _bearing((float(x[here].mean()), float(z[here].mean())), x[here], z[here])
        heading[here] = np.where(np.isnan(given), inwards, given)


def _throw(
    scenario: Scenario, index: int, placement: DiscPlacement, start: int, stop: int, x: Array, z: Array, places: Places
) -> None:
    least, count = placement.distance, stop - start
    squares = _squares(least, stop, x, z)
    first = 0
    for group in scenario.groups[:index]:
        # Groups that come later find their way among others when they are added (``entering``).
        if not group.comes_later and not scenario.groups[index].comes_later:
            insert_points(squares, first, first + group.count)
        first += group.count
    seeds = stream(scenario.seed, Purpose.PLACE)
    disc = Disc(float(placement.centre[0]), float(placement.centre[1]), float(placement.radius))
    reached = throw_darts(seeds, start, stop, disc, _DARTS, squares, places)
    # Random discs cover little more than half of the plane.
    needed = _up(least / 2 * np.sqrt(count / 0.5))
    where = f"in a disc of radius {placement.radius:g} m" + (", outside of obstacles," if len(places.parts) else "")
    _check_room(scenario, index, reached - start, where, least, f"a radius of about {needed} m")


def _check_room(scenario: Scenario, index: int, room: int, where: str, distance: float, cure: str) -> None:
    count = scenario.groups[index].count
    if room < count:
        what = f"{room} of {count} avatars fit {where} at least {distance:g} m apart"
        what += f", expected {cure}, a smaller distance or fewer avatars"
        raise scenario.error(what, "groups", index, "placement")


def _check_distance(scenario: Scenario, index: int, first: int, x: Array, z: Array) -> None:
    """Refuse avatars that are so far from the origin that single precision would show."""
    away = np.maximum(np.abs(x), np.abs(z))
    farthest = int(np.argmax(away))
    if away[farthest] > FARTHEST:
        what = f"avatar {scenario.avatar_name(first + farthest)} would be at {x[farthest]:g}, {z[farthest]:g}, "
        what += f"expected x and z up to {FARTHEST:g} m: further away single precision shows"
        raise scenario.error(what, "groups", index, "placement")


def _check_arena(scenario: Scenario, index: int, first: int, x: Array, z: Array) -> None:
    outside = np.flatnonzero(~_inside(scenario.arena, x, z))
    if len(outside):
        names = [scenario.avatar_name(first + int(avatar)) for avatar in outside[:3]]
        more = f" and {len(outside) - 3} more" if len(outside) > 3 else ""
        what = f"{len(outside)} of {len(x)} avatars are outside the arena, {', '.join(names)}{more}, expected all "
        what += f"inside {_arena_words(scenario.arena)}"
        raise scenario.error(what, "groups", index, "placement")


def _check_conflicts(scenario: Scenario, starts: Array, x: Array, z: Array) -> None:
    """Refuse avatars at one position, which given points, or groups placed independently, can bring about.

    A group that comes later finds its way among others when it is added (``entering``).
    """
    groups = scenario.groups
    at_once = [[i for i, group in enumerate(groups) if not group.comes_later]]
    for some in at_once + [[i] for i, group in enumerate(groups) if group.comes_later]:
        kinds = {placement.kind for i in some if (placement := groups[i].placement) is not None}
        if not kinds:
            continue
        if kinds <= {"disc"} or (len(some) == 1 and not kinds & {"points", "table"}):
            continue
        numbers = np.concatenate([np.arange(starts[i], starts[i + 1]) for i in some])
        xs, zs = x[numbers], z[numbers]
        second = first_conflict(_squares(LEAST_DISTANCE, len(xs), xs, zs))
        if second >= 0:
            distance = np.hypot(xs[:second] - xs[second], zs[:second] - zs[second])
            first = int(np.argmin(distance))
            index = int(np.searchsorted(starts, numbers[second], side="right") - 1)
            what = f"avatar {scenario.avatar_name(int(numbers[second]))} would be {distance[first]:.2f} m from "
            what += f"{scenario.avatar_name(int(numbers[first]))}, expected {LEAST_DISTANCE} m or more"
            raise scenario.error(what, "groups", index, "placement")


def _squares(size: float, count: int, x: Array, z: Array) -> Squares:
    """Return an empty hash grid over the first ``count`` of all positions."""
    heads = np.full(1 << max(4, int(count).bit_length()), -1, np.int32)
    return Squares(float(size), heads, np.full(count, -1, np.int32), x, z)


def _inside(arena: Arena, x: Array, z: Array) -> Array:
    if isinstance(arena, CircleArena):
        return np.hypot(x - arena.centre[0], z - arena.centre[1]) <= arena.radius * (1 + 1e-9)
    if isinstance(arena, RectangleArena):
        half = np.asarray(arena.size) / 2 * (1 + 1e-9)
        return (np.abs(x - arena.centre[0]) <= half[0]) & (np.abs(z - arena.centre[1]) <= half[1])
    return np.ones(len(x), bool)


def _arena_words(arena: Arena) -> str:
    if isinstance(arena, CircleArena):
        return f"a circle of radius {arena.radius:g} m"
    if isinstance(arena, RectangleArena):
        return f"a rectangle of {arena.size[0]:g} m by {arena.size[1]:g} m"
    return "open ground"


def _set_headings(scenario: Scenario, index: int, here: slice, team: Array, x: Array, z: Array, heading: Array) -> None:
    """Set the headings of a group as its ``facing`` asks."""
    group = scenario.groups[index]
    facing, placement = group.facing, group.placement
    if isinstance(facing, float | int):
        heading[here] = np.radians(facing)
    elif facing == "random":
        numbers = np.arange(here.start, here.stop)
        heading[here] = 2 * np.pi * uniform(scenario.seed, Purpose.FACING, numbers)
    elif facing == "enemies":
        for one in np.unique(team[here]):
            others, own = team != one, here.start + np.flatnonzero(team[here] == one)
            others = others if others.any() else np.ones(len(x), bool)
            heading[own] = _bearing((float(x[others].mean()), float(z[others].mean())), x[own], z[own])
    elif facing in ("centre", "outwards"):
        middle = (float(x[here].mean()), float(z[here].mean()))
        centre = getattr(placement, "centre", middle)
        heading[here] = _bearing(centre, x[here], z[here]) + (np.pi if facing == "outwards" else 0.0)
    heading[here] = np.mod(heading[here] + np.pi, 2 * np.pi) - np.pi


def _bearing(towards: tuple[float, float], x: Array, z: Array) -> Array:
    return np.arctan2(towards[0] - x, towards[1] - z)


def _rotated(centre: tuple[float, float], degrees: float, across: Array, ahead: Array) -> tuple[Array, Array]:
    """Return positions that are given to the left and ahead of a centre, rotated about +y."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return centre[0] + across * cos + ahead * sin, centre[1] - across * sin + ahead * cos


def _up(length: float) -> str:
    """Return a length rounded up to three digits."""
    if length <= 0:
        return "0"
    digit = 10.0 ** (np.floor(np.log10(length)) - 2)
    return f"{np.ceil(length / digit) * digit:g}"

"""Distances from obstacles, and free ways, are those of a naive twin."""

import math

import numpy as np
import pytest
from naive_places import gap_at as naive_gap_at
from naive_places import gap_to
from naive_places import is_way_free as naive_is_way_free
from naive_places import way_gap as naive_way_gap

from crowdsim.places.arrays import are_ways_clear, as_at_first, build_places, gaps_of, pack_parts
from crowdsim.places.description import BoxObstacle, DiscObstacle, Door, RopesObstacle, WallObstacle
from crowdsim.places.kernels.distance import (
    ANY_HEIGHT,
    CELLS,
    CLEAR,
    REACH,
    is_way_free,
    part_gap,
    way_gap,
)
from crowdsim.places.kernels.records import BORDER, DOOR, PART, WALL

SHAPES = [
    WallObstacle(
        kind="wall", points=((-4.0, -1.0), (1.0, -1.0), (2.0, 3.0)), doors=(Door(at=2.0, width=1.2, opens=2.0),)
    ),
    BoxObstacle(kind="box", centre=(-2.0, 2.0), size=(1.6, 0.5), rotation=25.0, height=0.8),
    DiscObstacle(kind="disc", centre=(3.5, -2.0), radius=0.7),
    RopesObstacle(kind="ropes", points=((-6.0, -6.0), (-6.0, 6.0), (6.0, 6.0), (6.0, -6.0))),
]
PARTS = pack_parts(list(enumerate(SHAPES)), 15.0)
PLACES = build_places(PARTS)


def points(count, seed=0, half=7.0):
    return np.random.default_rng(seed).uniform(-half, half, (count, 2))


def test_distances_of_points_match_naive():
    for x, z in points(300):
        for part in PARTS:
            gap, nx, nz = part_gap(part, x, z)
            assert gap == pytest.approx(gap_to(part, x, z), abs=1e-12)
            assert math.hypot(nx, nz) == pytest.approx(1.0)
            # A step along the vector leads away by as much.
            if gap > 0.0:
                assert gap_to(part, x + 0.01 * nx, z + 0.01 * nz) == pytest.approx(gap + 0.01, abs=1e-9)


@pytest.mark.parametrize("frame", [0.0, 29.0, 30.0, 1000.0])
def test_the_nearest_obstacle_is_that_of_all(frame):
    found = gaps_of(PLACES, points(400, 1), frame)
    assert found == pytest.approx([naive_gap_at(PARTS, frame, x, z, REACH) for x, z in points(400, 1)])


def test_distances_of_ways_match_naive():
    starts, ends = points(60, 2), points(60, 3)
    for start, end in zip(starts, ends, strict=True):
        for part in PARTS:
            expected = naive_way_gap(part, start, end)
            assert way_gap(part, *start, *end, 99.0) == pytest.approx(expected, abs=2e-2)
            assert way_gap(part, *start, *end, 99.0) <= expected + 1e-9
            enough = way_gap(part, *start, *end, 0.3)
            assert min(enough, 0.3) == pytest.approx(min(expected, 0.3), abs=2e-2)
            assert enough <= expected + 1e-9


@pytest.mark.parametrize("height", [ANY_HEIGHT, 1.0, 2.0])
@pytest.mark.parametrize("frame", [0.0, 100.0])
def test_free_ways_are_those_of_naive(frame, height):
    starts, ends = points(150, 4), points(150, 5)
    found = [is_way_free(PLACES, frame, *a, *b, 0.0, height) for a, b in zip(starts, ends, strict=True)]
    expected = [naive_is_way_free(PARTS, frame, a, b, height) for a, b in zip(starts, ends, strict=True)]
    assert found == expected
    assert 10 < sum(found) < 140


def test_a_way_keeps_room_but_where_it_begins_or_ends_nearer():
    wall = build_places(pack_parts([(0, WallObstacle(kind="wall", points=((-4.0, 0.0), (4.0, 0.0))))], 15.0))
    for z, room, is_free in ((0.4, 0.25, True), (0.4, 0.5, True), (-0.4, 0.5, True)):
        assert is_way_free(wall, 0.0, -3.0, z, 3.0, z, room, ANY_HEIGHT) == is_free
    assert is_way_free(wall, 0.0, -3.0, 0.4, 3.0, 2.0, 0.5, ANY_HEIGHT)
    assert not is_way_free(wall, 0.0, -6.0, 1.0, 5.0, -0.4, 0.5, ANY_HEIGHT)
    assert not is_way_free(wall, 0.0, -4.6, 1.0, -4.4, -1.0, 0.6, ANY_HEIGHT)
    assert is_way_free(wall, 0.0, -4.6, 1.0, -4.4, -1.0, 0.2, ANY_HEIGHT)


def test_a_door_is_a_gap_as_wide_as_it_says_once_it_opens():
    (door,) = PARTS[PARTS["kind"] == DOOR]
    assert (door["x"], door["z"]) == pytest.approx((-2.0, -1.0))
    assert 2 * door["half_along"] == pytest.approx(1.2)
    beside = PARTS[(PARTS["kind"] == WALL)]
    assert min(gap_to(part, -2.0, -1.0) for part in beside) == pytest.approx(0.6)
    assert not is_way_free(PLACES, 29.0, -2.0, -2.0, -2.0, 0.0, 0.3, ANY_HEIGHT)
    assert is_way_free(PLACES, 30.0, -2.0, -2.0, -2.0, 0.0, 0.3, ANY_HEIGHT)


def test_at_first_doors_are_as_they_begin_for_good():
    open_first = WallObstacle(
        kind="wall", points=((0.0, 0.0), (9.0, 0.0)), doors=(Door(at=2.0), Door(at=6.0, opens=3.0))
    )
    first = as_at_first(pack_parts([(0, open_first)], 15.0))
    doors = first[first["kind"] == DOOR]
    assert doors["opens"].tolist() == [-math.inf, math.inf]


def test_ways_are_clear_where_they_neither_end_near_obstacles_nor_lead_through():
    starts, ends = points(100, 6), points(100, 7)
    expected = [all(naive_way_gap(part, a, b) >= CLEAR for part in PARTS) for a, b in zip(starts, ends, strict=True)]
    assert are_ways_clear(PARTS, starts, ends).tolist() == expected
    assert are_ways_clear(np.zeros(0, PART), starts, ends).all()


def test_without_obstacles_every_way_is_free():
    none = build_places(np.zeros(0, PART))
    assert is_way_free(none, 0.0, 0.0, 0.0, 50.0, 50.0, 0.3, ANY_HEIGHT)
    assert gaps_of(none, points(5), 0.0).tolist() == [REACH] * 5


def test_each_cell_of_a_wide_place_knows_its_nearest_part():
    far = pack_parts([*enumerate(SHAPES), (4, DiscObstacle(kind="disc", centre=(30.0, 12.0), radius=1.0))], 15.0)
    places = build_places(far, with_ways=False)
    grid = places.grid
    rows, columns = np.divmod(np.arange(len(places.clear)), int(grid.columns))
    middles = np.column_stack([columns + 0.5, rows + 0.5]) * grid.size + [grid.x, grid.z]
    chosen = np.arange(0, len(middles), 97)
    least = [min(gap_to(part, x, z) for part in far) - grid.size / math.sqrt(2.0) for x, z in middles[chosen]]
    assert grid.columns > 4 * CELLS
    assert places.clear[chosen] == pytest.approx(least, abs=1e-12)
    near = np.diff(places.offsets)[chosen]
    assert near.tolist() == [
        sum(gap_to(part, x, z) <= REACH + grid.size / math.sqrt(2.0) for part in far) for x, z in middles[chosen]
    ]


def test_a_solid_arena_needs_no_corners_for_ways():
    ropes = RopesObstacle(kind="ropes", points=((-6.0, -6.0), (-6.0, 6.0), (6.0, 6.0), (6.0, -6.0)))
    assert not len(build_places(pack_parts([(BORDER, ropes)], 15.0)).corners)
    assert len(build_places(pack_parts([(0, ropes)], 15.0)).corners)

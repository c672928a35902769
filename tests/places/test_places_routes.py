"""Ways around obstacles are the shortest ones, over their corners, and through doors that are open."""

import math

import pytest

from crowdsim.places.arrays import build_places, pack_parts
from crowdsim.places.description import Door, WallObstacle
from crowdsim.places.kernels.distance import ANY_HEIGHT, is_way_free
from crowdsim.places.kernels.routes import first_corner


def places(*shapes):
    return build_places(pack_parts(list(enumerate(shapes)), 15.0))


def walk(one, frame, start, end):
    """Follow the ways from corner to corner; return how long that is."""
    at, far = start, 0.0
    for _ in range(20):
        if is_way_free(one, frame, *at, *end, 0.2, ANY_HEIGHT):
            return far + math.dist(at, end)
        corner, _ = first_corner(one, frame, *at, *end)
        assert corner >= 0
        there = tuple(one.corners[corner])
        far, at = far + math.dist(at, there), there
    raise AssertionError("the way has no end")


@pytest.mark.parametrize("x", [-1.5, 0.0, 2.0])
def test_a_way_leads_around_the_nearer_end_of_a_wall(x):
    one = places(WallObstacle(kind="wall", points=((-3.0, 0.0), (4.0, 0.0)), thickness=0.1))
    start, end = (x, -2.0), (x, 2.0)
    corner, length = first_corner(one, 0.0, *start, *end)
    shortest = 2 * min(math.hypot(3.0 + x, 2.0), math.hypot(4.0 - x, 2.0))
    assert shortest < length < shortest + 2.0
    assert length == pytest.approx(walk(one, 0.0, start, end), rel=0.1)
    assert (one.corners[corner, 0] < 0.0) == (x < 0.5)
    assert is_way_free(one, 0.0, *start, *one.corners[corner], 0.2, ANY_HEIGHT)


def test_a_way_leads_through_a_door_once_it_is_open():
    door = Door(at=6.0, width=1.0, opens=2.0, closes=4.0)
    one = places(WallObstacle(kind="wall", points=((-3.0, 0.0), (4.0, 0.0)), doors=(door,)))
    start, end = (3.0, -2.0), (3.0, 2.0)
    lengths = [first_corner(one, frame, *start, *end)[1] for frame in (29.0, 30.0, 59.0, 60.0)]
    assert lengths[0] == lengths[3] > 4.8
    assert lengths[1] == lengths[2] == pytest.approx(4.0, abs=0.1)


def test_no_way_leads_into_a_closed_room_and_one_leads_out_of_a_maze():
    square = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0))
    closed = places(WallObstacle(kind="wall", points=square, closed=True))
    assert first_corner(closed, 0.0, 0.0, 0.0, 5.0, 0.0) == (-1, math.inf)
    inner = WallObstacle(kind="wall", points=square, closed=True, doors=(Door(at=2.0),))
    outer = tuple((2.0 * x, 2.0 * z) for x, z in square)
    maze = places(inner, WallObstacle(kind="wall", points=outer, closed=True, doors=(Door(at=20.0),)))
    assert 8.0 < walk(maze, 0.0, (0.0, 0.0), (0.0, 6.0)) < 16.0


def test_ways_keep_off_both_sides_of_a_thin_wall():
    one = places(WallObstacle(kind="wall", points=((0.0, -5.0), (0.0, 5.0)), thickness=0.05))
    for z in (-3.0, 0.1, 0.24, 2.5):
        assert walk(one, 0.0, (-0.31, z), (0.31, z)) > 2 * (5.0 - abs(z))

"""Grids: interpolation, wrapping, clamping, fading, and what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naive_policy import corners, measure

from crowdsim.errors import RecipeError
from crowdsim.policy.axes.axis import Target
from crowdsim.policy.axes.registry import AXES, NAMES
from crowdsim.policy.environment import Axis, build_grid, fade_factor

PUNCH = build_grid(
    [
        Axis("height", 1.2, 1.6, 4),
        Axis("bearing", -math.pi, math.pi, 12, wraps=True),
        Axis("distance", 0.0, 2.0, 9, fade=0.5),
    ]
)


FINE_NEAR = build_grid(
    [
        Axis("distance", 0.2, 4.0, 9, fade=0.5, stretch=0.8),
        Axis("bearing", -math.pi, math.pi, 6, wraps=True),
        Axis("height", 0.0, 2.0, 4, stretch=3.0),
    ]
)


def compiled_corners(grid, target):
    from crowdsim.policy.kernels.axes import Corners, fade_on_axes, find_corners

    corners = Corners(np.empty(64, np.int64), np.empty(64))
    place = grid.pack(), 0, len(grid.axes), Target(*map(float, np.pad(target, (0, 6 - len(target)))))
    count = find_corners(*place, corners)
    return corners.cells[:count], corners.weights[:count], fade_on_axes(*place)


def at(distance, bearing, height=1.4):
    return np.array([distance * math.sin(bearing), height, distance * math.cos(bearing)])


def test_axes_are_ordered_with_those_that_do_not_move_last():
    assert [axis.name for axis in PUNCH.axes] == ["distance", "bearing", "height"]
    assert PUNCH.shape == (9, 12, 4)
    assert PUNCH.layers == 4
    assert PUNCH.cells == 432


def test_interpolation_is_exact_at_grid_points():
    values = np.random.default_rng(0).random(PUNCH.cells)
    for cell, target in enumerate(PUNCH.targets()):
        if math.hypot(target[0], target[2]) < 1e-9:
            continue  # at the avatar itself every bearing is the same place
        for found, weights in (corners(PUNCH, target), compiled_corners(PUNCH, target)[:2]):
            assert weights @ values[found] == pytest.approx(values[cell], abs=1e-9)


def test_interpolation_is_exact_for_a_function_that_is_linear_in_every_axis():
    targets = PUNCH.targets()
    values = measure("distance", targets) * (2.0 + measure("height", targets))
    target = at(0.77, 0.3, 1.333)
    cells, weights = corners(PUNCH, target)
    assert weights @ values[cells] == pytest.approx(0.77 * 3.333)


def test_a_bearing_just_short_of_the_seam_mixes_the_last_grid_point_with_the_first():
    step = 2 * math.pi / 12
    cells, weights = corners(build_grid([Axis("distance", 0, 2, 2), PUNCH.axes[1]]), at(0.0 + 1e-9, math.pi - step / 4))
    shares = np.zeros(12)
    np.add.at(shares, cells % 12, weights)
    assert shares[11] == pytest.approx(0.25, abs=1e-6)
    assert shares[0] == pytest.approx(0.75, abs=1e-6)


@pytest.mark.parametrize("grid", [PUNCH, FINE_NEAR], ids=["even", "stretched"])
@given(x=st.floats(-5, 5), y=st.floats(0, 3), z=st.floats(-5, 5))
def test_compiled_corners_are_those_of_the_plain_version_everywhere(grid, x, y, z):
    target = np.array([x, y, z])
    cells, weights = corners(grid, target)
    found, shares, fade = compiled_corners(grid, target)
    plain, fast = np.zeros(grid.cells), np.zeros(grid.cells)
    np.add.at(plain, cells, weights)
    np.add.at(fast, found, shares)
    np.testing.assert_allclose(fast, plain, atol=1e-9)
    assert fast.sum() == pytest.approx(1.0)
    assert fade == pytest.approx(fade_factor(grid, target))


@pytest.mark.parametrize(("minimum", "maximum"), [(0.0, 4.0), (0.3, 2.0), (1.0, 30.0)])
@pytest.mark.parametrize("stretch", [0.1, 1.0, 50.0])
def test_points_of_a_stretched_axis_ascend_from_its_minimum_to_its_maximum(minimum, maximum, stretch):
    points = Axis("distance", minimum, maximum, 12, stretch=stretch).points
    assert points[0] == pytest.approx(minimum, abs=1e-12)
    assert points[-1] == pytest.approx(maximum, rel=1e-12)
    assert (np.diff(points) > 0.0).all()
    assert (np.diff(points, 2) > 0.0).all(), "ever further apart"
    even = np.linspace(minimum, maximum, 12)
    np.testing.assert_allclose(Axis("distance", minimum, maximum, 12).points, even, rtol=1e-12)


def test_steps_are_four_times_as_long_where_the_stretch_is_as_at_zero():
    axis = Axis("distance", 0.0, 4.0, 4001, stretch=1.5)
    steps, middles = np.diff(axis.points), (axis.points[1:] + axis.points[:-1]) / 2
    assert np.interp(1.5, middles, steps) / steps[0] == pytest.approx(4.0, rel=2e-3)
    assert Axis("distance", 0.0, 4.0, 11, stretch=1e9).points == pytest.approx(np.linspace(0.0, 4.0, 11), abs=1e-6)


def test_a_grid_point_of_a_stretched_grid_has_all_the_weight():
    for cell, target in enumerate(FINE_NEAR.targets()):
        for found, weights in (corners(FINE_NEAR, target), compiled_corners(FINE_NEAR, target)[:2]):
            shares = np.zeros(FINE_NEAR.cells)
            np.add.at(shares, found, weights)
            assert shares[cell] == pytest.approx(1.0, abs=1e-9)


def test_places_of_a_stretched_axis_count_grid_points():
    axis = FINE_NEAR.axes[0]
    np.testing.assert_allclose(axis.places(axis.points), np.arange(axis.count), atol=1e-12)
    assert (np.diff(axis.places(np.linspace(0.2, 4.0, 50))) > 0.0).all()


def test_a_behaviour_fades_out_beyond_its_grid_and_not_inside_it():
    assert fade_factor(PUNCH, at(1.99, 1.0)) == 1.0
    assert fade_factor(PUNCH, at(2.25, 1.0)) == pytest.approx(0.5)
    assert fade_factor(PUNCH, at(2.6, 1.0)) == 0.0
    assert fade_factor(PUNCH, at(1.0, 1.0, height=9.0)) == 1.0  # an axis without a fade is only clamped


def test_an_axis_of_one_point_is_the_same_everywhere():
    grid = build_grid([Axis("distance", 1.0, 1.0, 1), Axis("height", 1.0, 2.0, 2)])
    cells, weights, _ = compiled_corners(grid, at(7.0, 0.0, 1.5))
    found = np.zeros(2)
    np.add.at(found, cells, weights)
    assert found == pytest.approx([0.5, 0.5])


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (
            [Axis("distanz", 0, 1, 2)],
            "unknown axis 'distanz', expected one of distance, bearing, height, heading, velocity, impact "
            "(did you mean 'distance'?)",
        ),
        ([Axis("distance", 0, 1, 0)], "axis 'distance' has 0 grid points, expected 1 or more"),
        ([Axis("distance", 1, 1, 2)], "axis 'distance' reaches from 1 to 1, expected a range upwards"),
        ([Axis("bearing", 0, 3, 4, wraps=True)], "axis 'bearing' wraps, so its range must be 6.28319 rad"),
        ([Axis("distance", 0, 1, 2)] * 2, "axis 'distance' is named twice"),
        (
            [Axis("distance", -1, 1, 2, stretch=1.0)],
            "axis 'distance' is stretched, so it must begin at 0 or above and cannot wrap",
        ),
        (
            [Axis("distance", 0, 1, 2), Axis("bearing", -math.pi, math.pi, 4, wraps=True, stretch=1.0)],
            "axis 'bearing' is stretched, so it must begin at 0 or above and cannot wrap",
        ),
        ([], "a grid needs one axis or more"),
        ([Axis("height", 1, 2, 2)], "a grid of height alone does not see where the target is, expected a distance too"),
    ],
)
def test_impossible_grids_are_refused(axes, message):
    with pytest.raises(RecipeError) as error:
        build_grid(axes)
    assert str(error.value) == message


def test_axes_over_the_ground_come_first_in_a_grid():
    assert [kind.over_ground for kind in AXES] == sorted((kind.over_ground for kind in AXES), reverse=True)
    assert len(set(NAMES)) == len(NAMES)


@pytest.mark.parametrize("kind", AXES, ids=NAMES)
def test_an_axis_measures_what_it_places(kind):
    values = np.linspace(0.1, 3.0, 7)
    placed = kind.place(Target(*(np.full(7, number) for number in (0.3, 1.5, 0.8, 0.1, 0.0, 0.7, 5.0, 2.0))), values)
    assert [kind.value(Target(*one)) for one in zip(*placed, strict=True)] == pytest.approx(values)

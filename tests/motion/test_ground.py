"""Ground transforms against three-dimensional turns, and what they must obey."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.motion import ground, quaternion

numbers = st.floats(-100.0, 100.0)
grounds = st.tuples(numbers, numbers, numbers).map(np.array)
points = st.tuples(numbers, numbers, numbers).map(np.array)


def place(transform, point):
    """The same by a turn about y and a shift."""
    return quaternion.rotate(quaternion.about_y(transform[2]), point) + np.array([transform[0], 0.0, transform[1]])


@settings(max_examples=100, deadline=None)
@given(grounds, points)
def test_a_ground_transform_rotates_about_y_and_translates(transform, point):
    np.testing.assert_allclose(ground.to_world(transform, point), place(transform, point), atol=1e-9)
    np.testing.assert_allclose(ground.to_local(transform, ground.to_world(transform, point)), point, atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(grounds, grounds, grounds, points)
def test_composing_is_placing_twice(a, b, c, point):
    np.testing.assert_allclose(ground.to_world(ground.compose(a, b), point), place(a, place(b, point)), atol=1e-9)
    left = ground.compose(ground.compose(a, b), c)
    np.testing.assert_allclose(left, ground.compose(a, ground.compose(b, c)), atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(grounds)
def test_an_inverse_undoes_from_both_sides(transform):
    np.testing.assert_allclose(ground.compose(transform, ground.inverse(transform)), [0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(ground.compose(ground.inverse(transform), transform), [0, 0, 0], atol=1e-9)


def test_ahead_is_z_and_left_is_x_in_a_ground_frame():
    facing_x = np.array([1.0, 2.0, np.pi / 2])
    np.testing.assert_allclose(ground.to_world(facing_x, [0, 5, 1]), [2, 5, 2], atol=1e-12)
    np.testing.assert_allclose(ground.to_world(facing_x, [1, 5, 0]), [1, 5, 1], atol=1e-12)
    np.testing.assert_allclose(ground.to_local(facing_x, [2, 5, 2]), [0, 5, 1], atol=1e-12)


@pytest.mark.parametrize("function", [ground.to_world, ground.to_local])
def test_leading_axes_broadcast(function):
    rng = np.random.default_rng(0)
    transforms, many = rng.normal(size=(4, 1, 3)), rng.normal(size=(5, 3))
    together = function(transforms, many)
    assert together.shape == (4, 5, 3)
    for row, column in np.ndindex(4, 5):
        np.testing.assert_allclose(together[row, column], function(transforms[row, 0], many[column]))


@settings(max_examples=100, deadline=None)
@given(numbers)
def test_wrapped_angles_are_between_minus_pi_and_pi_and_equivalent(angle):
    wrapped = ground.wrap(angle)
    assert -np.pi <= wrapped <= np.pi
    np.testing.assert_allclose([np.sin(wrapped), np.cos(wrapped)], [np.sin(angle), np.cos(angle)], atol=1e-12)

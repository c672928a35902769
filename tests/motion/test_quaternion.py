"""Quaternions against scipy's Rotation, and what they must obey."""

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from crowdsim.motion import quaternion as q

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]
RNG = np.random.default_rng(0)
A, B = q.normalise(RNG.normal(size=(2, 500, 4)))
V = RNG.normal(size=(500, 3))

numbers = st.floats(-10.0, 10.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
units = (
    st.tuples(numbers, numbers, numbers, numbers)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 1e-3)
    .map(q.normalise)
)
unit_vectors = vectors.filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))


def scipy_of(quaternions):
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1))


def same_turn(a, b, atol=1e-12):
    np.testing.assert_allclose(np.abs(np.sum(np.asarray(a) * b, axis=-1)), 1.0, atol=atol)


def test_products_conjugates_and_rotated_vectors_match_scipy():
    same_turn(q.multiply(A, B), np.roll((scipy_of(A) * scipy_of(B)).as_quat(), 1, axis=-1))
    same_turn(q.conjugate(A), np.roll(scipy_of(A).inv().as_quat(), 1, axis=-1))
    np.testing.assert_allclose(q.rotate(A, V), scipy_of(A).apply(V), atol=1e-12)


def test_rotation_vectors_are_those_of_scipy():
    vectors = scipy_of(A).as_rotvec()
    np.testing.assert_allclose(q.to_rotation_vector(A), vectors, atol=1e-12)
    same_turn(q.from_rotation_vector(vectors), A)
    axis = V / np.linalg.norm(V, axis=1, keepdims=True)
    angle = np.linspace(-7, 7, 500)
    expected = Rotation.from_rotvec(axis * angle[:, None])
    same_turn(q.from_rotation_vector(axis * angle[..., None]), np.roll(expected.as_quat(), 1, axis=-1))


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_are_those_of_scipy(order):
    angles = RNG.uniform(-np.pi, np.pi, (500, 3))
    expected = Rotation.from_euler(order, angles)
    same_turn(q.from_euler(angles, order), np.roll(expected.as_quat(), 1, axis=-1))
    one = q.from_euler(angles[:, :1], order[0])
    same_turn(one, np.roll(Rotation.from_euler(order[0], angles[:, :1]).as_quat(), 1, axis=-1))
    np.testing.assert_array_equal(q.from_euler(np.zeros((3, 0)), ""), [[1, 0, 0, 0]] * 3)


def test_slerp_is_that_of_scipy_on_the_shorter_arc():
    for a, b in zip(A[:50], B[:50], strict=True):
        times = np.linspace(0, 1, 7)
        expected = Slerp([0, 1], scipy_of(np.stack([a, b])))(times)
        same_turn(q.slerp(a, b, times), np.roll(expected.as_quat(), 1, axis=-1))


@settings(max_examples=100, deadline=None)
@given(units, units, units)
def test_multiplication_is_associative_and_keeps_length(a, b, c):
    np.testing.assert_allclose(q.multiply(q.multiply(a, b), c), q.multiply(a, q.multiply(b, c)), atol=1e-12)
    assert np.linalg.norm(q.multiply(a, b)) == pytest.approx(1.0)
    np.testing.assert_allclose(q.multiply(a, q.conjugate(a)), [1, 0, 0, 0], atol=1e-12)


@settings(max_examples=100, deadline=None)
@given(units, units, vectors)
def test_rotation_by_a_product_is_two_rotations(a, b, v):
    np.testing.assert_allclose(q.rotate(q.multiply(a, b), v), q.rotate(a, q.rotate(b, v)), atol=1e-10)
    assert np.linalg.norm(q.rotate(a, v)) == pytest.approx(np.linalg.norm(v), abs=1e-12)
    np.testing.assert_allclose(q.rotate(-a, v), q.rotate(a, v), atol=1e-12)


@settings(max_examples=100, deadline=None)
@given(unit_vectors, unit_vectors)
@example(np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 1.2e-7]))
def test_the_rotation_between_directions_is_the_smallest(a, b):
    turn = q.between(a, b)
    np.testing.assert_allclose(q.rotate(turn, a), b, atol=1e-7)
    angle = np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))
    assert np.linalg.norm(q.to_rotation_vector(turn)) == pytest.approx(angle, abs=1e-6)


def test_the_rotation_between_opposite_directions_is_180_degrees():
    for axis in (*np.eye(3), *-np.eye(3), *V[:20] / np.linalg.norm(V[:20], axis=1, keepdims=True)):
        np.testing.assert_allclose(q.rotate(q.between(axis, -axis), axis), -axis, atol=1e-9)
        np.testing.assert_allclose(q.between(axis, 3.0 * axis), [1, 0, 0, 0], atol=1e-12)


@settings(max_examples=100, deadline=None)
@given(units, units, st.floats(0.0, 1.0))
def test_slerp_divides_the_angle_in_proportion(a, b, t):
    part = q.slerp(a, b, t)
    whole = np.linalg.norm(q.to_rotation_vector(q.multiply(q.conjugate(a), b)))
    first = np.linalg.norm(q.to_rotation_vector(q.multiply(q.conjugate(a), part)))
    assert first == pytest.approx(t * whole, abs=1e-5)
    assert np.linalg.norm(part) == pytest.approx(1.0)


def test_slerp_meets_its_ends_and_stays_where_both_are_the_same():
    same_turn(q.slerp(A, B, 0.0), A)
    same_turn(q.slerp(A, B, 1.0), B)
    np.testing.assert_allclose(q.slerp(A, A, 0.3), A, atol=1e-12)
    same_turn(q.slerp(A, -A, 0.3), A)
    assert q.slerp(A[:, None], B[:, None], np.linspace(0, 1, 5)).shape == (500, 5, 4)


def test_small_rotation_vectors_keep_their_size():
    for size in (0.0, 1e-300, 1e-14, 1e-9, 1e-5, 3.0, np.pi):
        vector = np.array([0.6, 0.0, -0.8]) * size
        back = q.to_rotation_vector(q.from_rotation_vector(vector))
        np.testing.assert_allclose(np.abs(back), np.abs(vector), rtol=1e-9)


@settings(max_examples=100, deadline=None)
@given(units)
def test_rotation_vectors_are_at_most_180_degrees(a):
    for turn in (a, -a):
        vector = q.to_rotation_vector(turn)
        assert np.linalg.norm(vector) <= np.pi + 1e-12
        same_turn(q.from_rotation_vector(vector), a)


def test_continuous_sequences_never_change_sides():
    signs = np.where(RNG.random((40, 6)) < 0.5, -1.0, 1.0)
    steps = q.from_rotation_vector(0.3 * RNG.normal(size=(40, 6, 3)))
    smooth = np.empty((40, 6, 4))
    smooth[0] = A[:6]
    for frame in range(1, 40):
        smooth[frame] = q.multiply(smooth[frame - 1], steps[frame])
    flipped = smooth * signs[..., None]
    mended = q.continuous(flipped)
    np.testing.assert_allclose(mended, smooth * signs[:1, :, None], atol=1e-12)
    np.testing.assert_array_equal(q.continuous(np.swapaxes(flipped, 0, 1), axis=1), np.swapaxes(mended, 0, 1))
    assert (np.sum(mended[1:] * mended[:-1], axis=-1) >= 0).all()


def test_headings_rotate_z_to_x():
    heading = np.linspace(-4, 4, 50)
    facing = q.rotate(q.about_y(heading), [0, 0, 1])
    expected = np.stack([np.sin(heading), np.zeros(50), np.cos(heading)], axis=-1)
    np.testing.assert_allclose(facing, expected, atol=1e-12)


def test_normalised_quaternions_have_unit_length():
    np.testing.assert_allclose(np.linalg.norm(q.normalise(7.0 * A), axis=-1), 1.0)
    np.testing.assert_allclose(q.normalise(7.0 * A), A)


def test_inputs_may_be_lists_and_are_not_changed():
    one = [0.5, 0.5, 0.5, 0.5]
    np.testing.assert_allclose(q.multiply(one, one), [-0.5, 0.5, 0.5, 0.5])
    np.testing.assert_allclose(q.rotate(one, [1, 0, 0]), [0, 1, 0])
    sequence = np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0]])
    before = sequence.copy()
    q.continuous(sequence)
    np.testing.assert_array_equal(sequence, before)

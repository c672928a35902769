"""Arithmetic of quaternions: beside scipy's rotations."""

import math

import naive_core as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.core import quaternions


def draw(seed: int, count: int) -> list[np.ndarray]:
    """Unit quaternions."""
    values = np.random.default_rng(seed).normal(size=(count, 4))
    return list(values / np.linalg.norm(values, axis=1, keepdims=True))


def same_rotation(found: object, expected: np.ndarray, atol: float = 1e-12) -> bool:
    """Whether two quaternions are one rotation; both signs are."""
    found = np.asarray(found, float)
    return bool(min(np.abs(found - expected).max(), np.abs(found + expected).max()) < atol)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_products_match_naive(seed: int) -> None:
    a, b = draw(seed, 2)
    assert same_rotation(quaternions.multiply(a, b), naive.multiply(a, b))
    assert same_rotation(quaternions.relative(tuple(a), tuple(b)), naive.relative(a, b))
    assert same_rotation(quaternions.multiply(quaternions.conjugate(a), a), np.array([1.0, 0.0, 0.0, 0.0]))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_rotated_vectors_match_naive(seed: int) -> None:
    (q,) = draw(seed, 1)
    vector = np.random.default_rng(seed).normal(size=3) * 10.0
    np.testing.assert_allclose(quaternions.rotate(q, *vector), naive.rotate(q, vector), atol=1e-12)
    np.testing.assert_allclose(quaternions.unrotate(q, *vector), naive.unrotate(q, vector), atol=1e-12)
    back = quaternions.unrotate(q, *quaternions.rotate(q, *vector))
    np.testing.assert_allclose(back, vector, atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(-10.0, 10.0))
def test_rotation_about_y_matches_naive(seed: int, angle: float) -> None:
    (q,) = draw(seed, 1)
    found = quaternions.rotate_about_y(math.cos(0.5 * angle), math.sin(0.5 * angle), q)
    assert same_rotation(found, naive.rotate_about_y(angle, q))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 6.0))
def test_rotation_by_a_vector_matches_naive(seed: int, angle: float) -> None:
    (q,) = draw(seed, 1)
    axis = np.random.default_rng(seed).normal(size=3)
    vector = angle * axis / np.linalg.norm(axis)
    found = q.copy()
    quaternions.rotate_by_vector(found, *vector)
    assert same_rotation(found, naive.rotate_by_vector(q, vector))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 6.0))
def test_the_quaternion_of_a_vector_matches_naive(seed: int, angle: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    vector = angle * axis / np.linalg.norm(axis)
    expected = naive.rotate_by_vector(np.array([1.0, 0.0, 0.0, 0.0]), vector)
    assert same_rotation(quaternions.from_vector(*vector), expected)


def test_rotation_by_no_vector_changes_nothing() -> None:
    (q,) = draw(3, 1)
    found = q.copy()
    quaternions.rotate_by_vector(found, 0.0, 0.0, 0.0)
    np.testing.assert_array_equal(found, q)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_mixed_quaternions_match_naive(seed: int, share: float) -> None:
    a, b = draw(seed, 2)
    assert same_rotation(quaternions.mix(a, b, share), naive.mix(a, b, share))
    assert same_rotation(quaternions.mix(a, -b, share), naive.mix(a, b, share))


def test_quaternions_of_like_sign_mix_as_others_and_go_on_beyond_half_a_rotation() -> None:
    """The way that the sign says is one that changes no more suddenly than what it leads to."""
    start = (1.0, 0.0, 0.0, 0.0)
    angles = np.radians(np.linspace(100.0, 260.0, 161))
    ends = np.stack([np.cos(0.5 * angles), np.zeros(161), np.sin(0.5 * angles), np.zeros(161)], axis=1)
    found = np.array([quaternions.mix_like(start, end, 0.4) for end in ends])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    for end, between in zip(ends[:80], found[:80], strict=True):
        assert same_rotation(between, naive.mix(start, end, 0.4))
    steps = 2.0 * np.arccos(np.minimum(np.abs(np.sum(found[1:] * found[:-1], axis=1)), 1.0))
    assert np.degrees(steps.max()) < 2.0
    shorter = np.array([quaternions.mix(start, end, 0.4) for end in ends])
    assert np.degrees(2.0 * np.arccos(np.abs(np.sum(shorter[1:] * shorter[:-1], axis=1)).min())) > 90.0


def test_the_mean_of_two_rotations_about_an_axis_is_half_the_angle() -> None:
    start, end = ((math.cos(0.5 * angle), 0.0, math.sin(0.5 * angle), 0.0) for angle in (0.2, 1.0))
    expected = (math.cos(0.3), 0.0, math.sin(0.3), 0.0)
    assert quaternions.mix(start, end, 0.5) == pytest.approx(expected, abs=1e-15)
    assert quaternions.mix(start, end, 0.0) == pytest.approx(start, abs=1e-15)


def test_results_may_be_written_to_an_argument() -> None:
    a, b = draw(7, 2)
    expected = quaternions.multiply(a, b)
    b[0], b[1], b[2], b[3] = quaternions.multiply(a, b)
    np.testing.assert_array_equal(b, expected)

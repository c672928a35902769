"""Positions on axes, weights of corners and interpolation match the naive twins."""

import naive_core
import numpy as np
import pytest

from crowdsim.core.tables import interpolate, locate_on_axis, split_weights


@pytest.mark.parametrize("wraps", [False, True])
def test_position_on_an_axis_matches_naive(wraps):
    rng = np.random.default_rng(3)
    for points in (2, 3, 7) if wraps else (1, 2, 7):
        positions = [*rng.uniform(-2.0 * points, 3.0 * points, 300), *np.arange(-points, 2 * points + 1), -1e-17]
        for position in map(float, positions):
            lower, upper, share = locate_on_axis(position, points, wraps)
            found, expected = np.zeros(points), np.zeros(points)
            np.add.at(found, [lower, upper], [1.0 - share, share])
            lower, upper, share = naive_core.locate(position, points, wraps)
            np.add.at(expected, [lower, upper], [1.0 - share, share])
            np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_position_on_an_axis_is_between_neighbours():
    assert locate_on_axis(2.25, 4, False) == (2, 3, 0.25)
    assert locate_on_axis(3.0, 4, False) == (2, 3, 1.0)
    assert locate_on_axis(3.25, 4, True) == (3, 0, 0.25)
    assert locate_on_axis(-0.75, 4, True) == (3, 0, 0.25)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_weights_of_corners_match_naive_and_sum_to_one(dtype):
    shares = np.random.default_rng(4).random(3).astype(dtype)
    weights, count = np.ones(8, dtype), 1
    for share in shares:
        split_weights(weights, count, share, dtype(1.0) - share)
        count *= 2
    np.testing.assert_allclose(weights, naive_core.corner_weights(shares.tolist()), rtol=1e-6)
    assert weights.sum() == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.uint16])
def test_interpolation_is_the_weighted_sum_of_entries(dtype):
    rng = np.random.default_rng(5)
    table, cells, weights = rng.uniform(0, 9, 40).astype(dtype), rng.integers(0, 30, 8), rng.random(8)
    expected = sum(float(w) * float(table[5 + c]) for w, c in zip(weights[:4], cells[:4], strict=True))
    assert interpolate(table, 5, cells, weights, 4) == pytest.approx(expected)

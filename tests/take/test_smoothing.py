"""Filters along the first axis: each as scipy has it, to the last bit."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, correlate1d, maximum_filter1d

from crowdsim.poses.smoothing import highest, smooth, widen


@pytest.mark.parametrize("rows", [1, 2, 5, 40])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_smooth_matches_scipy(rows: int, dtype: type) -> None:
    rng = np.random.default_rng(rows)
    values = rng.normal(size=(rows, 6, 2)).astype(dtype)
    for weights in (np.hanning(15)[1:-1] / 7.0, 1.4 * np.array([1.0, 8.0, 28.0, 56.0, 28.0, 8.0, 1.0]) / 130.0):
        found = smooth(values, weights)
        assert found.dtype == dtype
        np.testing.assert_array_equal(found, correlate1d(values, weights, axis=0, mode="nearest"))


@pytest.mark.parametrize("rows", [1, 2, 5, 40])
@pytest.mark.parametrize("away", [1, 3])
def test_highest_matches_scipy(rows: int, away: int) -> None:
    values = np.random.default_rng(rows).normal(size=(rows, 7)).astype(np.float32)
    np.testing.assert_array_equal(highest(values, away), maximum_filter1d(values, 2 * away + 1, axis=0, mode="nearest"))


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (4, 3), (60, 50)])
@pytest.mark.parametrize("away", [1, 3, 7])
def test_widen_matches_scipy(shape: tuple[int, int], away: int) -> None:
    cells = np.random.default_rng(away).random(shape) < 0.02
    cells[0, 0] = True
    before = cells.copy()
    np.testing.assert_array_equal(widen(cells, away), binary_dilation(cells, np.ones((2 * away + 1,) * 2, bool)))
    np.testing.assert_array_equal(cells, before)

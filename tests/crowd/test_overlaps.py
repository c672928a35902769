"""Which bodies overlap is what comparing all pairs says, for few and for many."""

import numpy as np
import pytest

from crowdsim.crowd.statistics import overlapping


def naive(x, z, scale, radius):
    """Compare each body with every other."""
    return np.array([
        any(i != j and np.hypot(x[i] - x[j], z[i] - z[j]) < radius * (scale[i] + scale[j]) for j in range(len(x)))
        for i in range(len(x))
    ])  # fmt: skip


@pytest.mark.parametrize("count", [0, 1, 2, 40, 128, 129, 400])
def test_overlaps_are_those_of_all_pairs(count):
    rng = np.random.default_rng(count)
    side = 0.4 * np.sqrt(max(count, 1))
    x, z = rng.uniform(0, side, (2, count))
    scale = rng.uniform(0.9, 1.1, count)
    expected = naive(x, z, scale, 0.15)
    assert np.array_equal(overlapping(x, z, scale, 0.15), expected)
    absent = rng.random((3, count)) < 0.3
    rows = overlapping(np.where(absent, np.nan, x), np.where(absent, np.nan, z), scale, 0.15)
    for here, found in zip(~absent, rows, strict=True):
        assert np.array_equal(found[here], naive(x[here], z[here], scale[here], 0.15))
        assert not found[~here].any()
    assert count < 40 or 0 < expected.sum() < count

"""Curves that the embedded boxer is made of."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.performer.curves import smooth_below
from crowdsim.performer.session import perform


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 20), st.integers(1, 90))
def test_a_curve_below_another_is_nowhere_above_it_and_looks_no_further_than_it_may(
    seed: int, most: int, length: int
) -> None:
    x = np.random.default_rng(seed).normal(size=length)
    below = smooth_below(x, most)
    assert (below <= x + 1e-12).all()
    assert (below >= x.min() - 1e-12).all()
    at = seed % length
    part = slice(max(at - most, 0), at + most + 1)
    assert smooth_below(x[part], most)[at - part.start] == pytest.approx(below[at])


def test_a_pelvis_sinks_for_a_long_leg_without_a_jerk() -> None:
    heights = [np.asarray(one.clip.root_positions)[:, 1] for one in perform(120, 5)]
    greatest = max(float(np.abs(np.diff(height, 2)).max()) * 3600.0 for height in heights)
    assert greatest < 35.0

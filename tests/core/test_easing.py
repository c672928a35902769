"""Easing curves."""

import naive_core as naive
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.core.easing import minimum_jerk


@settings(max_examples=50, deadline=None)
@given(st.floats(-2.0, 3.0))
def test_the_step_of_minimum_jerk_matches_naive(s: float) -> None:
    assert minimum_jerk(s) == pytest.approx(naive.minimum_jerk(s), abs=1e-12)


def test_the_step_of_minimum_jerk_begins_ends_and_is_symmetric() -> None:
    assert (minimum_jerk(-1.0), minimum_jerk(0.0), minimum_jerk(1.0), minimum_jerk(2.0)) == (0.0, 0.0, 1.0, 1.0)
    assert minimum_jerk(0.5) == pytest.approx(0.5, abs=1e-15)
    assert minimum_jerk(0.2) + minimum_jerk(0.8) == pytest.approx(1.0, abs=1e-15)


def test_the_step_of_minimum_jerk_is_at_rest_at_its_ends() -> None:
    assert minimum_jerk(1e-4) < 1e-10
    assert 1.0 - minimum_jerk(1.0 - 1e-4) < 1e-10

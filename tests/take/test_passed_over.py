"""What is far from a pose's time is passed over, and nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdsim.poses.kernels.bending import _is_moved
from crowdsim.poses.kernels.fists import strikes_around
from crowdsim.poses.kernels.records import Offsets

SECONDS = st.lists(st.floats(0.0, 9.0), max_size=12).map(sorted)


@settings(deadline=None)  # the kernel is compiled
@given(SECONDS, SECONDS, st.sampled_from([0.0, 0.25, 0.34]))
def test_strikes_around_times_are_found(strikes: list[float], times: list[float], within: float) -> None:
    when, low = np.array([-1.0, *strikes, 99.0]), 1
    for time in times:
        low, high = strikes_around(when, low, len(when) - 1, time, within)
        near = [1 + k for k, strike in enumerate(strikes) if abs(time - strike) <= within]
        assert set(near) <= set(range(low, high))
        assert (np.abs(when[low:high] - time) <= within + 2e-6).all()


@pytest.mark.parametrize("seed", range(4))
def test_avatars_whose_limbs_stay_are_known(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = np.zeros((30, 2, 4, 2, 3), np.float32)
    values[rng.integers(0, 30, 4), 1, 2, 1, 0] = 1e-9
    offsets = Offsets(values, 50, 60.0)
    for n in range(2):
        seen = until = 0
        for clock in np.sort(rng.uniform(46.0, 84.0, 60)):
            moved, seen, until = _is_moved(offsets, clock / 60.0, n, seen, until)
            before = int(np.floor(clock / 60.0 * 60.0 - 50))
            assert moved == values[np.clip(np.arange(before - 1, before + 3), 0, 29), n].any()

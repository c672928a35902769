"""Which strikes of a take touch."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from crowdsim.crowd.kernels.layout import BLOCKED, LANDED, MISSED
from crowdsim.poses.hits import find_landed


def take_of(frames: list[int], outcomes: list[int], limbs: list[int], rate: float = 60.0) -> Any:
    """A take of strikes of one avatar at another."""
    count, outcome = len(frames), np.array(outcomes)
    events = SimpleNamespace(
        frame=np.array(frames), attacker=np.zeros(count, int), victim=np.ones(count, int), limb=np.array(limbs),
        outcome=outcome, landed=outcome == LANDED, point=np.zeros((count, 3)), speed=np.full(count, 8.0),
    )  # fmt: skip
    return SimpleNamespace(events=events, control_rate=rate)


def test_of_strikes_that_are_one_the_one_that_lands_counts() -> None:
    """A fist that is stopped and lands a frame later would have to be in two places at once."""
    take = take_of([20, 21, 60, 62, 90], [BLOCKED, LANDED, LANDED, BLOCKED, BLOCKED], [0, 0, 1, 1, 0])
    found = find_landed(take)
    np.testing.assert_allclose(found.times * 60.0, [21, 60, 90])
    assert not found.again.any()
    np.testing.assert_array_equal(found.blocked, [False, False, True])


def test_strikes_of_other_limbs_and_times_count_apart() -> None:
    take = take_of([20, 21, 40, 46], [BLOCKED, LANDED, BLOCKED, LANDED], [0, 1, 0, 0])
    np.testing.assert_allclose(find_landed(take).times * 60.0, [20, 21, 40, 46])


def test_a_buried_miss_beside_a_hit_is_left_out() -> None:
    take = take_of([20, 22, 50], [MISSED, LANDED, MISSED], [0, 0, 0])
    found = find_landed(take, np.array([True, False, True]))
    np.testing.assert_allclose(found.times * 60.0, [22, 50])
    np.testing.assert_array_equal(found.missed, [False, True])

"""What profiles are made of beside the simulation's own clock."""

import numpy as np

from crowdsim.crowd import limits_kernels
from crowdsim.crowd.profile import machine_limits


def test_limits_of_the_machine_are_times_of_memory():
    copying, fetching = machine_limits()
    assert 0.0 < copying < 1e6
    assert 0.1 < fetching < 1e6


def test_a_walk_ends_where_its_steps_lead():
    following = np.array([2, 0, 1])
    assert [limits_kernels.walk(following, 0, steps) for steps in range(4)] == [0, 2, 1, 0]

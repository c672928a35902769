"""What profiles are made of beside the simulation's own clock."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd import profiling
from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.kernels.limits import walk
from crowdsim.crowd.profile import profile_crowd, profile_table
from crowdsim.crowd.profile_files import machine_limits


def test_limits_of_the_machine_are_times_of_memory():
    copying, fetching = machine_limits()
    assert 0.0 < copying < 1e6
    assert 0.1 < fetching < 1e6


@pytest.mark.parametrize(("search", "expected"), [("auto", "direct"), ("kd_tree", "kd_tree"), ("scipy", "scipy")])
def test_a_profile_reports_which_search_ran(search, expected):
    people = build_crowd(np.arange(12.0), np.zeros(12))
    found = profile_crowd(replace(people, policies=[policy(0)]), 3, search=search)
    assert profiling.describe(found)["search"] == expected
    assert profile_table(found).splitlines()[0].endswith(f", threads: 1, search: {expected}")


def test_a_walk_ends_where_its_steps_lead():
    following = np.array([2, 0, 1])
    assert [walk(following, 0, steps) for steps in range(4)] == [0, 2, 1, 0]

"""Positions in single precision, and what kernels make of them in double precision."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd.crowd import build_avatars, build_crowd
from crowdsim.crowd.kernels.positions import course_of, end_of, position_of, way_between
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation

POLICY = policy(0)


def avatars_at(x, z, **fields):
    """Return avatars at positions that have ends of actions of their own."""
    avatars = build_avatars(build_crowd(x, z, **fields), build_model([POLICY]))
    rng = np.random.default_rng(5)
    for name in ("end_x", "end_z"):
        avatars.motion[name] += rng.uniform(-1.0, 1.0, len(x))
    return avatars


@pytest.mark.parametrize("far", [0.0, 1000.0])
def test_kernels_compute_with_positions_in_double_precision(far):
    rng = np.random.default_rng(3)
    x, z = far + rng.uniform(-2.0, 2.0, (2, 20))
    avatars = avatars_at(x, z)
    xs, zs = avatars.x.astype(float), avatars.z.astype(float)
    ends = [avatars.motion[name].astype(float) for name in ("end_x", "end_z")]
    for i in range(20):
        j = (7 * i + 1) % 20
        assert position_of(avatars, i) == (xs[i], zs[i])
        assert way_between(avatars, i, j) == (xs[j] - xs[i], zs[j] - zs[i])
        assert end_of(avatars, i) == (ends[0][i], ends[1][i])
        assert tuple(course_of(avatars, i)) == (xs[i], zs[i], ends[0][i], ends[1][i])
    kinds = (kernel.nopython_signatures[-1].return_type for kernel in (position_of, way_between, end_of, course_of))
    assert {str(part) for kind in kinds for part in kind} == {"float64"}


def test_an_avatar_without_damage_and_obstacles_takes_at_most_200_bytes():
    count = 1 << 15
    with Simulation(build_crowd(np.arange(count) * 2.0, np.zeros(count), policies=[POLICY], variety=1.0)) as one:
        # The tree and scratch space of the stages come to this with the first frame; they take less than 2 bytes more.
        assert one.nbytes / count <= 198.0


def test_a_crowd_a_kilometre_away_fights_like_one_at_the_origin():
    x, z = np.random.default_rng(1).uniform(0.0, 3.0, (2, 12)).round(2)
    found = []
    for far in (0.0, 1024.0):
        people = build_crowd(x + far, z + far, np.arange(12.0), seed=4, policies=[POLICY])
        found.append(Simulation(replace(people, frames=20)).run(20))
    here, there = found
    same = (here.action == there.action).all(axis=0)
    assert same.mean() > 0.7
    np.testing.assert_allclose(there.x[:, same] - 1024.0, here.x[:, same], atol=1e-3)
    np.testing.assert_allclose(there.z[:, same] - 1024.0, here.z[:, same], atol=1e-3)


@pytest.mark.parametrize(("left", "is_over"), [(2e-6, True), (1e-3, False)])
def test_an_action_is_over_that_is_but_for_rounding(left, is_over):
    with Simulation(replace(build_crowd([0.0, 2.0], [0.0, 0.0], policies=[POLICY]), frames=2)) as one:
        one.run(1)
        motion, begun = one.avatars.motion, one.avatars.fight["decisions"].copy()
        motion["phase"] = one.model.actions["length"][motion["action"]] - motion["speed"] - left
        one.run(1)
        assert ((one.avatars.fight["decisions"] > begun) == is_over).all()

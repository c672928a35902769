"""Guards: hands that hang cost something near an opponent, until they are up again, and nothing elsewhere."""

from dataclasses import replace

import naive_crowd
import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.kernels.terms.guard import NEAR
from crowdsim.crowd.model_guard import LATER, drops_guard, unguarded_rows
from crowdsim.crowd.simulate import simulate
from crowdsim.crowd.simulation import Simulation


def dropping(chosen, seconds=2.0 / 3.0):
    """The same policy where both hands hang again and again, for some time each."""
    database = chosen.database
    frames = np.arange(len(database.fists))
    hangs = frames % (3 * round(seconds * database.playback_rate)) < round(seconds * database.playback_rate)
    fists = np.where(hangs[:, None, None], database.fists - np.float32([0.0, 0.6, 0.0]), database.fists)
    return replace(chosen, database=replace(database, fists=fists)), hangs


def guarded():
    """A policy of motion that keeps its guard, and that gains little by any action."""
    chosen = policy(3, frames=120)
    return replace(chosen, behaviours=tuple(replace(each, scale=10.0 * each.scale) for each in chosen.behaviours))


GUARDED = guarded()
DROPPING, HANGS = dropping(GUARDED)


def test_motion_that_keeps_its_guard_costs_nothing():
    assert not unguarded_rows(GUARDED).any()


def test_hands_that_hang_are_found_and_a_fist_that_dips_is_not():
    np.testing.assert_array_equal(drops_guard(DROPPING), HANGS)
    assert not drops_guard(dropping(GUARDED, 0.2)[0]).any()


def test_motion_without_strikes_has_no_guard_to_drop():
    database = replace(DROPPING.database, strike_frames=np.zeros(0, np.int32))
    assert not unguarded_rows(replace(DROPPING, database=database)).any()


def test_an_action_costs_its_own_time_and_the_least_that_follows():
    found = unguarded_rows(DROPPING)
    np.testing.assert_allclose(found, naive_crowd.unguarded_times(DROPPING), atol=1e-3)
    assert found.min() >= 0.0
    assert 0.0 < found.max() < 2.0 / 3.0 / (1.0 - LATER ** (2.0 / 3.0))


@pytest.mark.parametrize("apart", [0.9 * NEAR, 1.1 * NEAR])
def test_an_avatar_keeps_its_guard_near_an_opponent_alone(apart):
    x, z = 20.0 * np.repeat(np.arange(200.0), 2), np.tile([0.0, apart], 200)
    people = build_crowd(x, z, np.tile([0.0, np.pi], 200), temperature=0.0, crowding=Crowding.none())

    def chosen(policy):
        simulation = Simulation(replace(people, policies=[policy]))
        action = simulation.run(1).action[0]
        simulation.close()
        return action

    cost = unguarded_rows(DROPPING)
    spared = cost[chosen(GUARDED)].mean() - cost[chosen(DROPPING)].mean()
    assert spared > 0.02 if apart < NEAR else spared == 0.0


def test_guards_are_kept_as_by_the_naive_twin():
    x, z, heading = np.random.default_rng(0).uniform(0, 5, (3, 6))
    people = build_crowd(x, z, heading, speed=1.2, seed=4, crowding=Crowding(wasted=0.0))
    [chunk] = simulate(replace(people, policies=[DROPPING]), 100)
    np.testing.assert_array_equal(chunk.action, naive_crowd.run(people, [DROPPING], 100).action)
    [other] = simulate(replace(people, policies=[GUARDED]), 100)
    assert not np.array_equal(chunk.action, other.action)

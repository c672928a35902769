"""The pre-roll: avatars begin on guard, in the middle of motion, at the places where the scenario puts them."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.kernels.layout import NO_STRIKE
from crowdsim.crowd.simulation import Simulation
from crowdsim.scenario.scenario import load_scenario

POLICY = policy(0)
N = 12


def people(**fields):
    places = np.arange(N) % 4 * 1.1, np.arange(N) // 4 * 1.1, np.linspace(-3.0, 3.0, N)
    crowd = build_crowd(*places, seed=3, interval=8.0)
    return replace(crowd, policies=[POLICY], **{"pre_roll": 30, **fields})


def test_the_first_frame_is_where_the_scenario_places_it_in_the_middle_of_motion():
    crowd = people()
    chunk = Simulation(crowd).run(40)
    np.testing.assert_allclose(chunk.x[0], crowd.x, atol=1e-6)
    np.testing.assert_allclose(chunk.z[0], crowd.z, atol=1e-6)
    np.testing.assert_allclose(np.cos(chunk.heading[0] - crowd.heading), 1.0, atol=1e-6)
    assert (chunk.action_frame[0] > 0).any()
    assert np.hypot(np.diff(chunk.x[:8], axis=0), np.diff(chunk.z[:8], axis=0)).max() < 0.4, "nobody jumps"
    assert (np.asarray(chunk.events.frame) > 0).all()


def test_nobody_is_about_to_strike_who_does_not_decide_to():
    simulation = Simulation(people())
    rolled = ~np.isin(np.arange(N), simulation._fresh)
    assert rolled.sum() > 2
    assert (simulation.avatars.playback["pending"][rolled] == NO_STRIKE).all()


def test_the_pre_roll_has_a_stream_of_its_own_and_changes_with_its_length():
    crowd = people()
    first = [Simulation(one).run(1) for one in (crowd, replace(crowd, pre_roll=45), replace(crowd, seed=4), crowd)]
    assert first[0].action.tobytes() == first[3].action.tobytes()
    assert all(first[0].action_frame.tobytes() != other.action_frame.tobytes() for other in first[1:3])


def test_it_is_the_same_frame_by_frame_in_any_order_and_however_neighbours_are_found():
    crowd = people()
    whole = Simulation(crowd).run(60)
    stepped = Simulation(crowd)
    frames = [stepped.step() for _ in range(60)]
    other = Simulation(crowd, threads=2, search="kd_tree", order=np.arange(N)[::-1]).run(60)
    for name in ("action", "action_frame", "x", "z", "heading", "opponent"):
        expected = getattr(whole, name)
        assert np.stack([getattr(frame, name) for frame in frames]).tobytes() == expected.tobytes()
        assert getattr(other, name).tobytes() == expected.tobytes()


def test_a_run_goes_on_from_its_first_frame():
    crowd = people()
    whole = Simulation(crowd).run(40)
    begun = Simulation(crowd)
    begun.run(1)
    resumed = Simulation(crowd)
    resumed.restore(begun.state())
    assert resumed.run(39).x.tobytes() == whole.x[1:].tobytes()


@pytest.mark.parametrize(("changes", "expected"), [((), 3.0), (("pre_roll=1.5",), 1.5), (("groups[0].count=1100",), 0)])
def test_a_scenario_says_how_long_it_is_and_large_crowds_have_none(changes, expected):
    scenario = load_scenario("brawl_30", ("groups[0].placement={kind: disc, radius: 90}", *changes))
    assert scenario.pre_roll == expected

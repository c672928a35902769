"""Decisions are explained as they are made."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from falling import falling_policy
from scenes import scene
from synthetic_policy import policy
from test_damage import fighters, rules

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.kernels import evaluate, layout, terms
from crowdsim.crowd.kernels.evaluate import TERMS
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario

HURT = {"boxer": {"policy": "tiny", "damage": {"health": 40}}}


@pytest.fixture
def simulate(workplace):
    def begin(**keys):
        scenario = load_scenario(scene(**keys))
        return Simulation(draw_crowd(scenario, load_policies(scenario)))

    return begin


@pytest.mark.parametrize("keys", [{}, {"types": HURT, "duration": 90, "pre_roll": 0}])
def test_the_action_that_is_explained_is_the_one_that_is_taken(simulate, keys) -> None:
    simulation, count, near = simulate(**keys), 0, 0
    before = np.full(4, -1)
    while not simulation.is_over:
        decisions = simulation.explain()
        frame = simulation.step()
        assert {one.frame for one in decisions} <= {frame.number}
        for one in decisions:
            assert frame.action[one.avatar] == one.chosen
            assert frame.opponent[one.avatar] == one.opponent
            assert one.values.shape == (len(TERMS), len(one.actions))
            count += 1
            near += one.chosen in one.actions[one.candidates]
        # None but those that have decided does something else now.
        changed = np.flatnonzero((frame.action != before) & (before >= 0))
        assert set(changed.tolist()) <= {one.avatar for one in decisions}
        before = frame.action
    assert count > 20
    # Some draw again, since there is a veto to what they have drawn.
    assert near > 0.7 * count


def test_those_who_are_knocked_down_are_explained_by_their_falls() -> None:
    policy, falling = falling_policy(), 0
    crowd = replace(fighters(rules=rules()), policies=[policy])
    simulation = Simulation(crowd, model=build_model([policy]))
    for _ in range(400):
        decisions = simulation.explain()
        down = simulation.avatars.conditions["standing"].copy()
        begun = begun_by_number(simulation)
        frame = simulation.step()
        assert [one.avatar for one in decisions] == np.flatnonzero(begun_by_number(simulation) > begun).tolist()
        for one in decisions:
            assert frame.action[one.avatar] == one.chosen
            falls = down[one.avatar] < layout.DROPS <= simulation.avatars.conditions["standing"][one.avatar]
            falling += falls and not len(one.actions)
    assert falling > 2


def test_a_neighbour_whose_action_ended_a_whole_frame_ago_is_no_body_on_the_floor() -> None:
    found = []
    for late in (0.0, 1.0):
        crowd = build_crowd(np.array([0.0, 0.3]), np.zeros(2), np.array([1.6, -1.6]), policies=[policy(0)], seed=2)
        simulation = Simulation(crowd)
        simulation.run(1)
        motion, slots = simulation.avatars.motion, simulation.avatars.slot_of
        motion["phase"] = simulation.model.actions["length"][motion["action"]] - 1.0
        motion["phase"][slots[1]] += late
        decisions = {one.avatar: one for one in simulation.explain()}
        assert set(decisions) == {0, 1}
        found.append(decisions[0].values[TERMS.index("collisions")])
    assert found[0].any()
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)


def begun_by_number(simulation):
    begun = np.zeros(simulation.crowd.count, int)
    begun[simulation.avatars.number] = simulation.avatars.fight["decisions"]
    return begun


def test_explaining_changes_nothing(simulate) -> None:
    one, other = simulate(), simulate()
    for _ in range(40):
        one.explain()
        one.step()
        other.step()
    for name, values in one.state().items():
        np.testing.assert_array_equal(values, other.state()[name], err_msg=name)


def test_terms_add_up_to_what_is_drawn_by(simulate) -> None:
    simulation = simulate(types={"boxer": {"policy": "tiny", "temperature": 0, "variety": 0}}, pre_roll=0)
    best = 0
    decisions = []
    while not simulation.is_over:
        found = simulation.explain()
        simulation.step()
        decisions += found
    for one in decisions:
        totals = one.totals
        assert np.isfinite(totals).all()
        np.testing.assert_allclose(totals, one.values.sum(axis=0))
        best += one.chosen == one.actions[np.argmax(totals)]
    # Without temperature the best one is taken, but for vetoes.
    assert best > 0.7 * len(decisions)


def test_each_file_of_terms_is_in_the_list_once() -> None:
    files = sorted(path.stem for path in Path(terms.__file__).parent.glob("*.py") if path.stem != "__init__")
    listed = [term.py_func.__module__.rpartition(".")[2] for _, term in evaluate.ADDED]
    assert sorted(["look_up", *listed]) == files
    assert len(set(TERMS)) == len(files)


def test_a_run_that_is_over_has_no_decisions(simulate) -> None:
    simulation = simulate(duration=3)
    while not simulation.is_over:
        simulation.step()
    assert simulation.explain() == []

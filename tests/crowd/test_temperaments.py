"""Tempo, aggression and range of each avatar's own: what they change, and that nothing else changes."""

from dataclasses import replace

import naive_crowd
import numpy as np
import pytest
from synthetic_policy import policy
from test_simulation import bytes_of, crowd, whole
from test_tempo import EAGER

from crowdsim.crowd import simulation
from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.kernels.records import RULE
from crowdsim.crowd.simulate import simulate
from crowdsim.crowd.simulation import Simulation
from crowdsim.policy.bundle import load_policy

POLICIES = [policy(0, "v", name="one"), policy(1, "q", frames=50, stride=2, name="two")]
NOTHING = np.zeros((1, len(RULE)))
SLOWNESS, DOUBLINGS, RANGE = range(3)


def drawn(count, seed=0):
    """Temperaments over all that scenarios allow."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0.3, 3.0, count), rng.uniform(-2.0, 2.0, count), rng.uniform(-0.3, 1.0, count)])


def of(count, **fields):
    """Fields of a crowd with these temperaments."""
    return {"rules": NOTHING, "conditioned": True, "temperaments": drawn(count), **fields}


@pytest.mark.parametrize("interval", [0.0, 12.0, 80.0])
def test_what_avatars_of_all_temperaments_do_is_what_the_naive_twin_says(interval):
    x, z, heading = np.random.default_rng(0).uniform(0, 3, (3, 6))
    people = build_crowd(
        x, z, heading, speed=1.2, interval=interval, seed=4, crowding=Crowding(wasted=0.0), variety=1.0, **of(6)
    )
    [chunk] = simulate(replace(people, policies=[EAGER]), 150)
    naive = naive_crowd.run(people, [EAGER], 150)
    np.testing.assert_array_equal(chunk.action, naive.action)
    assert len(chunk.events.frame) == len(naive.strikes) > 10
    same = [
        *simulate(
            replace(
                build_crowd(
                    x, z, heading, speed=1.2, interval=interval, seed=4, crowding=Crowding(wasted=0.0), variety=1.0
                ),
                policies=[EAGER],
            ),
            150,
        )
    ]
    assert not np.array_equal(same[0].action, chunk.action)


def test_avatars_without_a_temperament_are_even_tempered():
    plain = bytes_of(simulate(replace(crowd(interval=20.0), policies=POLICIES), 120))
    for temperaments in (np.zeros((0, 3)), np.tile([1.0, 0.0, 0.0], (12, 1))):
        fields = of(12, temperaments=temperaments, interval=20.0)
        assert bytes_of(simulate(replace(crowd(**fields), policies=POLICIES), 120)) == plain


def test_temperaments_depend_on_neither_threads_nor_storage_nor_calls(monkeypatch):
    people = crowd(20, interval=15.0, spacing=0.8, **of(20))
    expected = bytes_of(simulate(replace(people, policies=POLICIES), 80))
    assert (
        bytes_of(simulate(replace(people, policies=POLICIES), 80, order=np.random.default_rng(1).permutation(20)))
        == expected
    )
    one = Simulation(replace(people, policies=POLICIES))
    assert bytes_of([one.run(17), one.run(63)]) == expected
    monkeypatch.setattr(simulation, "SMALL", 0)
    assert bytes_of(simulate(replace(people, policies=POLICIES), 80, threads=2)) == expected


def test_a_state_with_other_temperaments_is_refused():
    people = crowd(interval=15.0, **of(12))
    state = Simulation(replace(people, policies=POLICIES)).state()
    drawn = [state[f"avatars.conditions.{name}"] for name in ("tempo", "aggression", "range")]
    np.testing.assert_array_equal(np.transpose(drawn), people.temperaments)
    state["avatars.conditions.range"][3] += 0.1
    with pytest.raises(ValueError, match=r"array 'avatars\.conditions\.range' is not that of the run"):
        Simulation(replace(people, policies=POLICIES)).restore(state)


def test_a_simulation_with_temperaments_goes_on_from_its_state():
    people = crowd(interval=15.0, **of(12))
    expected = bytes_of([Simulation(replace(people, policies=POLICIES)).run(80)])
    first, second = Simulation(replace(people, policies=POLICIES)), Simulation(replace(people, policies=POLICIES))
    begun = first.run(33)
    second.restore(first.state())
    assert bytes_of([begun, second.run(47)]) == expected


def test_in_one_crowd_each_keeps_its_own_tempo():
    x, z, heading = np.random.default_rng(0).uniform(0, 6, (3, 40))
    tempo = np.random.default_rng(1).uniform(20.0, 100.0, 40)
    temperaments = np.column_stack([60.0 / tempo, np.zeros(40), np.zeros(40)])
    fields = of(40, temperaments=temperaments, interval=15.0)
    _, events = whole(
        simulate(replace(build_crowd(x, z, heading, crowding=Crowding.none(), **fields), policies=[EAGER]), 1500)
    )
    thrown = np.bincount(events["attacker"], minlength=40)
    assert np.corrcoef(tempo, thrown)[0, 1] > 0.9


@pytest.fixture(scope="module")
def boxer(tiny_policy):
    return load_policy(tiny_policy)


def fight(boxer, column, value, frames=1500, pairs=8, **more):
    """Strikes thrown, and the median distance to the opponent, where all avatars have one number of a temperament."""
    x = np.repeat(4.0 * np.arange(pairs), 2)
    z, heading = np.tile([-0.5, 0.5], pairs), np.tile([0.0, np.pi], pairs)
    temperaments = np.tile([1.0, 0.0, 0.0], (2 * pairs, 1))
    temperaments[:, column] = value
    fields = of(2 * pairs, temperaments=temperaments, interval=15.0, team=np.tile([0, 1], pairs))
    record, events = whole(
        simulate(replace(build_crowd(x, z, heading, seed=2, **fields, **more), policies=[boxer]), frames)
    )
    other = np.maximum(record["opponent"], 0)
    apart = np.hypot(*(np.take_along_axis(record[axis], other, 1) - record[axis] for axis in "xz"))
    return len(events["frame"]), float(np.median(apart[record["opponent"] >= 0]))


def test_a_higher_tempo_means_more_strikes():
    alone = {"crowding": Crowding.none()}
    thrown = [fight(EAGER, SLOWNESS, 60.0 / tempo, **alone)[0] for tempo in (10.0, 25.0, 60.0, 150.0)]
    assert thrown == sorted(thrown)
    assert thrown[0] < 0.5 * thrown[2]


def test_more_aggression_means_more_strikes(boxer):
    shy, usual, bold = (fight(boxer, DOUBLINGS, np.log2(value), frames=4000)[0] for value in (0.25, 1.0, 4.0))
    assert shy < usual < bold


def test_a_greater_range_means_a_greater_distance(boxer):
    apart = [fight(boxer, RANGE, value)[1] for value in (-0.3, 0.0, 0.3)]
    assert apart == sorted(apart)
    assert apart[-1] > apart[0] + 0.1

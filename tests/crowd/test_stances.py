"""Stances: which foot leads in motion, how far states are from a stance, and that avatars keep theirs."""

from dataclasses import replace

import naive_crowd
import numpy as np
import pytest
from synthetic_policy import policy
from test_simulation import bytes_of, crowd, whole
from test_tempo import EAGER

from crowdsim.crowd import simulation
from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.kernels.records import RULE
from crowdsim.crowd.simulate import simulate
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.stances import MOST_ACTIONS, draw_stances, leading_feet, stance_actions
from crowdsim.motion import quaternion
from crowdsim.policy.bundle import load_policy
from crowdsim.scenario.scenario import load_scenario

NOTHING = np.zeros((1, len(RULE)))
ANY, ORTHODOX, SOUTHPAW = range(3)


def stancing(chosen):
    """A policy whose left foot leads in the first half of its motion, and whose right foot leads in the second."""
    database = chosen.database
    yaw = np.where(np.arange(len(database.ground)) < len(database.ground) // 2, -0.6, 0.6)
    rotations = np.zeros_like(database.rotations)
    rotations[..., 0] = 1.0
    rotations[:, 0] = quaternion.about_y(database.ground[:, 2] + yaw)
    return replace(chosen, database=replace(database, rotations=rotations))


POLICIES = [stancing(policy(0, "v", name="one")), stancing(policy(1, "q", frames=50, stride=2, name="two"))]
BOTH = stancing(EAGER)


def of(stances, **fields):
    """Fields of a crowd with these stances."""
    return {"rules": NOTHING, "conditioned": True, "stances": np.asarray(stances, np.uint8), **fields}


def drawn(count, seed=0):
    return np.random.default_rng(seed).integers(0, 3, count)


def test_the_foot_that_is_further_ahead_leads():
    leads = leading_feet(BOTH.database)
    half = len(leads) // 2
    assert (leads[: half - 15] == 1).all()
    assert (leads[half + 15 :] == -1).all()


def test_actions_to_a_stance_are_those_of_the_shortest_way():
    for chosen in (BOTH, *POLICIES):
        found, actions = stance_actions(chosen), chosen.actions
        leads = leading_feet(chosen.database)[chosen.graph.state_frames]
        assert len(np.unique(found)) > 1
        for column, sign in enumerate((1, -1)):
            for state in range(actions.state_count):
                ways, reached = 0, {state}
                while ways < MOST_ACTIONS and not any(leads[one] * sign >= 0 for one in reached):
                    reached = {
                        int(n) for s in reached for n in actions.next[actions.offsets[s] : actions.offsets[s + 1]]
                    }
                    ways += 1
                assert found[state, column] == ways


@pytest.mark.parametrize("interval", [0.0, 30.0])
def test_what_avatars_of_all_stances_do_is_what_the_naive_twin_says(interval):
    x, z, heading = np.random.default_rng(0).uniform(0, 3, (3, 6))
    stances = [0, 1, 2, 2, 1, 0]
    people = build_crowd(
        x, z, heading, speed=1.2, interval=interval, seed=4, crowding=Crowding(wasted=0.0), variety=1.0, **of(stances)
    )
    [chunk] = simulate(replace(people, policies=[BOTH]), 150)
    naive = naive_crowd.run(people, [BOTH], 150)
    np.testing.assert_array_equal(chunk.action, naive.action)
    assert len(chunk.events.frame) == len(naive.strikes) > 10


def test_avatars_without_a_stance_do_what_they_do_where_nobody_has_one():
    plain = bytes_of(simulate(replace(crowd(interval=20.0), policies=POLICIES), 120))
    assert bytes_of(simulate(replace(crowd(interval=20.0, **of(np.zeros(12))), policies=POLICIES), 120)) == plain
    assert bytes_of(simulate(replace(crowd(interval=20.0, **of(drawn(12))), policies=POLICIES), 120)) != plain


def test_avatars_begin_in_their_stance_and_return_to_it():
    stances = drawn(300)
    people = build_crowd(*np.random.default_rng(2).uniform(0, 40, (2, 300)), interval=20.0, seed=3, **of(stances))
    record, _ = whole(simulate(replace(people, policies=[BOTH]), 200))
    leads = leading_feet(BOTH.database)[BOTH.graph.state_frames]
    ends = leads[BOTH.actions.next[record["action"]]]
    first = leads[BOTH.actions.next[Simulation(replace(people, policies=[BOTH])).avatars.motion["action"]]]
    for stance, sign in ((ORTHODOX, 1), (SOUTHPAW, -1)):
        own = stances == stance
        assert (first[own] * sign >= 0).all()
        other = np.mean(ends[:, own] * sign < 0)
        assert other < 0.6 * np.mean(ends[:, stances == ANY] * sign < 0)


def test_stances_depend_on_neither_threads_nor_storage_nor_calls(monkeypatch):
    people = crowd(20, interval=15.0, spacing=0.8, **of(drawn(20)))
    expected = bytes_of(simulate(replace(people, policies=POLICIES), 80))
    assert (
        bytes_of(simulate(replace(people, policies=POLICIES), 80, order=np.random.default_rng(1).permutation(20)))
        == expected
    )
    one = Simulation(replace(people, policies=POLICIES))
    assert bytes_of([one.run(17), one.run(63)]) == expected
    first, second = Simulation(replace(people, policies=POLICIES)), Simulation(replace(people, policies=POLICIES))
    begun = first.run(33)
    second.restore(first.state())
    assert bytes_of([begun, second.run(47)]) == expected
    monkeypatch.setattr(simulation, "SMALL", 0)
    assert bytes_of(simulate(replace(people, policies=POLICIES), 80, threads=2)) == expected


def test_a_state_with_other_stances_is_refused():
    people = crowd(interval=15.0, **of(drawn(12)))
    state = Simulation(replace(people, policies=POLICIES)).state()
    state["avatars.conditions.stance"][3] = (state["avatars.conditions.stance"][3] + 1) % 3
    with pytest.raises(ValueError, match=r"array 'avatars\.conditions\.stance' is not that of the run"):
        Simulation(replace(people, policies=POLICIES)).restore(state)


SCENARIO = """
version: 1
name: stances
duration: 600
seed: 3
types:
  boxer:
    policy: {policy}
    stance: {stance}
groups:
  - {{type: boxer, count: 12, placement: {{kind: disc, radius: 3, distance: 0.9}}}}
"""


def scenario(folder, stance, name="tiny"):
    path = folder / "stances.yaml"
    path.write_text(SCENARIO.format(policy=name, stance=stance), encoding="utf-8")
    return load_scenario(path, policies=[name])


def test_southpaws_are_drawn_by_their_share(workplace):
    types = np.zeros(4000, np.int64)
    assert not draw_stances(scenario(workplace, "null"), types).any()
    assert (draw_stances(scenario(workplace, "orthodox"), types) == ORTHODOX).all()
    assert (draw_stances(scenario(workplace, "southpaw"), types) == SOUTHPAW).all()
    shares = draw_stances(scenario(workplace, "{southpaw: 0.2}"), types)
    assert set(shares) == {ORTHODOX, SOUTHPAW}
    assert np.mean(shares == SOUTHPAW) == pytest.approx(0.2, abs=0.02)


def test_southpaws_lead_with_the_right_foot_and_strike_with_the_other_hand(tiny_policy, workplace):
    tiny = load_policy(tiny_policy)
    leads, shown = leading_feet(tiny.database)[tiny.graph.state_frames], {}
    for stance, sign in (("orthodox", 1), ("southpaw", -1)):
        one = scenario(workplace, stance)
        people = replace(draw_crowd(one, [tiny]), frames=2400)
        record, events = whole(simulate(people, 2400))
        ends = leads[tiny.actions.next[record["action"]]]
        left = events["limb"][events["landed"]] == 0
        shown[stance] = np.mean(ends * sign > 0), np.mean(ends * sign < 0), np.mean(left), len(left)
    assert min(share for share, _, _, _ in shown.values()) > 0.6
    assert max(share for _, share, _, _ in shown.values()) < 0.4
    assert min(landed for *_, landed in shown.values()) > 50
    # What is mirrored strikes with the other hand.
    assert shown["orthodox"][2] == pytest.approx(1.0 - shown["southpaw"][2], abs=0.1)

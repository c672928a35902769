"""Defence: strikes are seen after the reaction time and not before, and weighed as the naive twin does."""

from dataclasses import replace

import naive_crowd
import naive_defence
import numpy as np
import pytest
from avatar_fields import base
from synthetic_policy import policy

from crowdsim.core.threats import CELLS
from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.layout import Now, Observed
from crowdsim.crowd.kernels.terms.defence import see_threat
from crowdsim.crowd.model import build_model
from crowdsim.crowd.script import Change
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import AtFrame
from crowdsim.policy.defence import join_defences


def defender(seed=0, **other):
    one = policy(seed, **other)
    table = np.random.default_rng(seed).uniform(0, 0.05, (one.actions.choice_count, CELLS)).astype(np.float32)
    return replace(one, defence=table)


POLICIES = [defender(0, name="one"), policy(1, "q", frames=50, stride=2, name="two")]


def crowd(count=12, seed=0, weight=1.0, reaction=3, **other):
    rng = np.random.default_rng(seed)
    z, x = np.divmod(np.arange(count), 4)
    fields = {
        "policy": rng.integers(0, 2, count),
        "scale": rng.uniform(0.9, 1.1, count),
        "speed": rng.uniform(0.8, 1.4, count),
        "seed": seed,
        "variety": 1.0,
        "defences": np.array([weight]),
        "reactions": np.array([reaction]),
        **other,
    }
    jitter = rng.normal(0, 0.1, (2, count))
    return build_crowd(x * 0.7 + jitter[0], z * 0.7 + jitter[1], rng.uniform(-3, 3, count), **fields)


@pytest.mark.parametrize(("reaction", "team"), [(0, None), (2, np.arange(12) % 2), (3, None)])
def test_defence_is_that_of_the_naive_twin(reaction, team, monkeypatch):
    people, seen = crowd(reaction=reaction, team=team), []
    sees = naive_defence.sees

    def noted(*words):
        found = sees(*words)
        seen.append(found[0] is not None)
        return found

    monkeypatch.setattr(naive_defence, "sees", noted)
    naive = naive_crowd.run(people, POLICIES, 60)
    record = Simulation(replace(people, policies=POLICIES)).run(60)
    assert np.array_equal(record.action, naive.action)
    assert np.array_equal(record.opponent, naive.opponent)
    assert sum(seen) > 5
    assert len(seen) - sum(seen) > 5
    plain = Simulation(replace(people, defences=np.zeros(1), policies=POLICIES)).run(60)
    assert not np.array_equal(plain.action, record.action)


def threats(one, reaction):
    """What every avatar of a simulation would see coming now from its opponent."""
    model, avatars, present = one.model, one.avatars, one.present
    avatars.fight["next_opponent"] = avatars.opponent
    cohorts = one._world.cohorts.copy()
    cohorts["reaction"] = reaction
    none = Observed(np.zeros(present, np.int32), np.zeros(present, np.int32), np.zeros((present, 1), np.int32))
    return [see_threat(model, avatars, cohorts, Now(one.frame, 1, present), i, none, i) for i in range(present)]


def ages(one):
    """Control frames since every avatar has decided."""
    return np.ceil(one.avatars.motion["phase"] / one.avatars.motion["speed"]) - 1


def swap(one, j, action):
    """Let an avatar do another action instead of its own, from where that one began."""
    starts = one.model.starts
    sin, cos, turn = np.sin, np.cos, one.avatars.playback["base_turn"][j]
    gx, gz, gh = starts[one.avatars.motion["action"][j]].tolist()
    scale, start = one.avatars.playback["scale"][j], turn + gh
    x, z = base(one.model, one.avatars, j)
    x, z = x + scale * (gx * cos(turn) + gz * sin(turn)), z + scale * (gz * cos(turn) - gx * sin(turn))
    gx, gz, gh = starts[action].tolist()
    turn = start - gh
    last = one.model.actions["length"][action] * one.model.policies["stride"][0]
    end_x, end_z, _ = one.model.ground[one.model.actions["origin"][action] + last].tolist()
    gx, gz = end_x - gx, end_z - gz
    one.avatars.playback["base_turn"][j] = turn
    one.avatars.motion["end_x"][j] = x + scale * (gx * cos(turn) + gz * sin(turn))
    one.avatars.motion["end_z"][j] = z + scale * (gz * cos(turn) - gx * sin(turn))
    one.avatars.motion["action"][j] = action


def same(threat, other):
    """Whether two threats are the same but for rounding."""
    return threat.cell == other.cell and np.allclose([threat.frames, *threat.point], [other.frames, *other.point])


def test_nothing_decided_within_the_reaction_time_is_reacted_to():
    reaction, compared, differed = 3, 0, 0
    one = Simulation(replace(crowd(count=12, speed=1.0, policy=0), policies=POLICIES))
    one.run(20)
    for _ in range(40):
        one.run(1)
        before, opponents = threats(one, reaction), one.avatars.opponent.copy()
        fresh = np.flatnonzero(ages(one) < reaction)
        for j in fresh:
            # Had it decided otherwise, by another action from the same state and place, nothing else would be seen.
            action, offsets = one.avatars.motion["action"][j], one.model.offsets
            state = np.searchsorted(offsets, action, side="right") - 1
            for other in range(offsets[state], offsets[state + 1]):
                if one.model.actions["length"][other] <= one.avatars.motion["phase"][j] or other == action:
                    continue
                motion, playback = one.avatars.motion.copy(), one.avatars.playback.copy()
                swap(one, j, other)
                victims = np.flatnonzero(opponents == one.avatars.number[j])
                now, unhidden = threats(one, reaction), threats(one, 0)
                compared += len(victims)
                differed += sum(not same(unhidden[v], before[v]) for v in victims)
                assert all(same(now[v], before[v]) for v in victims)
                one.avatars.motion[:], one.avatars.playback[:] = motion, playback
    assert compared > 0
    assert differed > 0


def test_what_was_decided_long_enough_ago_is_seen_where_and_when_it_lands():
    one, found = Simulation(replace(crowd(count=12, speed=1.0, scale=1.0, policy=0), policies=POLICIES)), 0
    expected = []
    for _ in range(60):
        chunk = one.run(1)
        strikes = chunk.events
        for frame, attacker, point in expected:
            thrown = (strikes.attacker == attacker) & (np.abs(strikes.frame - frame) < 1e-3)
            if thrown.any() and strikes.outcome[thrown][0] != layout.BLOCKED:
                np.testing.assert_allclose(strikes.point[thrown][0], point, atol=1e-4)
                found += 1
        for i, threat in enumerate(threats(one, 1)):
            if threat.cell < 0:
                opponent = one.avatars.opponent[i]
                assert ages(one)[one.avatars.slot_of[opponent]] >= 1
                expected.append((one.frame - 1 + threat.frames, opponent, threat.point))
    assert found > 3


def test_a_policy_without_defence_among_others_costs_nothing():
    table = POLICIES[0].defence
    joined = join_defences([None, table], [3, len(table) + 2])
    assert not joined[:3].any()
    assert np.array_equal(joined[3 : 3 + len(table)], table)
    assert not joined[3 + len(table) :].any()
    assert join_defences([None], [3]).shape == (0, CELLS)
    assert build_model([POLICIES[1]]).defence.shape == (0, CELLS)


def test_an_event_changes_how_much_avatars_defend_themselves():
    people = crowd(weight=0.0)
    change = Change(AtFrame(20), defences=np.array([1.0]))
    plain, changed = (
        Simulation(replace(people, policies=POLICIES)).run(60),
        Simulation(replace(people, policies=POLICIES, targets=(), changes=(change,))).run(60),
    )
    assert np.array_equal(plain.action[:20], changed.action[:20])
    assert not np.array_equal(plain.action, changed.action)


def test_threads_order_and_chunks_give_the_same_bytes():
    people = crowd(count=40)
    whole = Simulation(replace(people, policies=POLICIES)).run(60)
    order = np.random.default_rng(3).permutation(40)
    parts = Simulation(replace(people, policies=POLICIES), search="kd_tree", threads=2, order=order)
    chunks = [parts.run(25), parts.run(35)]
    for name in ("action", "x", "z", "heading", "opponent"):
        joined = np.concatenate([getattr(chunk, name) for chunk in chunks])
        assert getattr(whole, name).tobytes() == joined.tobytes()
    parts.close()

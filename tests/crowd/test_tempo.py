"""Strikes come in bursts: how many an avatar throws, that one which never tires chooses freely, and rests are still."""

from dataclasses import replace

import naive_crowd
import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.kernels.choose import BURSTS
from crowdsim.crowd.model_stillness import calm_rows
from crowdsim.crowd.simulate import simulate
from crowdsim.crowd.simulation import Simulation

FRAMES = 600
PER_STRIKE = ("strike_times", "strike_positions", "strike_origins", "strike_speeds", "strike_ids")


def eager():
    """A policy that gains little by any action and can always avoid to strike: the first action throws nothing."""
    chosen = policy(3, frames=120, name="eager")
    actions = chosen.actions
    counts = np.diff(actions.strike_offsets)
    owners = np.repeat(np.arange(actions.action_count), counts)
    kept = ~np.isin(owners, actions.offsets[:-1])
    counts[actions.offsets[:-1]] = 0
    strikes = {name: getattr(actions, name)[kept] for name in PER_STRIKE}
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    actions = actions._replace(strike_offsets=offsets, **strikes)
    behaviours = tuple(replace(each, scale=10.0 * each.scale) for each in chosen.behaviours)
    return replace(chosen, actions=actions, behaviours=behaviours)


def pausing(chosen):
    """The same policy where the body halts again and again, for eight control frames each time."""
    stretch = 8 * chosen.database.stride
    frames = np.arange(len(chosen.database.rotations))
    shown = np.where(frames // stretch % 2 == 0, frames - frames % stretch, frames)
    still = {name: getattr(chosen.database, name)[shown] for name in ("root_positions", "rotations")}
    return replace(chosen, database=replace(chosen.database, **still))


EAGER = eager()
PAUSING = pausing(EAGER)
STRIKES = np.diff(EAGER.actions.strike_offsets)


def ran(frames=FRAMES, chosen=EAGER, **fields):
    """Actions, and attackers and frames of all strikes, of a crowd in which nothing counts but values."""
    z, x = np.divmod(np.arange(16), 4)
    people = build_crowd(1.2 * x, 1.2 * z, x + z, seed=1, crowding=Crowding.none(), **fields)
    chunks = list(simulate(replace(people, policies=[chosen]), frames))
    events = [chunk.events for chunk in chunks]
    return (
        np.concatenate([chunk.action for chunk in chunks]),
        np.concatenate([one.attacker for one in events]),
        np.concatenate([one.frame for one in events]),
    )


def test_every_state_of_the_tests_policy_has_an_action_without_a_strike():
    least = np.minimum.reduceat(STRIKES, EAGER.actions.offsets[:-1])
    assert least.max() == 0
    assert STRIKES.max() >= 2


@pytest.mark.parametrize("interval", [15.0, 40.0, 150.0])
def test_no_avatar_throws_more_strikes_than_its_tempo_allows(interval):
    _, free, _ = ran()
    _, attackers, when = ran(interval=interval)
    # The last action of a burst may throw more than is left of it; another action may be under way at the end.
    spare = BURSTS[1] + 2 * STRIKES.max()
    for number in range(16):
        own = np.sort(when[attackers == number])
        assert (np.arange(1, len(own) + 1) <= spare + own / interval).all()
        assert len(own) <= spare + FRAMES / interval
    assert len(attackers) <= len(free)
    if interval == 150.0:
        assert len(free) / 16 > 2.0 * (spare + FRAMES / interval), "without it they throw far more"


def test_all_that_tempo_allows_is_thrown_by_those_who_would_throw_more():
    _, free, _ = ran(1500)
    _, attackers, _ = ran(1500, interval=40.0)
    assert len(free) / 16 > 1.2 * 1500 / 40.0
    assert len(attackers) / 16 > 0.7 * 1500 / 40.0


def test_a_rest_is_as_long_as_the_burst_before_it_takes_to_recover_from():
    interval = 60.0
    _, attackers, when = ran(interval=interval)
    for number in range(16):
        own = np.sort(when[attackers == number])
        # Within any stretch of time there are no more than two bursts, and what it allows.
        for first in range(len(own)):
            within = np.count_nonzero((own >= own[first]) & (own < own[first] + interval))
            assert within <= 2 * (BURSTS[1] + STRIKES.max())


def test_an_avatar_that_never_tires_chooses_as_one_that_recovers_at_once():
    for fields in ({}, {"temperature": 0.0}):
        free, _, _ = ran(200, **fields)
        at_once, _, _ = ran(200, interval=1e-9, **fields)
        np.testing.assert_array_equal(at_once, free)
        slow, _, _ = ran(200, interval=40.0, **fields)
        assert not np.array_equal(slow, free)


@pytest.mark.parametrize(("apart", "heading"), [(0.9, np.pi), (2.0, np.pi), (0.9, 0.0)])
def test_an_avatar_that_rests_is_still_while_its_opponent_is_near_and_ahead(apart, heading):
    # Pairs far from one another; the first of each looks at the second, or away from it.
    x, z = 10.0 * np.repeat(np.arange(200.0), 2), np.tile([0.0, apart], 200)
    fields = {"interval": 40.0, "temperature": 0.0, "crowding": Crowding.none()}
    people = build_crowd(x, z, np.tile([np.pi - heading, 0.0], 200), **fields)

    def chosen(policy):
        simulation = Simulation(replace(people, policies=[policy]))
        simulation.avatars.fight["rested"] = 100.0
        return simulation.run(1).action[0, ::2]

    share = calm_rows(PAUSING)
    assert 0.2 < share.mean() < 0.8
    near = apart < 1.0 and heading > 0.0
    gained = share[chosen(PAUSING)].mean() - share[chosen(EAGER)].mean()
    assert gained > 0.1 if near else gained == 0.0


@pytest.mark.parametrize("chosen", [EAGER, PAUSING], ids=["restless", "still"])
@pytest.mark.parametrize("interval", [0.0, 12.0, 80.0])
def test_bursts_and_rests_are_those_of_the_naive_twin(interval, chosen):
    x, z, heading = np.random.default_rng(0).uniform(0, 3, (3, 6))
    people = build_crowd(x, z, heading, speed=1.2, interval=interval, seed=4, crowding=Crowding(wasted=0.0))
    [chunk] = simulate(replace(people, policies=[chosen]), 150)
    naive = naive_crowd.run(people, [chosen], 150)
    np.testing.assert_array_equal(chunk.action, naive.action)
    assert len(chunk.events.frame) == len(naive.strikes) > 10

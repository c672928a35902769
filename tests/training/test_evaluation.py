"""Episodes: what is chosen, what is earned, and when an avatar has arrived."""

import math
from dataclasses import replace

import numpy as np
import pytest
from naive_policy import action_reward, action_values, random_actions

from crowdsim.motion import ground
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, TargetBody, TransitionTerm
from crowdsim.training.evaluation import Composition, EpisodeSettings, run_episodes

RATE, SECONDS = 15.0, 3.0
BODY = TargetBody()
NEAR = ProximityTerm(kind="proximity", distance=0.5, sigma=0.4)
HIT = StrikeTerm(kind="strike", tolerance=0.3)
PRICE = TransitionTerm(kind="transition", weight=0.3, each=0.1)


@pytest.fixture
def actions():
    return random_actions(states=20, seed=3)


def behaviour(actions, name, terms, reach, fade=0.0, scale=1.0):
    """A behaviour of any values, which differ from place to place."""
    distance = Axis("distance", 0.0, reach, 5, fade=fade)
    grid = build_grid([distance, Axis("bearing", -math.pi, math.pi, 8, wraps=True)])
    values = np.random.default_rng(len(name)).normal(size=actions.state_count * grid.cells).astype(np.float32)
    return Behaviour(name, grid, "v", values, scale, terms, 0.97)


def policy_of(actions, *behaviours):
    nothing = np.zeros(0, np.float32)
    return Policy("any", None, None, actions, behaviours, BODY, nothing, {}, {}, "", {})


def episode(policy, weights, judge, judged, state, target, within):
    """Return of one episode and when it arrived [frames], or NaN: slow and plain."""
    earned, arrived, frame, target = 0.0, math.nan, 0, np.array(target)
    while frame < round(SECONDS * RATE):
        a = int(policy.actions.offsets[state]) + int(np.argmax(action_values(policy, weights, state, target)))
        earned += judge.discount**frame * action_reward(judged, a, target, judge.terms, BODY, judge.discount)
        path = policy.actions.paths[policy.actions.path_offsets[a] : policy.actions.path_offsets[a + 1]]
        for t, place in enumerate(path.astype(float), start=1):
            x, _, z = ground.to_local(place, target)
            if math.isnan(arrived) and math.hypot(x, z) <= within and frame + t <= round(SECONDS * RATE):
                arrived = frame + t
        frame, state = frame + len(path), int(policy.actions.next[a])
        target = ground.to_local(path[-1].astype(float), target)
    return earned, arrived


def starts(actions, count=30):
    draw = np.random.default_rng(5)
    states = draw.integers(0, actions.state_count, count).astype(np.int32)
    distance, bearing = draw.uniform(0.3, 1.5, count), draw.uniform(-math.pi, math.pi, count)
    return states, np.stack([distance * np.sin(bearing), np.full(count, 1.5), distance * np.cos(bearing)], axis=-1)


@pytest.mark.parametrize("within", [0.3, 1.1])
def test_an_avatar_has_arrived_within_the_given_distance(actions, within):
    one = behaviour(actions, "approach", (NEAR, PRICE), 3.0)
    states, targets = starts(actions)
    result = run_episodes(actions, one, BODY, RATE, states, targets, EpisodeSettings(SECONDS, within=within))
    policy = policy_of(actions, one)
    expected = [
        episode(policy, {"approach": 1.0}, one, actions, *pair, within) for pair in zip(states, targets, strict=True)
    ]
    returns, arrivals = np.array(expected).T
    np.testing.assert_allclose(result.returns, returns, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(result.arrivals, arrivals / RATE)
    assert 0 < np.isfinite(arrivals).sum() < len(states)


def test_a_behaviour_alone_decides_wherever_the_target_is_and_whatever_its_scale(actions):
    one = behaviour(actions, "punch", (HIT, PRICE), 0.4)
    states, targets = starts(actions)
    expected = run_episodes(actions, one, BODY, RATE, states, targets, EpisodeSettings(SECONDS))
    axes = tuple(replace(axis, fade=0.0 if axis.wraps else 0.05) for axis in one.grid.axes)
    faded = replace(one, grid=build_grid(axes), scale=0.0)
    result = run_episodes(actions, faded, BODY, RATE, states, targets, EpisodeSettings(SECONDS))
    np.testing.assert_array_equal(result.returns, expected.returns)
    assert len(np.unique(result.returns)) > 10


def test_a_composition_chooses_by_all_its_behaviours_and_is_judged_by_another_reward(actions):
    composed = (
        behaviour(actions, "punch", (HIT, PRICE), 1.0, fade=0.5, scale=0.5),
        behaviour(actions, "approach", (NEAR, PRICE), 3.0, scale=2.0),
    )
    judge = behaviour(actions, "both", (HIT, NEAR, PRICE), 3.0)
    dear = actions._replace(costs=2.0 * actions.costs)
    states, targets = starts(actions)
    composition = Composition(actions, composed, np.array([1.0, 3.0]))
    result = run_episodes(dear, judge, BODY, RATE, states, targets, EpisodeSettings(SECONDS), composition)
    policy, weights = policy_of(actions, *composed), {"punch": 1.0, "approach": 3.0}
    expected = [episode(policy, weights, judge, dear, *pair, 0.6)[0] for pair in zip(states, targets, strict=True)]
    np.testing.assert_allclose(result.returns, expected, rtol=1e-5, atol=1e-5)
    alone = run_episodes(dear, judge, BODY, RATE, states, targets, EpisodeSettings(SECONDS))
    assert np.abs(result.returns - alone.returns).max() > 0.1


def test_threads_do_not_change_episodes(actions):
    one = behaviour(actions, "approach", (NEAR, PRICE), 3.0)
    states, targets = starts(actions)
    for choice in ("table", "random", "search"):
        settings = EpisodeSettings(SECONDS, choice, width=4, depth=2, target_speed=0.5)
        first, second = (
            run_episodes(actions, one, BODY, RATE, states, targets, settings, threads=threads) for threads in (1, 2)
        )
        np.testing.assert_array_equal(first.returns, second.returns)

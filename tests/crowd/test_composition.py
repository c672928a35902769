"""What composed behaviours do together depends on what each of them decides, not on the size of its rewards."""

from dataclasses import replace

import numpy as np
import pytest
from naive_policy import action_values
from synthetic_policy import policy

from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.simulate import simulate
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.recipe import BehaviourSpec

AXES = {"distance": {"minimum": 0.0, "maximum": 4.0, "count": 9}, "bearing": {"count": 8}}
NEAR = {"kind": "proximity", "distance": [0.5, 0.9], "sigma": 0.5}
STRIKE = {"kind": "strike", "tolerance": 0.3, "effort": 0.1, "waste": 0.1, "form": "sum"}
PRICE = {"kind": "transition", "weight": 0.3, "each": 0.05}
REWARDS = {"approach": [NEAR, PRICE], "punch": [STRIKE, PRICE]}
BASE = policy(2, frames=60, name="composed")


def learned(name, rewards, lookup, precision="float32"):
    spec = BehaviourSpec(axes=AXES, rewards=rewards, lookup=lookup)
    return train_behaviour(name, spec, BASE.database, BASE.actions, BASE.body, precision)[0]


def compose(*behaviours):
    values = np.concatenate([each.table for each in behaviours])
    return replace(BASE, behaviours=behaviours, values=values)


def times(rewards, factor):
    """Rewards with everything that has a size multiplied: weights, and the price of each transition."""
    return [
        {
            **term,
            "weight": factor * term.get("weight", 1.0),
            **({"each": factor * term["each"]} if "each" in term else {}),
        }
        for term in rewards
    ]


def brawl(chosen, weights, frames=150, **fields):
    """All choices of a brawl: actions, and opponents. Shape (2, frames, N)."""
    z, x = np.divmod(np.arange(16), 4)
    people = build_crowd(1.2 * x, 1.2 * z, x + 2.0 * z, weights=np.array([weights]), seed=3, **fields)
    chunks = list(simulate(replace(people, policies=[chosen]), frames))
    return np.stack([np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("action", "opponent")])


@pytest.fixture(scope="module", params=["v", "q"])
def lookup(request):
    return request.param


@pytest.fixture(scope="module")
def trained(lookup):
    return {name: learned(name, rewards, lookup) for name, rewards in REWARDS.items()}


def test_behaviours_have_a_say_in_what_is_chosen(trained):
    chosen = compose(*trained.values())
    both = brawl(chosen, (1.0, 1.0))
    assert len(np.unique(both[0])) > 20
    for weights in ((1.0, 0.0), (0.0, 1.0)):
        assert not np.array_equal(brawl(chosen, weights), both)


@pytest.mark.parametrize("name", ["approach", "punch"])
def test_ten_times_the_rewards_of_one_behaviour_change_no_choice(lookup, trained, name):
    bigger = learned(name, times(REWARDS[name], 10.0), lookup)
    assert bigger.scale == pytest.approx(10.0 * trained[name].scale, rel=1e-4)
    given, scaled = compose(*trained.values()), compose(*{**trained, name: bigger}.values())
    weights = {"approach": 1.0, "punch": 1.5}
    for state in range(BASE.actions.state_count):
        for target in ((0.1, 1.5, 0.7), (-1.5, 1.5, 0.3)):
            one, two = (action_values(each, weights, state, target) for each in (given, scaled))
            np.testing.assert_allclose(two - two.max(), one - one.max(), atol=1e-3)
    np.testing.assert_array_equal(brawl(scaled, (1.0, 1.5)), brawl(given, (1.0, 1.5)))


def test_ten_times_the_rewards_change_no_choice_of_a_table_of_bytes(trained):
    given, bigger = (learned("punch", times(REWARDS["punch"], factor), "q", "int8") for factor in (1.0, 10.0))
    assert given.table.dtype == np.uint8
    assert np.abs(given.table.astype(int) - bigger.table.astype(int)).max() <= 1
    assert bigger.step / bigger.scale == pytest.approx(given.step / given.scale, rel=1e-4)


@pytest.mark.parametrize(
    "rewards",
    [
        [{**NEAR, "weight": 0.0}],
        [{"kind": "strike", "weight": 0.0}],
        [{**NEAR, "sigma": 1e9}],
        [{**NEAR, "sigma": 1e9, "weight": 100.0, "facing": True}],
        [{**PRICE, "weight": 0.0, "each": 0.0}, {"kind": "proximity", "distance": [0.0, 1000.0]}],
    ],
    ids=["nearness of no weight", "strikes of no weight", "all places alike", "all headings alike", "an endless band"],
)
def test_a_behaviour_without_a_preference_changes_no_choice(lookup, trained, rewards):
    mute = learned("mute", rewards, lookup)
    assert mute.scale == 0.0
    alone = compose(*trained.values())
    joined = compose(*trained.values(), mute)
    np.testing.assert_array_equal(brawl(joined, (1.0, 1.0, 5.0)), brawl(alone, (1.0, 1.0)))
    np.testing.assert_array_equal(brawl(joined, (0.0, 0.0, 1.0)), brawl(joined, (0.0, 0.0, 0.0)))


def test_two_copies_of_a_behaviour_choose_as_one_of_their_weight(lookup):
    free = learned("free", [NEAR, STRIKE], lookup)
    copies = compose(free, replace(free, name="copy"))
    one = brawl(copies, (1.0, 0.0))
    np.testing.assert_array_equal(brawl(copies, (0.5, 0.5)), one)
    np.testing.assert_array_equal(brawl(copies, (0.25, 0.75)), one)
    # Twice the weight is half the randomness, where nothing else counts.
    alone, twice = {"crowding": Crowding.none()}, {"margin": 0.2, "temperature": 0.1}
    one = brawl(copies, (1.0, 0.0), margin=0.1, temperature=0.05, **alone)
    np.testing.assert_array_equal(brawl(copies, (1.0, 1.0), **twice, **alone), one)


def test_the_price_of_a_transition_is_counted_once_among_copies(trained):
    punch = trained["punch"]
    copies = compose(punch, replace(punch, name="copy"))
    costs = BASE.actions.costs.astype(float)
    price = (0.3 * costs + 0.05 * (costs > 0.0)) / punch.scale
    for state in range(BASE.actions.state_count):
        own = slice(BASE.actions.offsets[state], BASE.actions.offsets[state + 1])
        alone = action_values(copies, {"punch": 1.0}, state, (0.1, 1.5, 0.7))
        for w1, w2 in ((1.0, 1.0), (0.7, 0.3), (2.0, 0.0)):
            both = action_values(copies, {"punch": w1, "copy": w2}, state, (0.1, 1.5, 0.7))
            unpriced = (w1 + w2) * (alone + price[own])
            np.testing.assert_allclose(both, unpriced - max(w1, w2) * price[own], atol=1e-5)

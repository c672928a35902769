"""A run knows the falls of its policies, and nobody falls by choice."""

from dataclasses import replace

import numpy as np
import pytest
from falling import falling_policy

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.model import build_model, entry_actions
from crowdsim.crowd.simulate import simulate
from crowdsim.policy.actions import leading_actions
from crowdsim.policy.policy import Policy


def without_falls() -> Policy:
    """The same policy as if its motion had no falls."""
    policy = falling_policy()
    actions = leading_actions(policy.actions, policy.actions.state_count)
    return replace(policy, graph=policy.graph.without_falls, actions=actions, falls=None)


def crowd(policies: int):
    rng = np.random.default_rng(3)
    count = 16
    x, z = rng.uniform(-2.5, 2.5, (2, count))
    return build_crowd(x, z, rng.uniform(-3, 3, count), policy=np.arange(count) % policies, seed=5)


@pytest.mark.parametrize("count", [1, 2])
def test_rows_of_falls_name_actions_of_the_run(count: int) -> None:
    policies = [falling_policy()] * count
    model, falls = build_model(policies), falling_policy().falls
    assert falls is not None
    assert model.falls.shape == (count * len(falls.actions),)
    for policy in range(count):
        rows = np.flatnonzero(model.falls["policy"] == policy)
        first = model.policies["actions"][policy]
        np.testing.assert_array_equal(model.falls["action"][rows] - first, falls.actions)
        for row in rows:
            direction, _, kind, action, fall, twin = model.falls[row].tolist()
            assert model.falls["policy"][twin] == policy
            assert model.falls["kind"][fall] == (kind if kind >= layout.STUMBLES else layout.FALLS)
            assert direction == model.falls["direction"][fall]
            assert model.falls["action"][fall] == action - (row - fall)
            assert row - fall == (kind if kind < layout.STUMBLES else 0)
            states = model.policies["states"][policy : policy + 2]
            assert states[0] <= model.actions["next"][action] < states[1]


@pytest.mark.parametrize("count", [1, 2])
def test_no_state_that_an_action_leads_to_has_falls(count: int) -> None:
    model = build_model([falling_policy()] * count)
    assert model.offsets[-1] == len(model.actions) - 1 == model.policies["actions"][-1]
    assert len(model.offsets) - 1 == len(model.twins) == len(model.reaches) == model.policies["states"][-1]
    reached = np.unique(model.actions["next"][:-1])
    chosen = np.concatenate([np.arange(model.offsets[state], model.offsets[state + 1]) for state in reached])
    assert not np.isin(model.falls["action"], chosen).any()
    entries = entry_actions(model)
    assert not np.isin(model.falls["action"], entries).any()
    assert (entries[reached] >= 0).all()


def test_a_model_without_falls_has_no_rows() -> None:
    model = build_model([without_falls()])
    assert model.falls.shape == (0,)
    assert model.fall_axes.shape == (0, 2)


@pytest.mark.parametrize("count", [1, 2])
def test_nobody_falls_who_is_not_knocked_down(count: int) -> None:
    """A crowd does the same whether its policies have falls or not, where no hit throws avatars off their feet."""
    records, some = [], crowd(count)
    some = replace(some, crowding=replace(some.crowding, back=0.0))
    for policy in (falling_policy(), without_falls()):
        chunks = list(simulate(replace(some, policies=[policy] * count), 120))
        records.append([np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("action", "x", "z")])
    for one, other in zip(*records, strict=True):
        np.testing.assert_array_equal(one, other)
    assert records[0][0].max() < falling_policy().graph.choice_count

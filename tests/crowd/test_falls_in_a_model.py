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
    assert model.falls.shape == (count * len(falls.actions), 4)
    assert len(model.fall_directions) == len(model.falls)
    for policy in range(count):
        rows = np.flatnonzero(model.falls[:, 0] == policy)
        first = model.policies[policy, layout.ACTIONS]
        np.testing.assert_array_equal(model.falls[rows, 2] - first, falls.actions)
        for row in rows:
            _, kind, action, fall = model.falls[row]
            assert model.falls[fall, 1] == (3 if kind >= 3 else 0)
            assert model.fall_directions[row] == model.fall_directions[fall]
            assert model.falls[fall, 2] == action - (row - fall)
            assert row - fall == kind if kind <= 2 else (row > fall) == (kind == 4)
            states = model.policies[policy : policy + 2, layout.STATES]
            assert states[0] <= model.actions[action, layout.NEXT] < states[1]


@pytest.mark.parametrize("count", [1, 2])
def test_no_state_that_an_action_leads_to_has_falls(count: int) -> None:
    model = build_model([falling_policy()] * count)
    assert model.offsets[-1] == len(model.actions) - 1 == model.policies[-1, layout.ACTIONS]
    assert len(model.offsets) - 1 == len(model.twins) == len(model.reaches) == model.policies[-1, layout.STATES]
    reached = np.unique(model.actions[:-1, layout.NEXT])
    chosen = np.concatenate([np.arange(model.offsets[state], model.offsets[state + 1]) for state in reached])
    assert not np.isin(model.falls[:, 2], chosen).any()
    entries = entry_actions(model)
    assert not np.isin(model.falls[:, 2], entries).any()
    assert (entries[reached] >= 0).all()


def test_a_model_without_falls_has_no_rows() -> None:
    model = build_model([without_falls()])
    assert model.falls.shape == (0, 4)
    assert model.falls.dtype == np.int32
    assert model.fall_directions.shape == (0,)


@pytest.mark.parametrize("count", [1, 2])
def test_nobody_falls_who_is_not_knocked_down(count: int) -> None:
    """A crowd does the same whether its policies have falls or not."""
    records = []
    for policy in (falling_policy(), without_falls()):
        chunks = list(simulate(replace(crowd(count), policies=[policy] * count), 120))
        records.append([np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("action", "x", "z")])
    for one, other in zip(*records, strict=True):
        np.testing.assert_array_equal(one, other)
    assert records[0][0].max() < falling_policy().graph.choice_count

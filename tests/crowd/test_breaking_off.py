"""Strikes are broken off where poses are alike, and no strike is begun that has to follow out of reach."""

import naive_breaks
import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd import model_breaks
from crowdsim.crowd.model import build_model


class Owner:
    """An avatar of which only the policy is known."""

    def __init__(self, chosen):
        self.policy = chosen


@pytest.mark.parametrize("alike", [0.05, 0.08, 1.0])
def test_ways_out_of_strikes_are_those_of_the_naive_twin(monkeypatch, alike):
    monkeypatch.setattr(model_breaks, "ALIKE", alike)
    policies = [policy(0, "v"), policy(1, "q", frames=50, stride=2), policy(2, "v", frames=120)]
    model, ways = build_model(policies), 0
    for k, owner in enumerate(map(Owner, policies)):
        actions, (first, state) = owner.policy.actions, (model.policies[k]["actions"], model.policies[k]["states"])
        strike = model.actions["strikes"][first]
        for one in range(actions.state_count):
            bound = naive_breaks.bound_strike(owner, one)
            assert model.bound[state + one] == (-1 if bound is None else strike + bound)
        for action in range(actions.action_count):
            own = range(actions.strike_offsets[action], actions.strike_offsets[action + 1])
            times = {k: float(actions.strike_times[k]) for k in own}
            found = {k: model.breaks[strike + k] for k in own}
            bound = naive_breaks.bound_strike(owner, actions.next[action])
            if bound is not None:
                times["leaves"] = float(actions.lengths[action] + actions.strike_times[bound])
                found["leaves"] = model.leaves[first + action]
            else:
                assert model.leaves[first + action] == -1
            for key, time in times.items():
                frame = int(np.ceil(time)) - 1 - round(naive_breaks.BEFORE)
                way = naive_breaks.way_out(owner, action, frame)
                assert found[key] == (-1 if way is None else first + way)
                ways += way is not None
    assert ways > 3

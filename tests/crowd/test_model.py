"""What control makes of policies: reward terms and axes that it does not know are refused by name."""

from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
import pytest
from avatar_fields import set_situations
from synthetic_policy import policy

from crowdsim.crowd.buffers import empty_scratch
from crowdsim.crowd.kernels.values import value_actions
from crowdsim.crowd.model import SUPPORTED_AXES, SUPPORTED_TERMS, build_model
from crowdsim.errors import PolicyError, RecipeError
from crowdsim.policy import environment, rewards
from crowdsim.policy.environment import AXIS_KINDS, Axis, AxisKind, build_grid
from crowdsim.policy.policy import action_values
from crowdsim.policy.rewards import TERMS, Term


class Toy(Term):
    """A term that nothing evaluates."""

    code: ClassVar[int] = 3
    kind: Literal["toy"] = "toy"

    def pack(self, body):
        """Return the weight."""
        return (self.weight,)


class Impostor(Toy):
    """A term with the code of another one."""

    code: ClassVar[int] = 1


def with_term(lookup, term):
    chosen = policy(4, lookup, name="toys")
    last = chosen.behaviours[-1]
    return replace(chosen, behaviours=(*chosen.behaviours[:-1], replace(last, terms=(*last.terms, term))))


@pytest.mark.parametrize("term", [Toy(), Impostor()], ids=["a code of its own", "the code of another"])
def test_a_reward_term_that_control_does_not_evaluate_is_refused_by_name(term, monkeypatch):
    monkeypatch.setitem(TERMS, "toy", type(term))
    monkeypatch.setattr(rewards, "COMPILED", (*rewards.COMPILED, type(term)))
    with pytest.raises(PolicyError) as error:
        build_model([policy(0), with_term("v", term)])
    assert str(error.value) == (
        "policy 'toys', behaviour 'punch': 'toy' is no reward term that control evaluates with the look-up v, expected "
        "one of strike, proximity, transition, or the look-up q"
    )


def test_a_table_of_actions_needs_no_reward_terms(monkeypatch):
    chosen = with_term("q", Toy())
    with pytest.raises(RecipeError, match="'toy' is no reward term of training"):
        build_model([chosen])
    monkeypatch.setattr(rewards, "COMPILED", (*rewards.COMPILED, Toy))
    model = build_model([chosen])
    scratch = empty_scratch(model, 1, 20)
    rng = np.random.default_rng(1)
    states, targets = rng.integers(chosen.actions.state_count, size=20), rng.uniform([-2, 1, -2], [2, 1.9, 2], (20, 3))
    scratch.order[:], scratch.cohorts[:], scratch.policies[:], scratch.states[:] = np.arange(20), 0, 0, states
    set_situations(scratch, targets)
    value_actions(model, np.ones((1, 2)), scratch, 0, 20)
    for k in range(20):
        expected = action_values(chosen, {each.name: 1.0 for each in chosen.behaviours}, states[k], targets[k])
        np.testing.assert_allclose(scratch.values[k, : len(expected)], expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("lookup", ["v", "q"])
def test_an_axis_that_control_does_not_measure_is_refused_by_name(lookup, monkeypatch):
    monkeypatch.setitem(AXIS_KINDS, "pace", AxisKind(3, "m/s", 0.0, True))
    monkeypatch.setattr(environment, "COMPILED", (*environment.COMPILED, "pace"))
    chosen = policy(4, lookup, name="toys")
    first = chosen.behaviours[0]
    grid = build_grid([*first.grid.axes, Axis("pace", 0.0, 1.0, 2)])
    chosen = replace(chosen, behaviours=(replace(first, grid=grid), *chosen.behaviours[1:]))
    with pytest.raises(PolicyError) as error:
        build_model([chosen])
    assert str(error.value) == (
        "policy 'toys', behaviour 'approach': 'pace' is no axis that control measures, expected one of distance, "
        "bearing, height"
    )


def test_control_supports_every_term_and_axis_of_training():
    assert set(SUPPORTED_TERMS) == set(rewards.COMPILED)
    assert SUPPORTED_AXES == environment.COMPILED

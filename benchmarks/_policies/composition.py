"""What the shipped composition of behaviours is rewarded for, as one behaviour that a reference can learn.

A composition adds up the values of its behaviours, each divided by its scale and multiplied by its weight, and counts
the price of a transition once, at the highest of their prices (``policy.kernels.values``). Its reward is the same sum
of the behaviours' terms, its price the same highest one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from crowdsim.policy.actions import Actions
from crowdsim.policy.policy import Policy
from crowdsim.policy.rewards import TransitionTerm
from crowdsim.training.evaluation import Composition
from crowdsim.training.ranges import resolve_grid
from crowdsim.training.recipe import BehaviourSpec, Recipe


def composed(policy: Policy) -> Composition:
    """Return the behaviours that avatars with a policy use by default, those that have a preference.

    Raises:
        ValueError: There are none.
    """
    counts = [k for k, one in enumerate(policy.behaviours) if policy.weights[k] > 0.0 and one.scale > 0.0]
    if not counts:
        raise ValueError(f"{policy.name}: no behaviour of the composition has a preference, expected one or more")
    return Composition(policy.actions, tuple(policy.behaviours[k] for k in counts), policy.weights[counts])


def joint_actions(composition: Composition) -> Actions:
    """Return the composition's actions, whose costs are what a transition costs it in all."""
    actions = composition.actions
    costs = actions.costs.astype(float)
    prices = np.zeros(len(costs))
    for behaviour, factor in zip(composition.behaviours, _factors(composition), strict=True):
        priced = [term for term in behaviour.terms if isinstance(term, TransitionTerm)]
        prices = np.maximum(prices, factor * sum(term.weight * costs + term.each * (costs > 0.0) for term in priced))
    return actions._replace(costs=prices.astype(actions.costs.dtype))


def joint_behaviour(recipe: Recipe, policy: Policy, composition: Composition) -> BehaviourSpec:
    """Return the composition's reward as one behaviour over ``joint_actions``, on a grid that holds all of theirs.

    Raises:
        ValueError: Behaviours discount differently, so that their rewards have no common return.
    """
    specs = [recipe.behaviours[behaviour.name] for behaviour in composition.behaviours]
    discounts = sorted({spec.discount for spec in specs})
    if len(discounts) != 1:
        raise ValueError(f"{policy.name}: the behaviours' discounts are {discounts}, expected one for all")
    rewards: list[dict[str, Any]] = [{"kind": "transition", "weight": 1.0}]
    for behaviour, factor in zip(composition.behaviours, _factors(composition), strict=True):
        for term in behaviour.terms:
            if not isinstance(term, TransitionTerm):
                rewards.append({**term.model_dump(mode="json"), "weight": factor * term.weight})
    outcome: dict[str, Any] = {"axes": _joint_axes(specs, policy), "rewards": rewards, "discount": discounts[0]}
    solvers = [spec.solver for spec in specs if spec.solver.kind == "value_iteration"]
    if solvers:
        outcome["solver"] = min(solvers, key=lambda solver: solver.tolerance).model_dump(mode="json")
    return BehaviourSpec.model_validate(outcome)


def _factors(composition: Composition) -> list[float]:
    """Return by what the rewards of each behaviour are multiplied."""
    pairs = zip(composition.behaviours, composition.weights, strict=True)
    return [float(weight) / behaviour.scale for behaviour, weight in pairs]


def _joint_axes(specs: list[BehaviourSpec], policy: Policy) -> dict[str, Any]:
    """Return axes that reach as far as those of any behaviour, with the most points and the finest steps of any."""
    found: dict[str, list[Any]] = {}
    for spec in specs:
        for axis in resolve_grid(spec, policy.database).axes:
            found.setdefault(axis.name, []).append(axis)
    axes: dict[str, Any] = {}
    for name, some in found.items():
        axes[name] = {"count": max(axis.count for axis in some)}
        if not any(axis.wraps for axis in some):
            axes[name]["minimum"] = min(axis.minimum for axis in some)
            axes[name]["maximum"] = max(axis.maximum for axis in some)
            axes[name]["stretch"] = min((axis.stretch for axis in some if axis.stretch), default=None)
    return axes

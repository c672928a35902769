"""The benchmark of policies: the reward of a composition, and a quick run."""

import importlib
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from naive_policy import action_reward, random_actions

from crowdsim.policy.environment import build_grid
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rewards import TargetBody, TransitionTerm
from crowdsim.training.ranges import resolve_grid
from crowdsim.training.recipe import Recipe

ROOT = Path(__file__).parents[1]
KEYS = {
    "return_ratio_to_reference", "time_ratio_to_search", "random_return_ratio", "success_share", "median_seconds",
    "details",
}  # fmt: skip
BODY = TargetBody()


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module("_policies.composition")


def recipe_of(**discounts: float) -> Recipe:
    """Return a recipe that composes two behaviours whose prices cross, and has a third that counts nothing."""

    def spec(reach: float, count: int, rewards: list, discount: float = 0.97) -> dict:
        axes = {"distance": {"minimum": 0, "maximum": reach, "count": count}, "bearing": {"count": 2 * count}}
        return {"axes": axes, "rewards": rewards, "discount": discount}

    near = {"kind": "proximity", "distance": 0.6, "weight": 2.0}
    return Recipe.model_validate(
        {
            "version": 1,
            "motion": {"performer": {}},
            "weights": {"walk": 1.0, "hit": 3.0, "idle": 0.0},
            "behaviours": {
                "walk": spec(5.0, 4, [near, {"kind": "transition", "weight": 2.0}]),
                "hit": spec(
                    2.0, 6, [{"kind": "strike"}, {"kind": "transition", "weight": 0.0, "each": 0.2}], **discounts
                ),
                "idle": spec(9.0, 9, [near]),
            },
        }
    )


def policy_of(recipe: Recipe) -> Policy:
    """Return a policy over random actions, as if it had learned."""
    actions = random_actions()
    nothing = np.zeros(0, np.float32)
    scales = {"walk": 0.5, "hit": 2.0, "idle": 1.0}
    behaviours = tuple(
        Behaviour(name, resolve_grid(spec, None), "v", nothing, scales[name], tuple(spec.rewards), spec.discount)
        for name, spec in recipe.behaviours.items()
    )
    return Policy("any", None, None, actions, behaviours, BODY, nothing, recipe.model_dump(), {}, "", {})


def test_a_compositions_reward_is_the_weighted_sum_with_the_highest_price_once(module: ModuleType) -> None:
    recipe = recipe_of()
    policy = policy_of(recipe)
    composition = module.composed(policy)
    assert [behaviour.name for behaviour in composition.behaviours] == ["walk", "hit"]
    joint, spec = module.joint_actions(composition), module.joint_behaviour(recipe, policy, composition)
    prices = set()
    for action in range(joint.action_count):
        target, cost = (0.2, 1.5, 0.7), float(policy.actions.costs[action])
        earned, priced = 0.0, {"walk": 2.0 * cost * 1.0 / 0.5, "hit": 0.2 * (cost > 0.0) * 3.0 / 2.0}
        for name, factor in (("walk", 1.0 / 0.5), ("hit", 3.0 / 2.0)):
            terms = tuple(term for term in policy.behaviour(name).terms if not isinstance(term, TransitionTerm))
            earned += factor * action_reward(policy.actions, action, target, terms, BODY, 0.97)
        result = action_reward(joint, action, target, tuple(spec.rewards), BODY, 0.97)
        assert result == pytest.approx(earned - max(priced.values()), abs=1e-5)
        if cost > 0.0:
            prices.add(max(priced, key=priced.__getitem__))
    assert prices == {"walk", "hit"}
    grid = build_grid(resolve_grid(spec, policy.database).axes)
    assert [(axis.name, axis.count, axis.maximum) for axis in grid.axes] == [
        ("distance", 6, 5.0),
        ("bearing", 12, math.pi),
    ]
    assert grid.axes[1].wraps


def test_behaviours_without_a_common_discount_have_no_return(module: ModuleType) -> None:
    recipe = recipe_of(discount=0.9)
    policy = policy_of(recipe)
    with pytest.raises(ValueError, match=r"any: the behaviours' discounts are \[0.9, 0.97\], expected one for all"):
        module.joint_behaviour(recipe, policy, module.composed(policy))

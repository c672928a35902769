"""Training: what a recipe's behaviour becomes."""

from pathlib import Path

import numpy as np
import pytest

from crowdsim.policy.bundle import load_policy
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.recipe import BehaviourSpec

APPROACH = {
    "axes": {"distance": {"minimum": 0, "maximum": 4, "count": 6}, "bearing": {"count": 8}},
    "rewards": [{"kind": "proximity", "distance": 0.6, "sigma": 0.5}],
    "solver": {"kind": "value_iteration", "tolerance": 0.05},
}


@pytest.mark.parametrize("lookup", ["q", "v"])
def test_values_are_not_normalised_where_a_recipe_disables_it(tiny_policy: Path, lookup: str) -> None:
    policy = load_policy(tiny_policy)
    found = {}
    for normalise in (True, False):
        spec = BehaviourSpec.model_validate({**APPROACH, "lookup": lookup, "normalise": normalise})
        found[normalise], _ = train_behaviour("approach", spec, policy.database, policy.actions, policy.body)
    np.testing.assert_array_equal(found[True].table, found[False].table)
    assert found[False].scale == 1.0
    assert found[True].scale not in (0.0, 1.0)

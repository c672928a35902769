"""What control makes of policies: their records, and terms that tables of actions do not need."""

from dataclasses import replace
from typing import Literal

import pytest
from synthetic_policy import policy

from crowdsim.crowd.model import build_model
from crowdsim.errors import RecipeError
from crowdsim.policy.rewards import Term


class Toy(Term):
    """A term that is not registered."""

    kind: Literal["toy"] = "toy"


@pytest.mark.parametrize("lookup", ["v", "q"])
def test_a_term_that_is_not_registered_is_refused_by_name(lookup):
    chosen = policy(4, lookup, name="toys")
    last = chosen.behaviours[-1]
    with pytest.raises(RecipeError, match="'toy' is no reward term, expected one of strike, proximity, transition"):
        build_model([replace(chosen, behaviours=(*chosen.behaviours[:-1], replace(last, terms=(*last.terms, Toy()))))])


def test_records_of_several_policies_lie_behind_one_another():
    one, two = policy(4, "v"), policy(5, "q")
    model = build_model([one, two])
    first, last = len(one.behaviours), len(one.behaviours) + len(two.behaviours)
    assert model.behaviours["looks_ahead"].tolist() == [True] * first + [False] * (last - first)
    assert model.behaviours["end_term"][:-1].tolist() == model.behaviours["first_term"][1:].tolist()
    names = [term.kind for each in (*one.behaviours, *two.behaviours) for term in each.terms]
    assert [("strike", "proximity", "transition")[kind] for kind in model.terms["kind"]] == names
    points = [[axis.count for axis in each.grid.axes] for each in (*one.behaviours, *two.behaviours)]
    assert [[int(n) for n in grid["points"] if n > 1] for grid in model.grids] == points

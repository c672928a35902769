"""What control makes of policies: their records, and terms that tables of actions do not need."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd.kernels.confinement import CLEARANCE, furthest_along
from crowdsim.crowd.kernels.interpolation import ground_at
from crowdsim.crowd.kernels.layout import LIMB_ROOM, TRUNK_ROOM
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


def test_the_octagon_around_an_action_holds_its_body_in_every_frame():
    policies = [policy(4, "v"), policy(5, "q", frames=50, stride=2)]
    model = build_model(policies, with_outlines=True)
    rooms, rng, spare = np.array([CLEARANCE, *[TRUNK_ROOM] * 3, *[LIMB_ROOM] * 6]), np.random.default_rng(0), []
    first = len(policies[0].lookup_tables().actions.next)
    for action in range(len(model.actions) - 1):
        span, stride = model.spans[action], model.policies["stride"][int(action >= first)]
        middle = np.array([span[0] - span[1], span[2] - span[3]]) / 2
        for done in rng.uniform(0.0, model.actions["length"][action] * stride, 5):
            shown = model.actions["origin"][action] + done
            x, z, heading = ground_at(model.ground, shown)
            points, cos, sin = model.outlines[int(shown)], np.cos(heading), np.sin(heading)
            px, pz = x + points[:, 0] * cos + points[:, 2] * sin, z - points[:, 0] * sin + points[:, 2] * cos
            px, pz, angle = np.append(x, px), np.append(z, pz), rng.uniform(0.0, 2.0 * np.pi)
            along = px * np.sin(angle) + pz * np.cos(angle) + rooms
            spare.append(furthest_along(span, np.sin(angle), np.cos(angle)) - along.max())
            spare.append(span[8] - (np.hypot(px - middle[0], pz - middle[1]) + rooms).max())
    assert min(spare) >= 0.0
    assert np.median(model.spans[:, 8]) < 1.5

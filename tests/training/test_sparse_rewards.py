"""Models: what actions earn is stored where strikes land, and is what the plain rewards say everywhere."""

import numpy as np
import pytest
from naive_policy import action_reward, random_actions

from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, TargetBody, TransitionTerm
from crowdsim.training.model import build_model, build_movement

BODY = TargetBody()
GRID = build_grid(
    [
        Axis("distance", 0.2, 1.6, 7, stretch=1.5),
        Axis("bearing", -np.pi, np.pi, 8, wraps=True),
        Axis("height", 1.2, 1.6, 3),
    ]
)
STRIKE = StrikeTerm(kind="strike", tolerance=0.3)
SUM = StrikeTerm(kind="strike", tolerance=0.2, form="sum", effort=0.1, weight=0.5)
WASTE = StrikeTerm(kind="strike", tolerance=0.1, waste=0.3, effort=0.05)
NEAR = ProximityTerm(kind="proximity", distance=(0.4, 0.8), facing=True, aside=0.1, weight=0.2)
PRICE = TransitionTerm(kind="transition", weight=0.3, each=0.1)
TERMS = {
    "a strike": (STRIKE,),
    "two strike terms": (STRIKE, SUM),
    "waste": (WASTE, PRICE),
    "all": (NEAR, STRIKE, PRICE, WASTE, SUM),
    "no strikes": (NEAR, PRICE),
    "the same everywhere": (PRICE,),
}
STILL = build_movement()
MOVING = build_movement(1.5, 3, 0.4)


def dense(actions, terms, movement):
    """Rewards of every action in every cell, averaged over outcomes, by the plain version. Shape (A, C)."""
    rows = np.zeros((actions.action_count, GRID.cells))
    for chance, velocity in zip(movement.probabilities, movement.velocities, strict=True):
        for action in range(actions.action_count):
            for cell, target in enumerate(GRID.targets()):
                rows[action, cell] += chance * action_reward(actions, action, target, terms, BODY, 0.9, velocity)
    return rows


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS.keys())
@pytest.mark.parametrize("movement", [STILL, MOVING], ids=["still", "moving"])
def test_rewards_stored_sparsely_are_those_of_the_plain_version(terms, movement):
    actions = random_actions(states=5)
    model = build_model(actions, GRID, terms, BODY, 0.9, movement)
    expected = dense(actions, terms, movement)
    count = actions.action_count
    np.testing.assert_allclose(model.rewards(0, count), expected, atol=2e-6)
    for first, last in ((0, 1), (2, 7), (count - 3, count), (4, 4)):
        np.testing.assert_array_equal(model.rewards(first, last), model.rewards(0, count)[first:last])


def test_only_cells_where_strikes_land_are_stored_in_order():
    actions = random_actions()
    model = build_model(actions, GRID, (STRIKE, PRICE), BODY, 0.9, MOVING)
    outcomes, count = len(MOVING.probabilities), actions.action_count
    assert model.near.shape == (outcomes, count, 1)
    assert model.landed.shape == (outcomes * count + 1,)
    assert 0 < model.landed[-1] == len(model.landed_cells) < 0.2 * outcomes * count * GRID.cells
    assert (model.landed_rewards > 0.0).all()
    strikes = np.diff(actions.strike_offsets) > 0
    held = np.diff(model.landed).reshape(outcomes, count)
    assert not held[:, ~strikes].any()
    for row in range(outcomes * count):
        assert (np.diff(model.landed_cells[model.landed[row] : model.landed[row + 1]]) > 0).all()


@pytest.mark.parametrize(
    ("terms", "wide"), [((STRIKE, PRICE), False), ((SUM,), False), ((WASTE,), True), ((STRIKE, NEAR), True)]
)
def test_rewards_that_depend_on_the_position_of_the_target_are_stored_for_each(terms, wide):
    model = build_model(random_actions(), GRID, terms, BODY, 0.9)
    assert model.near.shape[2] == (GRID.cells // GRID.layers if wide else 1)

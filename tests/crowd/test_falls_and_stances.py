"""Avatars that have a stance stagger and get up in it, where motion that leads the same way allows it."""

from dataclasses import replace

import numpy as np
import pytest
from test_damage import column, falling, fighters, rules
from test_stances import BOTH, ORTHODOX, SOUTHPAW

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.stances import stance_actions

COUNT = 12


def chosen_actions(kind, actions, directions, stances):
    """Which of some staggers, or of some falls whose rises are these actions, avatars show in each stance."""
    model = build_model([BOTH], with_stances=True)
    if kind == layout.STUMBLES:
        rows = [(turn, 0, kind, action, k) for k, (turn, action) in enumerate(zip(directions, actions, strict=True))]
        # All of them end where they begin: there is as much room for each.
        moves = model.moves.copy()
        moves["x"][actions], moves["z"][actions] = 0.0, 0.0
        model = model._replace(moves=moves)
    else:
        rows = [
            (turn, 0, part, action if part == layout.STANDS_UP else 3 * k + part, 3 * k)
            for k, (turn, action) in enumerate(zip(directions, actions, strict=True))
            for part in (layout.FALLS, layout.LIES, layout.STANDS_UP)
        ]
    model = falling(model, rows)
    hurting = rules()
    if kind == layout.STUMBLES:
        hurting[:, column("down_from")] = 1000.0
    hurting[:, column("full_health")] = 1e6
    hurting[:, column("most_downs")] = 1e6
    one = Simulation(replace(fighters(rules=hurting, stances=stances, interval=0.0), policies=[BOTH]), model=model)
    found = {int(stance): set() for stance in np.unique(stances)}
    for _ in range(300):
        before, decided = one.avatars.conditions["standing"].copy(), one.avatars.fight["decisions"].copy()
        one.run(1)
        now = one.avatars.conditions["standing"]
        begun = (before == layout.LYING) & (now != layout.LYING)
        if kind == layout.STUMBLES:
            # At the blow, so that no action has ended.
            begun = (one.avatars.fight["decisions"] > decided) & (one.avatars.playback["action_before"] == -1)
            begun = begun[one.avatars.slot_of]
        for number in np.flatnonzero(begun):
            action = int(one.avatars.motion["action"][one.avatars.slot_of[number]])
            if action in actions:
                found[int(stances[number])].add(action)
    return found


def ends_in(column):
    """Actions that end in a stance, and are not needed for anything else in these tests."""
    astray = stance_actions(BOTH)[BOTH.actions.next]
    other = astray[:, 1 - column]
    return [int(a) for a in np.flatnonzero((astray[:, column] == 0) & (other > 0)) if a > 12]


@pytest.mark.parametrize("kind", [layout.STUMBLES, layout.FALLS])
def test_motion_that_leads_to_the_own_stance_is_preferred(kind):
    left, right = ends_in(0)[:2], ends_in(1)[:2]
    stances = (np.arange(COUNT) % 3).astype(np.uint8)
    found = chosen_actions(kind, [*left, *right], [0.0] * 4, stances)
    assert found[0] & set(left)
    assert found[0] & set(right)
    assert found[ORTHODOX] <= set(left)
    assert found[SOUTHPAW] <= set(right)
    assert found[ORTHODOX]
    assert found[SOUTHPAW]


def test_where_a_blow_leads_counts_more_than_the_stance():
    right = ends_in(1)[:2]
    found = chosen_actions(layout.STUMBLES, right, [0.0, 0.0], np.full(COUNT, ORTHODOX, np.uint8))
    assert found[ORTHODOX] <= set(right)
    assert found[ORTHODOX]

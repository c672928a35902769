"""Avatars lead a scripted target that moves: strikes are thrown where it will be, and most of them land."""

import numpy as np
import pytest
from scenes import scene

from crowdsim import Simulation, build_scenario, draw_crowd, load_policies
from crowdsim.crowd.kernels.layout import LANDED


@pytest.mark.parametrize("speed", [0.0, 0.5, 1.0])
def test_most_strikes_land_on_a_target_however_fast_it_walks(workplace, speed) -> None:
    thrown, landed = 0, 0
    for seed in range(1, 9):
        circle = {"kind": "circle", "radius": 2.0, "speed": speed, "height": 1.5}
        still = {"kind": "points", "points": [[0, 1.5]], "height": 1.5}
        found = scene(
            seed=seed,
            duration=400,
            opponents={"kind": "target", "target": "ball"},
            targets={"ball": circle if speed else still},
            groups=[{"name": "one", "type": "boxer", "count": 1, "placement": {"kind": "points", "points": [[0, 0]]}}],
        )
        scenario = build_scenario(**found)
        outcomes = Simulation(draw_crowd(scenario, load_policies(scenario))).run(400).events.outcome
        thrown += len(outcomes)
        landed += np.count_nonzero(outcomes == LANDED)
    assert thrown > 80
    assert landed > 0.93 * thrown

"""Value maps are what the policy says of an opponent at each place."""

import numpy as np
import pytest
from naive_policy import action_values
from scenes import scene

from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.kernels.layout import LYING
from crowdsim.crowd.simulation import Simulation
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario


@pytest.fixture
def simulation(workplace):
    scenario = load_scenario(scene(duration=80))
    return Simulation(draw_crowd(scenario, load_policies(scenario)))


def test_a_map_is_what_a_naive_reading_of_the_policy_finds(simulation) -> None:
    simulation.run(12)
    before = {name: values.tobytes() for name, values in simulation.state().items()}
    found, (policy,) = simulation.value_map(2), simulation.crowd.policies
    assert {name: values.tobytes() for name, values in simulation.state().items()} == before
    assert found.values.shape == (len(found.distances), len(found.bearings))
    avatars, model = simulation.avatars, simulation.model
    slot = avatars.slot_of[2]
    scale, state = avatars.playback["scale"][slot], int(model.actions["next"][avatars.motion["action"][slot]])
    opponent = avatars.slot_of[avatars.opponent[slot]]
    origin = model.actions["origin"][avatars.motion["action"][opponent]]
    height = model.bodies[origin, 0, 1] * avatars.playback["scale"][opponent] / scale
    weights = dict(zip([one.name for one in policy.behaviours], policy.weights.tolist(), strict=True))
    for d in range(0, len(found.distances), 5):
        for b in range(0, len(found.bearings), 7):
            far, aside = found.distances[d] / scale, found.bearings[b]
            x, z = far * np.sin(aside), far * np.cos(aside)
            target = (x, height, z, np.arctan2(-x, -z))
            values = action_values(policy, weights, state, target, lasts=0.0)
            assert found.values[d, b] == pytest.approx(np.max(values), abs=2e-3)
    # Where it is near and ahead an opponent is worth more than behind.
    near = found.values[len(found.distances) // 3]
    assert near[np.argmin(np.abs(found.bearings))] > near[np.argmax(np.abs(found.bearings))]


def test_a_map_lies_where_the_action_in_progress_ends(simulation) -> None:
    simulation.run(12)
    avatars, asked = simulation.avatars, []
    for _ in range(40):
        found, slot = simulation.value_map(1), avatars.slot_of[1]
        action, at = avatars.motion["action"][slot], (avatars.x[slot], avatars.z[slot], avatars.heading[slot])
        simulation.run(1)
        if avatars.motion["action"][avatars.slot_of[1]] != action:
            asked.append((found, at))
    assert len(asked) > 3
    # It is about there then, but for the last part of a control frame and what others have pushed it.
    assert max(np.hypot(at[0] - found.x, at[1] - found.z) for found, at in asked) < 0.25
    assert max(abs(np.angle(np.exp(1j * (at[2] - found.heading)))) for found, at in asked) < 0.6


def test_an_avatar_without_weights_or_that_is_not_there_has_no_map(simulation) -> None:
    simulation.run(3)
    simulation._world.weights[:] = 0.0
    assert simulation.value_map(0) is None
    simulation._world.weights[:] = 1.0
    simulation._leave(np.arange(4) == simulation.avatars.slot_of[0])
    assert simulation.value_map(0) is None


def test_an_avatar_that_is_down_has_no_map(workplace) -> None:
    data = scene(duration=80)
    data["types"]["boxer"]["damage"] = {}
    scenario = load_scenario(data)
    simulation = Simulation(draw_crowd(scenario, load_policies(scenario)))
    simulation.run(3)
    assert simulation.value_map(1) is not None
    simulation.avatars.conditions["standing"][1] = LYING
    assert simulation.value_map(1) is None


@pytest.mark.parametrize("number", [-1, 99])
def test_there_is_no_map_of_an_avatar_that_is_not_in_the_crowd(simulation, number) -> None:
    with pytest.raises(ValueError, match=f"avatar {number} is not in the crowd, expected 0 to 3"):
        simulation.value_map(number)

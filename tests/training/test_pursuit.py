"""The speed that a policy can sustain: a crowd of its own keeps up and falls behind."""

import numpy as np
import pytest

from crowdsim.policy.bundle import load_policy
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import Scenario, resolve_scenario
from crowdsim.training.pursuit import (
    BEGUN,
    DONE,
    LEAD,
    LOST,
    MARGIN,
    MOST,
    TEMPERATURE,
    distances_behind,
    sustained_speed,
    tables_of,
)
from crowdsim.training.statistics import inspect_bundle


@pytest.fixture(scope="module")
def policy(tiny_policy):
    return load_policy(tiny_policy)


def follow(policy, speed: float, avatars: int = 24) -> float:
    """Distance of the median avatar from a target of its own that flees from it, in the mean [m]; by a real run."""
    angles = 2.0 * np.pi * np.arange(avatars) / avatars
    targets, groups = {}, []
    for k, angle in enumerate(angles):
        way, place = np.array([np.sin(angle), np.cos(angle)]), np.array([100.0 * k, 0.0])
        points = [(place + far * way).tolist() for far in (LEAD, LEAD + 1000.0)]
        targets[f"t{k}"] = {"kind": "points", "points": points, "speed": speed, "loop": False, "height": 1.55}
        groups.append(
            {"count": 1, "type": "one", "placement": {"kind": "points", "points": [place.tolist()]},
             "facing": 0, "opponents": {"kind": "target", "target": f"t{k}"}}
        )  # fmt: skip
    result = {"version": 1, "name": "chase", "seed": 1, "duration": {"seconds": DONE}, "groups": groups}
    scenario = Scenario.model_validate({**result, "types": {"one": {"policy": policy.name}}, "targets": targets})
    take = run(resolve_scenario(scenario), [policy])
    behind = np.hypot(take.x - take.targets[:, :, 0], take.z - take.targets[:, :, 2])
    return float(np.median(behind[round(BEGUN * take.control_rate) :].mean(axis=0)))


def test_a_crowd_keeps_up_with_slower_targets_and_loses_faster_ones(policy):
    speed = sustained_speed(policy)
    assert 0.1 < speed < 4.0
    assert float(np.median(distances_behind(policy, 0.7 * speed, tables_of(policy)))) < LOST
    assert float(np.median(distances_behind(policy, 1.5 * speed, tables_of(policy)))) > LOST
    assert follow(policy, 0.7 * speed) < LOST
    assert follow(policy, 1.5 * speed) > LOST


def test_distances_of_a_still_target_are_those_of_a_crowd(policy):
    assert float(np.median(distances_behind(policy, 0.0, tables_of(policy)))) == pytest.approx(
        follow(policy, 0.0), abs=0.15
    )


def test_a_bundle_holds_the_speed_that_its_policy_sustains(policy):
    assert inspect_bundle(policy)["sustained_speed"] == policy.statistics["sustained_speed"] == sustained_speed(policy)


def test_defaults_of_types_are_those_that_the_speed_is_measured_with():
    result = {"version": 1, "name": "two", "duration": 1, "types": {"one": {}}}
    scenario = Scenario.model_validate(
        {**result, "groups": [{"count": 2, "type": "one", "placement": {"kind": "disc", "radius": 3}}]}
    )
    one = scenario.types["one"]
    assert (one.candidates.margin, one.candidates.maximum, one.temperature) == (MARGIN, MOST, TEMPERATURE)

"""Duels that training ends with: their figures are those of runs, and the same policy has the same ones."""

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.simulation import Simulation
from crowdsim.policy.bundle import load_policy, read_document
from crowdsim.scenario.scenario import load_scenario
from crowdsim.self_play.grading import SEEDS, STILL, grade_policy, joint_speeds, longest_wait
from crowdsim.self_play.train import train_recipe


@pytest.fixture(scope="module")
def policy(tiny_policy):
    return load_policy(tiny_policy)


@pytest.fixture(scope="module")
def grades(policy):
    return grade_policy(policy)


def test_the_longest_wait_lies_between_strikes_or_at_an_end():
    assert longest_wait(np.array([50.0, 10.0, 30.5]), 60) == (10.0, 30.5)
    assert longest_wait(np.array([50.0]), 60) == (0.0, 50.0)
    assert longest_wait(np.zeros(0), 60) == (0.0, 60.0)


def test_the_figures_are_those_of_the_shipped_scene(policy, grades):
    thrown, landed, waits, distances = [], [], [], []
    for seed in SEEDS:
        scene = load_scenario(
            "duel", [f"types.boxer.policy={policy.name}", "duration=60s"], seed, policies=[policy.name]
        )
        simulation = Simulation(draw_crowd(scene, [policy]))
        whole = simulation.run(900)
        simulation.close()
        thrown.append(len(whole.events.frame))
        landed.append(int(whole.events.landed.sum()))
        waits.append(max(np.diff([0.0, *sorted(whole.events.frame), 900.0])) / 15.0)
        distances.append(np.median(np.hypot(*(np.diff(axis[150:], axis=1) for axis in (whole.x, whole.z)))))
    assert (grades["thrown"], grades["landed"]) == (np.mean(thrown), np.mean(landed))
    assert grades["longest_wait"] == pytest.approx(max(waits))
    assert grades["distance"] == pytest.approx(np.mean(distances))
    assert grades["seconds"] == 60.0
    assert 0.0 <= grades["turned_away_share"] <= 1.0


def test_motion_that_is_held_stands_still(policy, grades):
    assert grades["still_share"] < 0.5
    database = policy.database
    held = replace(
        database,
        root_positions=np.broadcast_to(database.root_positions[:1], database.root_positions.shape),
        rotations=np.broadcast_to(database.rotations[:1], database.rotations.shape),
    )
    statue = replace(policy, database=held)
    assert joint_speeds(statue).max() < STILL < joint_speeds(policy).max()
    assert grade_policy(statue)["still_share"] == 1.0


def test_training_ends_with_duels_and_keeps_their_figures(tiny_policy, tmp_path):
    recipe = tmp_path / "my 1st: null.yaml"
    recipe.write_text(tiny_policy.with_suffix(".yaml").read_text(encoding="utf-8"), encoding="utf-8")
    stages = []
    folder, trained = train_recipe(recipe, progress=lambda stage, done, total: stages.append(stage))
    assert trained
    assert stages[-1] == "duel"
    assert read_document(folder)["statistics"]["duel"] == grade_policy(load_policy(folder))

"""From capture with kicks to a run in which feet land: detector, recipe, training, control, take, poses."""

from __future__ import annotations

import json
from pathlib import Path

import kicker
import numpy as np
import pytest
from scenes import crowdsim, scene, write_scene

import crowdsim as package
from crowdsim.bvh.io import from_clip, write_bvh
from crowdsim.policy.bundle import load_policy
from crowdsim.poses.contacts import body_points
from crowdsim.take.quality import measure_take
from crowdsim.training.survey import survey_capture

RECIPE = """
version: 1
motion:
  capture: {clips: ['*.bvh'], folder: ../capture}
strikes: {limbs: [hands, feet]}
graph: {threshold: 0.3, spacing: 0.2, branching: 6}
behaviours:
  punch:
    axes:
      distance: {minimum: 0, maximum: 2, count: 12}
      bearing: {count: 12}
      height: {minimum: 1.5, maximum: 1.8, count: 2}
    rewards:
      - {kind: strike, tolerance: 0.12}
    solver: {kind: value_iteration, tolerance: 0.05}
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with capture of kicks, and the policy ``kicker`` that was trained on it."""
    folder = tmp_path_factory.mktemp("kicks")
    (folder / "capture").mkdir()
    (folder / "policies").mkdir()
    for kind in kicker.KINDS:
        clip, _ = kicker.kicks((0, 0, 1), kind)
        write_bvh(folder / "capture" / f"{kind}.bvh", from_clip(clip))
    (folder / "policies" / "kicker.yaml").write_text(RECIPE, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert crowdsim("train", "kicker", "--threads", "1") == 0
    return folder


@pytest.fixture
def inside(project: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(project)
    monkeypatch.delenv("CROWDSIM_MOCAP", raising=False)
    return project


def test_inspect_counts_strikes_by_limb(inside: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert crowdsim("inspect", "capture/front.bvh", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["strikes"] == 3
    assert figures["strikes_by_limb"] == {"left_hand": 0, "right_hand": 0, "left_foot": 2, "right_foot": 1}
    assert [(strike["limb"], strike["hand"]) for strike in figures["strike_list"]] == [
        ("left_foot", "left"), ("left_foot", "left"), ("right_foot", "right"),
    ]  # fmt: skip
    assert crowdsim("inspect", "capture/front.bvh", "--plots", "plots") == 0
    assert "2 left foot, 1 right foot\n" in capsys.readouterr().out


def test_a_survey_counts_strikes_by_limb(inside: Path) -> None:
    assert survey_capture("capture").strikes == (0, 0, 6, 3)


def test_the_policy_knows_kicks(inside: Path) -> None:
    policy = load_policy("policies/kicker")
    strikes = policy.statistics["strikes"]
    assert strikes["by_foot"] == {"left": 6, "right": 3}
    assert strikes["by_hand"] == {"left": 0, "right": 0}
    assert strikes["by_kind"]["kick"] == policy.statistics["motion"]["strikes"] == 9
    assert set(np.asarray(policy.database.strike_limbs).tolist()) == {2, 3}
    # Without punches kicks are measured by kicks.
    assert np.asarray(policy.actions.strike_speeds).mean() == pytest.approx(1.0, abs=0.2)
    assert crowdsim("inspect", "kicker", "--plots", "plots") == 0


def test_kicks_land_and_touch_in_a_run(inside: Path) -> None:
    file = write_scene(
        inside / "two.yaml",
        name="two", duration=150, types={"boxer": {"policy": "kicker", "behaviours": {"punch": 1}, "tempo": None}},
        groups=[
            {**group, "count": 1, "placement": {"kind": "points", "points": [[0, at]]}}
            for group, at in zip(scene()["groups"], (0.5, -0.5), strict=True)
        ],
    )  # fmt: skip
    assert crowdsim("run", file, "--out", "run", "--threads", "1") == 0
    run = package.open_run("run")
    events = run.events
    limbs, landed = np.asarray(events.limb), np.asarray(events.landed)
    assert set(limbs.tolist()) <= {2, 3}
    np.testing.assert_array_equal(np.asarray(events.hand), limbs % 2)
    assert landed.sum() >= 3
    table = run.strikes(landed=True)
    assert set(table["limb"].tolist()) <= {"left_foot", "right_foot"}
    assert (table["y"] > 0.7).all()
    figures = measure_take(run.sampler)
    # Each is thrown back by the kicks of the other meanwhile.
    assert figures["fist_gap_95"] < 0.05
    at = np.flatnonzero(landed)[0]
    poses = run.sampler.moments(np.array([events.attacker[at]]), np.array([events.frame[at] / 15.0]))
    for _, body, scales, positions, rotations in poses:
        feet = body_points(body, positions, rotations, scales)[3][0, limbs[at]]
        assert np.linalg.norm(feet - events.point[at]) < 0.25


def test_a_recipe_of_hands_is_told_of_kicks(inside: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (inside / "policies" / "hands.yaml").write_text(RECIPE.replace("[hands, feet]", "[hands]"), encoding="utf-8")
    assert crowdsim("train", "hands", "--threads", "1") == 2
    assert "; or list feet in strikes.limbs, since there are 9 kicks; or train without" in capsys.readouterr().err

"""From motion to runs in which knees, heads and sticks strike: recipe, detector, training, control, take, poses."""

from __future__ import annotations

from pathlib import Path

import kicker
import numpy as np
import pytest
from scenes import crowdsim, scene, write_scene

import crowdsim as package
from crowdsim.bvh.io import from_clip, write_bvh
from crowdsim.motion import quaternion
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikers import LIMBS
from crowdsim.performer.skeleton import SPINE, SPINE1
from crowdsim.policy.bundle import load_policy
from crowdsim.poses.contacts import body_points
from crowdsim.take.quality import measure_take

RECIPE = """
version: 1
motion: {MOTION}
strikes: {STRIKES}
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
CAPTURE = "{capture: {clips: ['KIND*.bvh'], folder: ../capture}}"
POLICIES = {
    "knee": (CAPTURE.replace("KIND", "knee"), "{limbs: [knees]}"),
    "head": (CAPTURE.replace("KIND", "head"), "{limbs: [head]}"),
    "stick": (
        "{performer: {seconds: 40, seed: 2, stick: one_hand}, mirror: false}",
        "{limbs: [props], props: [{hand: right, point: [-0.39, 0, 0.45]}]}",
    ),
}
LANDING = {"knee": {"left_knee", "right_knee"}, "head": {"head"}, "stick": {"right_prop"}}
AWAY = {"head": 0.16, "stick": 0.8}
"""How far avatars stand from one another, over two [m]."""


def knees() -> Clip:
    clip = kicker.stand(10.0)
    for at, side in ((2.0, 0), (4.5, 1), (7.0, 0)):
        kicker.lift_knee(clip, at, side)
    return clip


def heads() -> Clip:
    clip = kicker.stand(10.0)
    times = np.arange(clip.frame_count) / clip.fps
    keys = [(0.0, 0.0)]
    for at in (2.0, 4.5, 7.0):
        keys += [(at - 0.3, -6.0), (at, 20.0), (at + 0.5, 0.0)]
    vectors = np.zeros((clip.frame_count, 3))
    vectors[:, 0] = kicker._smooth(times, keys)
    for joint in (SPINE, SPINE1):
        clip.rotations[:, joint] = quaternion.from_rotation_vector(np.radians(1.0) * np.degrees(vectors))
    return clip


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with capture of knees and heads, and the policies ``knee``, ``head`` and ``stick``."""
    folder = tmp_path_factory.mktemp("strikers")
    (folder / "capture").mkdir()
    (folder / "policies").mkdir()
    for name, clip in (("knee", knees()), ("head", heads())):
        write_bvh(folder / "capture" / f"{name}.bvh", from_clip(clip))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name, (motion, strikes) in POLICIES.items():
            text = RECIPE.replace("{MOTION}", motion).replace("{STRIKES}", strikes)
            (folder / "policies" / f"{name}.yaml").write_text(text, encoding="utf-8")
            assert crowdsim("train", name, "--threads", "1") == 0
    return folder


@pytest.fixture
def inside(project: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(project)
    monkeypatch.delenv("CROWDSIM_MOCAP", raising=False)
    return project


@pytest.mark.parametrize("name", POLICIES)
def test_the_policy_knows_what_strikes(inside: Path, name: str) -> None:
    policy = load_policy(f"policies/{name}")
    found = {LIMBS[limb] for limb in np.unique(policy.database.strike_limbs)}
    assert found == LANDING[name]
    kinds = policy.statistics["strikes"]["by_kind"]
    assert kinds["prop" if name == "stick" else name] == policy.statistics["motion"]["strikes"] >= 3
    assert crowdsim("inspect", name, "--plots", f"plots_{name}") == 0


@pytest.mark.parametrize("name", ["head", "stick"])
def test_strikes_land_and_touch_in_a_run(inside: Path, name: str) -> None:
    file = write_scene(
        inside / f"{name}.yaml",
        name=name, duration=300, collision_avoidance=name == "stick",
        types={"boxer": {"policy": name, "behaviours": {"punch": 1}, "tempo": 60 if name == "stick" else None}},
        groups=[
            {**group, "count": 1, "placement": {"kind": "points", "points": [[0, at]]}}
            for group, at in zip(scene()["groups"], (AWAY[name], -AWAY[name]), strict=True)
        ],
    )  # fmt: skip
    assert crowdsim("run", file, "--out", f"run_{name}", "--threads", "1") == 0
    run = package.open_run(f"run_{name}")
    events = run.events
    landed = np.flatnonzero(events.landed)
    assert len(landed) >= 3
    assert set(run.strikes(landed=True)["limb"].tolist()) <= LANDING[name]
    assert set(run.strikes()["limb"].tolist()) <= LANDING[name]
    figures = measure_take(run.sampler)
    assert figures["fist_gap_median"] < 0.02
    assert figures["fist_gap_95"] < 0.25
    at = landed[0]
    for _, body, scales, positions, rotations in run.sampler.moments(
        np.array([events.attacker[at]]), np.array([events.frame[at] / 15.0])
    ):
        point = body_points(body, positions, rotations, scales)[3][0, events.limb[at]]
        assert np.linalg.norm(point - events.point[at]) < 0.25
    # Whatever strikes with a stick holds one, without a word in the scenario.
    assert len(run.cast.attachments) == (name == "stick")


@pytest.mark.slow
def test_the_alley_has_sticks_latecomers_and_one_who_stays_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert crowdsim("run", "alley", "--out", "alley", "--set", "outputs.bvh=null") == 0
    run = package.open_run("alley")
    names, action = run.cast.names, run.action[:]
    there = {
        group: action[:, [name.startswith(group) for name in names]] >= 0 for group in ("many", "few", "first", "late")
    }
    assert [one.shape[1] for one in there.values()] == [12, 4, 1, 3]
    assert all(there[group][0].all() for group in ("many", "few", "first"))
    start = round(8.5 * 15)
    assert not there["late"][:start].any()
    assert there["late"][-1].all()
    landed = run.strikes(landed=True)
    assert (landed["limb"] == "right_prop").sum() >= 3
    # Falls are of nobody but the one who goes down at once; its head stays on the floor until the end.
    first = int(np.flatnonzero(names == names[[name.startswith("first") for name in names]][0])[0])
    downs = np.flatnonzero(run.events.down & (np.asarray(run.events.victim) == first))
    assert len(downs) == 1
    fallen = float(run.events.frame[downs[0]]) / 15.0
    times = np.linspace(fallen + 3.0, 29.9, 20)
    for _, body, scales, positions, rotations in run.sampler.moments(np.full(20, first), times):
        assert (body_points(body, positions, rotations, scales)[0][:, 1] < 0.5).all()

"""The witness of exported files: its own reader, kinematics and geometry, held against the package's on small files."""

import importlib
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import crowdsim

from crowdsim import load_scenario, open_run, read_bvh, run_to, to_clip, write_bvh
from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.performer.session import perform_solo
from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.kernels.records import Moments
from crowdsim.poses.outlines import find_surface

SCENARIO = """version: 1
name: two
seed: 1
duration: 60
types:
  boxer:
    policy: tiny
    scale: {kind: uniform, minimum: 0.9, maximum: 1.1}
    speed: {kind: uniform, minimum: 0.9, maximum: 1.1}
groups: [{name: boxers, type: boxer, count: 2, placement: {kind: disc, radius: 1, distance: 0.6}}]
opponents: {kind: anyone}
outputs: {bvh: {fps: 60}}
"""


@pytest.fixture
def witness(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    names = (
        "_exported.plain_bvh",
        "_exported.witness",
        "_exported.run",
        "_exported.capsules",
        "_exported.contact",
        "_exported.scenes",
        "_exported.strips",
        "_exported.table",
        "exported",
    )
    return SimpleNamespace(**{name.rpartition(".")[2]: importlib.import_module(name) for name in names})


def test_its_reader_and_kinematics_agree_with_the_package(witness: SimpleNamespace, tmp_path: Path) -> None:
    clip = perform_solo("jab").clip
    orders = ["XYZ", "ZXY", "YXZ"] * clip.skeleton.joint_count
    write_bvh(tmp_path / "jab.bvh", clip, orders[: clip.skeleton.joint_count])
    positions, turns = witness.plain_bvh.pose(witness.plain_bvh.read_plain(tmp_path / "jab.bvh"))
    expected, quaternions = clip_kinematics(to_clip(read_bvh(tmp_path / "jab.bvh"), 0.01))
    np.testing.assert_allclose(positions, expected, atol=2e-6)
    axis = np.array([0.3, -0.5, 0.8])
    np.testing.assert_allclose(turns @ axis, quaternion.rotate(quaternions, axis), atol=2e-6)


def test_knees_and_elbows_that_fold_backward_are_past_straight(witness: SimpleNamespace) -> None:
    angles = np.radians([30.0, 5.0, -5.0])
    crosses = np.zeros((3, 4, 3))
    crosses[..., 1] = np.sin(angles)[:, None]
    figure = SimpleNamespace(crosses=crosses, dots=np.repeat(np.cos(angles)[:, None], 4, axis=1))
    axes = witness.witness.hinge_axes(figure)
    np.testing.assert_allclose(witness.witness.flexions(figure, axes), [[30.0] * 4, [5.0] * 4, [-5.0] * 4])


def test_a_run_is_read_as_the_package_has_it(
    witness: SimpleNamespace, workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def inspect(*words: str) -> str:
        """Run a command in this process, which has loaded everything, and return what it prints."""
        capsys.readouterr()
        assert crowdsim(*words) == 0
        return capsys.readouterr().out

    monkeypatch.setattr(witness.exported, "crowdsim", inspect)
    (workplace / "two.yaml").write_text(SCENARIO)
    run_to(workplace / "run", load_scenario("two.yaml"))
    run = witness.scenes.open_exported(workplace / "run", workplace / "policies", workplace, None)
    take = open_run(workplace / "run")
    sampler, policies = take.sampler, take.policies
    poses = sampler.sample(0, take.output_frames(60), 60)[0]
    positions, _ = poses.joints()
    database, times = policies[0].database, np.arange(len(positions)) / 60.0
    shown = sampler.window(0, np.arange(2), times).playback(Moments(np.arange(2), times[:, None]))
    np.testing.assert_allclose(run.frames.T, shown.frames + shown.fractions, atol=1e-3)
    np.testing.assert_allclose(run.scales, take.cast.scales, rtol=1e-5)
    roles = [database.body.roles[name] for name in witness.witness.JOINTS]
    for avatar, figure in enumerate(run.figures):
        np.testing.assert_allclose(figure.joints, positions[:, avatar, roles], atol=1e-5)
    # Its skins are those that fists land on.
    rng, (_, turns) = np.random.default_rng(3), poses.joints()
    cast, body = take.cast, database.body
    bodies = PosedBodies(body, np.arange(2), cast.scales, cast.girths, cast.stretches, positions[30:31], turns[30:31])
    middles = positions[30, :, [body.roles[name] for name in ("pelvis", "chest", "head", "left_shoulder")]]
    points = middles + rng.uniform(-0.3, 0.3, (20, *middles.shape))
    for two in points.reshape(-1, 2, 3):
        gaps, _ = find_surface(bodies, cast.sexes).gaps(two)
        own = [witness.contact.above_skin(run, avatar, 30.0, two[avatar]) for avatar in range(2)]
        np.testing.assert_allclose(own, gaps, atol=2e-4)
    # The capture behind it is the database's, mirror images included.
    np.testing.assert_allclose(run.source.figure.joints[:, 0], database.root_positions, atol=2e-3)
    report = witness.exported.measure(workplace / "run", run, 0.4)
    assert report["fists"]["landed"] <= report["inspect"]["strikes_landed"]
    assert report["transitions_per_second"] == pytest.approx(report["inspect"]["transitions_per_second"], rel=0.05)
    assert report["hinges"]["clips_with_backward_hinges"] == []
    json.dumps(report, allow_nan=False)
    # The package measures penetration at every third frame.
    contacts = witness.capsules.find_contacts(run)
    depths = witness.capsules.deepest(contacts, 2, run.count)[:, ::3]
    assert depths.max() > 0.05
    assert np.mean(depths > 0.06) == pytest.approx(report["inspect"]["penetration_share_with_arms"], abs=0.01)
    rows = witness.table.measure_rows("two", report)
    assert all(files and (source or not measure.source) for (_, files, source, _), measure in zip(
        rows, witness.table.MEASURES, strict=True))  # fmt: skip
    monkeypatch.setattr(witness.strips, "TILES", 2)
    witness.strips.draw_strips(workplace / "run", workplace / "policies" / "tiny", run, report, workplace / "strips")
    kinds = {path.stem.removeprefix("run_") for path in (workplace / "strips").glob("*.png")}
    assert {"feet", "wrists", "gaze", "jumps"} <= kinds

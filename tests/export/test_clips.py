"""A bank of clips and tracks: a plain reader has the poses that we have, and each clip is there once."""

import importlib.util
import json
import re
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from scenes import crowdsim, write_scene
from scipy.spatial.transform import Rotation
from test_exports import COMING

from crowdsim.crowd.props import PROP
from crowdsim.errors import OutputError
from crowdsim.export import clips
from crowdsim.export.clips import write_clips
from crowdsim.export.posed import write_posed
from crowdsim.outputs.clips import ClipsOutput
from crowdsim.outputs.glb import GlbOutput
from crowdsim.poses.layers.blend import Blend
from crowdsim.poses.sampler import PoseSampler
from crowdsim.preparation.prepare import load_policies
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario

FPS = Fraction(24000, 1001)
READER = Path(__file__).resolve().parents[2] / "docs" / "clips_reader.py"


@pytest.fixture(scope="module")
def sampler(tiny_policy: Path, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("take")
    types = {
        "boxer": {"policy": "tiny", "speed": 1.1},
        "large": {"policy": "tiny", "scale": 1.2, "legs": 1.1, "arms": 0.9, "girth": 1.2},
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tiny_policy.parent.parent)
        scenario = load_scenario(write_scene(folder / "coming.yaml", **{**COMING, "types": types, "duration": 120}))
        policies = load_policies(scenario)
    return PoseSampler(run(scenario, policies), policies)


@pytest.fixture(scope="module")
def reader():
    spec = importlib.util.spec_from_file_location("clips_reader", READER)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Clips


def joints_of(clips, track, seconds):
    """Places of the joints of an avatar, by forward kinematics [m]. Shape (J, 3)."""
    rotations, root, (x, lift, z, heading) = clips.pose(track, seconds)
    skeleton = clips.tracks["skeletons"][track["skeleton"]]
    nodes = clips.gltf["skins"][track["skeleton"]]["joints"]
    ground = Rotation.from_rotvec([0.0, heading, 0.0])
    places, turned = [], []
    for joint, parent in enumerate(skeleton["parents"]):
        own = Rotation.from_quat(rotations[joint])
        if parent < 0:
            places.append(ground.apply(root * track["sizes"][0]) + np.array([x, lift, z]))
            turned.append(ground * own)
            continue
        offset = np.array(clips.gltf["nodes"][nodes[joint]]["translation"]) * track["sizes"][skeleton["sizes"][parent]]
        places.append(places[parent] + turned[parent].apply(offset))
        turned.append(turned[parent] * own)
    return np.array(places)


def captured_and_blended(sampler, times):
    """Places of joints of all avatars without layers of contacts [m]. Shape (T, n, J, 3)."""
    found = {}
    for block in sampler.poser.stretch(lambda one: one, np.arange(3), times, Blend.name):
        positions, _ = block.part.window.world_joints(block.poses)
        found |= {int(avatar): positions[:, column] for column, avatar in enumerate(block.part.window.avatars)}
    return np.stack([found[avatar] for avatar in range(3)], axis=1)


def test_ground_transforms_between_frames_follow_spins(
    sampler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sink = clips.ClipSink(sampler, tmp_path, 30, (5, 15))
    places = np.linspace(5, 14, 2001)

    def ground(policy, avatars, times):
        """One stays, one drifts, and one turns around in a tenth of a frame."""
        frames = np.broadcast_to(30.0 * times, (len(times), len(avatars)))
        headings = [0.0 * frames[:, 0], 0.1 * frames[:, 0], np.arctan(40.0 * (frames[:, -1] - 8.87))]
        shape = np.stack([frames, 0.0 * frames, frames, 0.0 * frames], axis=-1)
        shape[..., 3] = np.stack(headings[: len(avatars)], axis=1)
        return shape

    monkeypatch.setattr(sink, "_ground", ground)
    frames = np.arange(5, 15)
    known = ground(0, range(3), frames[:, None] / 30.0)
    rows = np.concatenate(sink._strays(0, np.arange(3), frames, known))
    assert set(rows[:, 0]) == {2}
    at = np.concatenate([frames, rows[:, 1] + 5])
    headings = np.concatenate([known[:, 2, 3], rows[:, 5]])[np.argsort(at)]
    found = np.interp(places, np.sort(at), headings)
    expected = ground(0, range(3), places[:, None] / 30.0)[:, 2, 3]
    assert 3 < len(rows) < 120
    assert 1.8 * np.abs(found - expected).max() < 0.005


def test_a_single_frame_has_nothing_between(sampler, tmp_path: Path) -> None:
    write_clips(sampler, tmp_path, 30, (6, 7))
    tracks = json.loads((tmp_path / "tracks.json").read_text())["avatars"]
    assert [(len(track["roots"]), track["between"]) for track in tracks] == [(1, []), (1, [])]


@pytest.mark.parametrize(("rotations", "frames"), [("float32", (0, 150)), ("int16", (7, 120))])
def test_a_reader_has_the_poses_that_were_captured_and_blended(sampler, tmp_path, reader, rotations, frames) -> None:
    write_clips(sampler, tmp_path, FPS, frames, rotations=rotations)
    bank = reader(tmp_path)
    times = np.arange(*frames) / float(FPS)
    expected = captured_and_blended(sampler, times)
    assert [track["name"] for track in bank.tracks["avatars"]] == ["red_0", "red_1", "late_0"]
    assert sum(len(track["segments"]) for track in bank.tracks["avatars"]) > 12
    for track in bank.tracks["avatars"]:
        there = np.flatnonzero(np.isfinite(expected[:, track["avatar"], 0, 0]))
        assert (there[0], len(there)) == (track["first"], len(track["roots"]))
        for frame in there:
            ours = joints_of(bank, track, times[frame] - times[0])
            assert np.abs(ours - expected[frame, track["avatar"]]).max() < 1e-3
    for share in (0.5, 0.9):
        between = captured_and_blended(sampler, times[:-1] + share / float(FPS))
        gaps = [
            np.linalg.norm(
                joints_of(bank, track, (frame + share) / float(FPS)) - between[frame, track["avatar"]], axis=1
            )
            for track in bank.tracks["avatars"]
            for frame in range(track["first"], track["first"] + len(track["roots"]) - 1)
        ]
        assert np.max(gaps) < 0.01


def test_clips_are_there_once_and_only_what_is_played_of_them(sampler, tmp_path, reader) -> None:
    write_clips(sampler, tmp_path, 30)
    bank, motion = reader(tmp_path), sampler.motions[0].frames
    database = sampler.policies[0].database
    starts = dict(zip(database.clip_names, np.asarray(database.clip_starts) * motion.stride, strict=False))
    covered = np.zeros(len(motion.rotations), int)
    for clip, (rotations, roots, rate) in zip(bank.tracks["clips"], bank.clips, strict=True):
        low = starts[clip["of"]] + clip["first"]
        covered[low : low + clip["frames"]] += 1
        assert rate == motion.rate
        np.testing.assert_allclose(roots, motion.roots[low : low + clip["frames"]], atol=1e-6)
        ours, theirs = rotations[..., [3, 0, 1, 2]], motion.rotations[low : low + clip["frames"]]
        np.testing.assert_allclose(np.abs(np.sum(ours * theirs, axis=-1)), 1.0, atol=1e-5)
    assert covered.max() == 1
    assert 0 < covered.mean() < 0.9
    for track in bank.tracks["avatars"]:
        ends = [start for _, start, *_ in track["segments"][1:]] + [(len(track["roots"]) + track["first"] - 1) / 30]
        for (clip, start, since, *_), end in zip(track["segments"], ends, strict=True):
            assert since >= 0.0
            seconds = (bank.tracks["clips"][clip]["frames"] - 1) / bank.tracks["clips"][clip]["rate"]
            assert since + (end - start) * track["speed"] <= seconds + 0.02


def test_a_bank_has_what_types_carry_at_its_joints(sampler, tmp_path, reader) -> None:
    write_clips(sampler, tmp_path, 30)
    assert "props" not in reader(tmp_path).tracks["skeletons"][0]
    joint = sampler.policies[0].database.body.roles["right_hand"]
    kind = sampler.take.cast.type_names.index("large")
    props = np.array([(kind, joint, (0, 0, 0), (0, 0, 0.5), 0.02, (0.5, 0.5, 0.5), False)], PROP)
    take = replace(sampler.take, cast=replace(sampler.take.cast, attachments=props))
    armed = PoseSampler(take, sampler.policies)
    write_clips(armed, tmp_path / "armed", 30)
    bank = reader(tmp_path / "armed")
    (prop,) = bank.tracks["skeletons"][0]["props"]
    assert prop == {"node": "large RightHand prop", "joint": joint, "type": "large"}
    nodes = bank.gltf["nodes"]
    (node,) = [number for number, one in enumerate(nodes) if one.get("name") == prop["node"]]
    assert node in nodes[bank.gltf["skins"][0]["joints"][joint]]["children"]
    assert nodes[node]["extras"] == {"type": "large"}
    position = bank.gltf["meshes"][nodes[node]["mesh"]]["primitives"][0]["attributes"]["POSITION"]
    limits = bank.gltf["accessors"][position]
    np.testing.assert_allclose(limits["min"], [-0.02, -0.02, -0.02], atol=1e-6)
    np.testing.assert_allclose(limits["max"], [0.02, 0.02, 0.52], atol=1e-6)
    # The poses are those without it, and files of others have none.
    track = bank.tracks["avatars"][0]
    np.testing.assert_array_equal(joints_of(bank, track, 1.0), joints_of(reader(tmp_path), track, 1.0))
    write_clips(armed, tmp_path / "bare", 30, avatars=[0, 1])
    assert "props" not in reader(tmp_path / "bare").tracks["skeletons"][0]


def test_parquet_has_what_json_has(sampler, tmp_path) -> None:
    write_clips(sampler, tmp_path, 30)
    head = json.loads((tmp_path / "tracks.json").read_text("utf-8"))
    table = pq.read_table(tmp_path / "tracks.parquet")
    tracks = head.pop("avatars")
    assert json.loads(table.schema.metadata[b"crowdsim"]) == head
    assert table.num_rows == len(tracks)
    for row, track in zip(table.to_pylist(), tracks, strict=True):
        for key in ("name", "avatar", "team", "type", "skeleton", "first"):
            assert row[key] == track[key]
        np.testing.assert_allclose(row["sizes"], track["sizes"], rtol=1e-6)
        np.testing.assert_allclose([list(one.values()) for one in row["segments"]], track["segments"], atol=1e-4)
        np.testing.assert_allclose([list(one.values()) for one in row["roots"]], track["roots"], atol=1e-4)
        assert len(row["between"]) == len(track["between"])
        for one, other in zip(row["between"], track["between"], strict=True):
            np.testing.assert_allclose(list(one.values()), other, atol=1e-4)


def test_blocks_of_frames_and_of_avatars_do_not_show(sampler, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("crowdsim.export.clips.find_spec", lambda name: None)
    whole = write_clips(sampler, tmp_path / "whole", 30)
    assert [path.name for path in whole] == ["bank.glb", "tracks.json"]
    monkeypatch.setattr("crowdsim.export.stream._POSES_AT_ONCE", 13)
    monkeypatch.setattr(clips, "_AT_ONCE", 2)
    parts = write_clips(sampler, tmp_path / "parts", 30, threads=3)
    assert [path.read_bytes() for path in parts] == [path.read_bytes() for path in whole]


def test_chosen_avatars_and_frames_alone_are_written(sampler, tmp_path, reader) -> None:
    write_clips(sampler, tmp_path, 30, (25, 40), [2])
    bank = reader(tmp_path)
    (track,) = bank.tracks["avatars"]
    assert (track["name"], track["first"], len(track["roots"])) == ("late_0", 0, 15)
    np.testing.assert_allclose(track["sizes"], [1.2, 1.32, 1.08], atol=1e-5)
    write_clips(sampler, tmp_path / "none", 30, (0, 10), [2])
    assert reader(tmp_path / "none").tracks["avatars"] == []


def test_clips_share_a_pass_with_other_outputs(sampler, tmp_path) -> None:
    outputs = [ClipsOutput(fps=30.0), GlbOutput(fps=30.0)]
    for name in ("together", "alone"):
        (tmp_path / name).mkdir()
    together = write_posed(sampler, tmp_path / "together", outputs)
    assert [path.name for path in together["clips"]] == ["bank.glb", "tracks.json", "tracks.parquet", "avatars.csv"]
    for output in outputs:
        alone = write_posed(sampler, tmp_path / "alone", [output])[output.name]
        for path, other in zip(alone, together[output.name], strict=True):
            assert path.read_bytes() == other.read_bytes()


def test_a_failure_leaves_no_half_written_file(sampler, tmp_path, monkeypatch) -> None:
    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(clips.os, "replace", fails)
    with pytest.raises(OutputError, match=r"bank\.glb: cannot be written: No space left on device"):
        write_clips(sampler, tmp_path, 30)
    assert list(tmp_path.iterdir()) == []


def test_the_command_exports_clips(tiny_policy: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tiny_policy.parent.parent)
    write_scene(tmp_path / "coming.yaml", **COMING)
    assert crowdsim("run", str(tmp_path / "coming.yaml"), "--out", str(tmp_path / "run")) == 0
    assert crowdsim("export", str(tmp_path / "run"), "--clips", "--frames", "0:20", "--rotations", "int16") == 0
    said = capsys.readouterr().out
    assert re.search(r"clips: 3 files and avatars\.csv", said)
    assert crowdsim("verify", str(tmp_path / "run")) == 0


@pytest.mark.slow
def test_the_validator_reports_nothing_about_a_bank(sampler, tmp_path) -> None:
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("npm is not installed")
    done = subprocess.run(
        ["npm", "install", "--prefix", str(tmp_path), "gltf-validator@2.0.0-dev.3.10"], capture_output=True
    )
    if done.returncode:
        pytest.skip("npm has no gltf-validator")
    bank = write_clips(sampler, tmp_path, 30, rotations="int16")[0]
    code = (
        "const v=require('gltf-validator'),f=require('fs');"
        "v.validateBytes(new Uint8Array(f.readFileSync(process.argv[1])))"
        ".then(r=>console.log(JSON.stringify(r.issues)))"
    )
    report = subprocess.run(["node", "-e", code, str(bank)], cwd=tmp_path, capture_output=True, text=True, check=True)
    issues = json.loads(report.stdout)
    assert (issues["numErrors"], issues["numWarnings"], issues["numInfos"]) == (0, 0, 0), issues["messages"][:5]

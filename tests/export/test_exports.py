"""Exports of a take through other people's readers, and in parts as whole."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scenes import crowdsim, write_scene

from crowdsim.body.looks import usual_build
from crowdsim.body.skin import build_skin_of, pose_skins
from crowdsim.bvh.io import read_bvh, to_clip
from crowdsim.errors import OutputError
from crowdsim.export import avatar_files, stream
from crowdsim.export.avatar_list import avatar_list
from crowdsim.export.cloud_files import FIELDS
from crowdsim.export.pointcloud import CloudSink, export_clouds
from crowdsim.export.posed import PosedOutput, write_posed
from crowdsim.export.stream import stream_poses
from crowdsim.motion.skeleton import Clip
from crowdsim.outputs.bvh import BvhOutput, export_bvh
from crowdsim.outputs.csv import CsvOutput
from crowdsim.outputs.glb import GlbOutput
from crowdsim.outputs.ply import PlyOutput
from crowdsim.poses.sampler import PoseSampler
from crowdsim.preparation.prepare import load_policies
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.header import TakeHeader
from crowdsim.take.store import TakeWriter

FPS = 30.0
COMING = {
    "groups": [
        {"name": "red", "team": "red", "type": "boxer", "count": 2,
         "placement": {"kind": "line", "start": [-1, 0.7], "end": [1, 0.7]}},
        {"name": "late", "team": "blue", "type": "large", "count": 1, "waits": True,
         "placement": {"kind": "grid", "centre": [0, -1]}},
    ],
    "types": {"boxer": {"policy": "tiny"}, "large": {"policy": "tiny", "scale": 1.2, "legs": 1.1, "arms": 0.9}},
    "opponents": {"kind": "anyone"},
    "events": [
        {"kind": "add", "when": {"kind": "frame", "frame": 10}, "group": "late"},
        {"kind": "remove", "when": {"kind": "frame", "frame": 25}, "group": "late"},
    ],
}  # fmt: skip
"""Two boxers who are there, and a large one who comes at frame 10 and leaves at frame 25."""


@pytest.fixture(scope="module")
def sampler(tiny_policy: Path, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("take")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tiny_policy.parent.parent)
        scenario = load_scenario(write_scene(folder / "coming.yaml", **COMING))
        policies = load_policies(scenario)
    return PoseSampler(run(scenario, policies), policies)


def joints_of(sampler: PoseSampler, avatar: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of joints and end sites of an avatar in the frames in which it is there [m], by forward kinematics."""
    (poses,) = sampler.sample(0, sampler.take.output_frames(FPS), FPS)
    positions, rotations = poses.joints()
    there = np.isfinite(positions[:, avatar, 0, 0])
    positions, rotations = positions[there, avatar], rotations[there, avatar]
    from crowdsim.motion import quaternion

    skeleton = poses.skeleton
    # End sites hang on heads, hands and feet.
    ends = skeleton.end_offsets * float(poses.scales[avatar])
    tips = positions[:, skeleton.end_parents] + quaternion.rotate(rotations[:, skeleton.end_parents], ends)
    return positions, tips


@pytest.mark.parametrize("avatar", [0, 1, 2])
def test_two_readers_find_every_joint_where_we_have_it(sampler: PoseSampler, tmp_path: Path, avatar: int) -> None:
    import bvhio
    import pybvh

    paths = export_bvh(sampler, tmp_path, FPS)
    assert [path.name for path in paths] == ["red_0.bvh", "red_1.bvh", "late_0.bvh"]
    ours, tips = joints_of(sampler, avatar)
    skeleton = sampler.policies[0].database.skeleton
    other = pybvh.read_bvh_file(str(paths[avatar]))
    assert other.fps == pytest.approx(FPS)
    theirs = other.joint_positions() * 0.01
    order = [skeleton.names.index(name) for name in other.joint_names]
    assert theirs.shape == ours.shape
    assert np.abs(theirs - ours[:, order]).max() < 0.001
    root = bvhio.readAsHierarchy(str(paths[avatar]))
    layout = [joint for joint, _, _ in root.layout()]
    for frame in range(0, len(ours), 7):
        root.loadPose(frame)
        for joint in layout:
            if joint.Name in skeleton.names:
                place = np.array(list(joint.PositionWorld)) * 0.01
                assert np.abs(place - ours[frame, skeleton.names.index(joint.Name)]).max() < 0.001
        ends = [np.array(list(joint.PositionWorld)) * 0.01 for joint in layout if joint.Name not in skeleton.names]
        for place in ends:
            assert np.linalg.norm(tips[frame] - place, axis=-1).min() < 0.001
    text = paths[avatar].read_text()
    assert text.count("End Site") == len(skeleton.end_parents) > 0


def test_avatars_that_come_and_leave_have_the_frames_in_which_they_are_there(sampler, tmp_path: Path) -> None:
    paths = export_bvh(sampler, tmp_path, FPS)
    frames = [int(path.read_text().split("Frames:")[1].split()[0]) for path in paths]
    assert frames == [80, 80, 30]
    assert export_bvh(sampler, tmp_path / "none", FPS, (0, 10), [2]) == []
    files = export_clouds(sampler, tmp_path / "ply", "ply", FPS, 30)
    assert len(files) == 80
    sizes = [len(CloudSink(sampler, tmp_path, "ply", FPS, 30).build(frame).avatar) for frame in (19, 20, 49, 50)]
    assert sizes == [60, 90, 90, 60]


@pytest.mark.parametrize("kind", ["ply", "pcd"])
def test_clouds_read_back_with_all_their_fields(sampler: PoseSampler, tmp_path: Path, kind: str) -> None:
    import open3d

    path = export_clouds(sampler, tmp_path, kind, FPS, 40, (30, 31))[0]
    assert path.name == f"000030.{kind}"
    cloud = CloudSink(sampler, tmp_path, kind, FPS, 40).build(30)
    read = open3d.t.io.read_point_cloud(str(path))
    columns = {name: read.point[name].numpy() for name in read.point}
    np.testing.assert_array_equal(columns["positions"], cloud.positions)
    if kind == "ply":
        np.testing.assert_array_equal(columns["normals"], cloud.normals)
    else:
        found = np.hstack([columns[name] for name in ("nx", "ny", "nz")])
        np.testing.assert_array_equal(found, cloud.normals)
    for row, name in enumerate(("vx", "vy", "vz")):
        np.testing.assert_array_equal(columns[name][:, 0], cloud.velocities[:, row])
    for name in ("avatar", "team", "joint"):
        assert columns[name].dtype == np.int32
        np.testing.assert_array_equal(columns[name][:, 0], getattr(cloud, name))
    assert set(cloud.avatar) == {0, 1, 2}
    assert list(cloud.team[::40]) == [0, 0, 1]
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("kind", ["ply", "pcd"])
def test_clouds_without_points_are_written_as_such(sampler: PoseSampler, tmp_path: Path, kind: str) -> None:
    import open3d

    paths = export_clouds(sampler, tmp_path, kind, FPS, 40, (18, 22), avatars=[2])
    counts = []
    for path in paths:
        head = path.read_bytes()[:1000].decode("latin-1")
        counts.append(int(re.search(r"^(?:POINTS|element vertex) (\d+)$", head, re.MULTILINE)[1]))
        # It calls a PCD file without points one without data, and has no points.
        with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
            point = open3d.t.io.read_point_cloud(str(path)).point
        assert (len(point.positions) if "positions" in point else 0) == counts[-1]
    assert counts == [0, 0, 40, 40]
    if kind == "pcd":
        none, some = (re.search(r"FIELDS (.*)", path.read_text("latin-1"))[1].split() for path in paths[1:3])
        assert set(none) == set(some) == set(FIELDS)


def test_plyfile_and_trimesh_read_clouds_too(sampler: PoseSampler, tmp_path: Path) -> None:
    import plyfile

    path = export_clouds(sampler, tmp_path, "ply", FPS, 40, (30, 31))[0]
    cloud = CloudSink(sampler, tmp_path, "ply", FPS, 40).build(30)
    data = plyfile.PlyData.read(str(path))
    assert not data.text
    vertex = data["vertex"]
    assert sorted(prop.name for prop in vertex.properties) == sorted(FIELDS)
    assert {prop.name: prop.val_dtype for prop in vertex.properties} == {
        name: "i4" if name in ("avatar", "team", "joint") else "f4" for name in FIELDS
    }
    np.testing.assert_array_equal(np.column_stack([vertex[name] for name in "xyz"]), cloud.positions)
    np.testing.assert_array_equal(trimesh.load(str(path)).vertices, cloud.positions)


@pytest.mark.parametrize("surface", ["capsules", "body"])
def test_velocities_are_how_points_move(sampler: PoseSampler, tmp_path: Path, surface: str) -> None:
    sink = CloudSink(sampler, tmp_path, "ply", FPS, 40, surface=surface)
    before, cloud, after = (sink.build(frame) for frame in (4, 5, 6))
    np.testing.assert_allclose(cloud.velocities, (after.positions - before.positions) * FPS / 2, atol=1e-3)
    assert 0.1 < np.abs(cloud.velocities).max() < 20
    first, second = sink.build(0), sink.build(1)
    np.testing.assert_allclose(first.velocities, (second.positions - first.positions) * FPS, atol=1e-3)


def test_points_of_bodies_lie_on_the_skins_that_gltf_has(sampler: PoseSampler, tmp_path: Path) -> None:
    cloud = CloudSink(sampler, tmp_path, "ply", FPS, 60, surface="body").build(30)
    (poses,) = sampler.sample(30, 31, FPS)
    positions, rotations = poses.joints()
    database, cast = sampler.policies[0].database, sampler.take.cast
    assert cloud.avatar.tolist() == np.repeat([0, 1, 2], 60).tolist()
    assert cloud.team[::60].tolist() == [0, 0, 1]
    for avatar in range(3):
        lengths = cast.stretches[avatar][sampler.motions[0].segments].astype(float)
        girth = float(cast.girths[avatar])
        skin = build_skin_of(database, usual_build(girth)).shaped(girth, lengths)
        matrices = skin.matrices(positions[0, avatar][None], rotations[0, avatar][None], cast.scales[[avatar]])
        (vertices,), (normals,) = pose_skins([skin], matrices)
        triangles = vertices[skin.triangles].astype(float)
        owners = np.concatenate([np.arange(len(skin.parents)), skin.helpers])
        rows = slice(60 * avatar, 60 * avatar + 60)
        for point, normal, joint in zip(cloud.positions[rows], cloud.normals[rows], cloud.joint[rows], strict=True):
            nearest = trimesh.triangles.closest_point(triangles, np.tile(point.astype(float), (len(triangles), 1)))
            gaps = np.linalg.norm(nearest - point, axis=1)
            assert gaps.min() < 1e-4
            corners = skin.triangles[np.argmin(gaps)]
            (shares,) = trimesh.triangles.points_to_barycentric(triangles[[np.argmin(gaps)]], point[None].astype(float))
            blended = shares @ normals[corners]
            assert blended @ normal > 0.999 * np.linalg.norm(blended)
            assert joint in owners[skin.joints[corners]][skin.weights[corners] > 0.1]


def test_writers_make_no_folders_when_they_are_built(sampler: PoseSampler, tmp_path: Path) -> None:
    BvhOutput(fps=FPS).sink(sampler, tmp_path / "bvh")
    CloudSink(sampler, tmp_path / "ply", "ply", FPS, 20)
    TakeWriter(tmp_path / "take.zarr", TakeHeader(sampler.take.cast, 15.0, "test", 3, ()), 1)
    assert not list(tmp_path.iterdir())


def test_outputs_that_share_poses_have_the_bytes_of_outputs_alone(sampler, tmp_path: Path, monkeypatch) -> None:
    frames = sampler.take.output_frames(FPS)
    (tmp_path / "together").mkdir()
    sinks = [
        BvhOutput(fps=FPS).sink(sampler, tmp_path / "together"),
        CloudSink(sampler, tmp_path / "together", "ply", FPS, 20, (3, frames - 2), 4, [0, 2]),
        CloudSink(sampler, tmp_path / "together", "pcd", FPS, 20, None, 5),
    ]
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 33)
    result = []
    stream_poses(sampler, FPS, sinks, 2, lambda *progress: result.append(progress))
    monkeypatch.undo()
    export_bvh(sampler, tmp_path / "alone", FPS)
    export_clouds(sampler, tmp_path / "alone", "ply", FPS, 20, (3, frames - 2), 4, [0, 2])
    export_clouds(sampler, tmp_path / "alone", "pcd", FPS, 20, None, 5)
    together, alone = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("together", "alone")
    )
    assert together.keys() == alone.keys()
    assert together == alone
    assert result[-1] == ("bvh and ply and pcd", 38, 38)
    assert [done for _, done, _ in result] == sorted(done for _, done, _ in result)


def test_many_avatars_are_written_in_groups(sampler: PoseSampler, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(avatar_files, "_FILES_AT_ONCE", 2)
    result = []
    files = export_bvh(sampler, tmp_path / "groups", FPS, progress=lambda *progress: result.append(progress))
    monkeypatch.undo()
    assert result[-1] == ("bvh", 3, 3)
    alone = export_bvh(sampler, tmp_path / "alone", FPS)
    assert [path.read_bytes() for path in files] == [path.read_bytes() for path in alone]


def test_the_list_of_avatars_says_when_each_is_there(sampler: PoseSampler, monkeypatch) -> None:
    def rows(output: PosedOutput, frames: tuple[int, int]) -> list[list[str]]:
        text = avatar_list(sampler, output.chosen(3), frames, output.rate, output.file_of)
        return list(csv.reader(text.splitlines()))[1:]

    whole = [
        ["0", "red_0", "red", "boxer", "0", "79", "80", "1", "athletic", "red_0.bvh"],
        ["1", "red_1", "red", "boxer", "0", "79", "80", "1", "athletic", "red_1.bvh"],
        ["2", "late_0", "blue", "large", "20", "49", "30", "1.2", "athletic", "late_0.bvh"],
    ]
    assert rows(BvhOutput(fps=FPS), (0, 80)) == whole
    monkeypatch.setattr("crowdsim.export.avatar_list._AT_ONCE", 7)
    assert rows(BvhOutput(fps=FPS), (0, 80)) == whole
    assert rows(GlbOutput(fps=FPS), (0, 80))[2][-1] == "take.glb"
    assert rows(PlyOutput(fps=FPS, avatars=(2,)), (30, 60)) == [
        [*whole[2][:4], "30", "49", "20", "1.2", "athletic", ""]
    ]
    assert rows(BvhOutput(fps=FPS, avatars=(2,)), (0, 20)) == [[*whole[2][:4], "", "", "0", "1.2", "athletic", ""]]


def test_an_avatar_whose_file_would_be_the_list_is_refused(sampler: PoseSampler, tmp_path: Path) -> None:
    cast = replace(sampler.take.cast, names=np.array(["red_0", "avatars", "late_0"]))
    named = PoseSampler(replace(sampler.take, cast=cast), sampler.policies)
    with pytest.raises(
        OutputError, match=r"avatars\.csv: is the list of avatars, and an avatar has a file of this name"
    ):
        write_posed(named, tmp_path, [CsvOutput(fps=FPS)])
    assert len(write_posed(named, tmp_path, [BvhOutput(fps=FPS)])["bvh"]) == 4


def test_whole_files_cover_all_frames_and_hold_the_pose_of_absent_avatars(sampler, tmp_path: Path, monkeypatch) -> None:
    def read(name: str, **keys: bool) -> Clip:
        (tmp_path / name).mkdir()
        sink = BvhOutput(fps=FPS, avatars=(2,), **keys).sink(sampler, tmp_path / name)
        return to_clip(read_bvh(stream_poses(sampler, FPS, [sink])[0][0]))

    part, whole = read("part"), read("whole", whole=True)
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 7)
    monkeypatch.setattr("crowdsim.outputs.bvh._ROWS", 3)
    assert (tmp_path / "whole" / "late_0.bvh").read_bytes() == Path(read("again", whole=True).source).read_bytes()
    assert (part.frame_count, whole.frame_count) == (30, 80)
    expected = [0] * 20 + list(range(30)) + [29] * 30
    np.testing.assert_allclose(whole.root_positions, part.root_positions[expected], atol=1e-7)
    np.testing.assert_allclose(whole.rotations, part.rotations[expected], atol=1e-6)


def test_a_rest_pose_comes_first_where_it_is_asked_for(sampler: PoseSampler, tmp_path: Path) -> None:
    for whole in (False, True):
        output = BvhOutput(fps=FPS, frames=(10, 40), avatars=(0, 2), whole=whole)
        posed = output.model_copy(update={"t_pose": True})
        (tmp_path / f"{whole}").mkdir()
        (tmp_path / f"{whole} posed").mkdir()
        plain = stream_poses(sampler, FPS, [output.sink(sampler, tmp_path / f"{whole}")])[0]
        first = stream_poses(sampler, FPS, [posed.sink(sampler, tmp_path / f"{whole} posed")])[0]
        for one, other in zip(plain, first, strict=True):
            without, clip = to_clip(read_bvh(one)), to_clip(read_bvh(other))
            assert clip.frame_count == without.frame_count + 1
            np.testing.assert_array_equal(clip.root_positions[1:], without.root_positions)
            np.testing.assert_array_equal(clip.rotations[0], np.tile([1.0, 0.0, 0.0, 0.0], (len(clip.rotations[0]), 1)))
            assert clip.root_positions[0, [0, 2]].tolist() == [0.0, 0.0]
            # It stands as high as it does in its motion, but for bent knees [cm].
            assert 0.0 < clip.root_positions[0, 1] - np.median(without.root_positions[:, 1]) < 15.0


def test_a_range_has_the_bytes_of_the_whole(sampler: PoseSampler, tmp_path: Path) -> None:
    (whole,), (part,) = (
        [to_clip(read_bvh(path)) for path in export_bvh(sampler, tmp_path / name, FPS, frames, [1])]
        for name, frames in (("whole", None), ("part", (40, 60)))
    )
    assert part.frame_count == 20
    np.testing.assert_allclose(part.root_positions, whole.root_positions[40:60], atol=1e-7)
    # A range may begin with other angles that mean the same rotations.
    cosines = np.abs(np.sum(part.rotations * whole.rotations[40:60], axis=-1))
    assert cosines.min() > 1 - 1e-12
    clouds = [
        export_clouds(sampler, tmp_path / name, "ply", FPS, 20, frames, 1)
        for name, frames in (("all", None), ("some", (40, 60)))
    ]
    assert [path.read_bytes() for path in clouds[0][40:60]] == [path.read_bytes() for path in clouds[1]]


def test_a_failure_leaves_no_half_written_file(sampler: PoseSampler, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 33)

    def fail(kind: str, done: int, total: int) -> None:
        if done:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        export_bvh(sampler, tmp_path, FPS, progress=fail)
    assert list(tmp_path.iterdir()) == []


def test_the_command_exports_what_is_asked_for(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml") == 0
    run_folder = workplace / "output" / "four"
    capsys.readouterr()
    assert crowdsim("export", run_folder, "--bvh", "--ply", "--avatars", "1-2", "--frames", "10:20", "--fps", "20",
                    "--every", "3", "--points", "10", "--out", workplace / "x") == 0  # fmt: skip
    assert sorted(path.name for path in (workplace / "x" / "ply").iterdir()) == [
        *(f"0000{frame}.ply" for frame in (10, 13, 16, 19)), "avatars.csv",
    ]  # fmt: skip
    text = (workplace / "x" / "bvh" / "red_1.bvh").read_text()
    assert "Frames: 10\nFrame Time: 0.0500000000\n" in text
    assert sorted(path.name for path in (workplace / "x" / "bvh").iterdir()) == [
        "avatars.csv", "blue_0.bvh", "red_1.bvh",
    ]  # fmt: skip
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith(f"{workplace / 'x' / 'bvh'}: 2 files and avatars.csv, ")
    with (workplace / "x" / "bvh" / "avatars.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [
            ["number", "name", "team", "type", "first_frame", "last_frame", "frames", "scale", "build", "file"],
            ["1", "red_1", "red", "boxer", "10", "19", "10", "1", "athletic", "red_1.bvh"],
            ["2", "blue_0", "blue", "boxer", "10", "19", "10", "1", "athletic", "blue_0.bvh"],
        ]
    assert crowdsim("export", run_folder, "--bvh") == 0
    assert crowdsim("verify", run_folder) == 0
    assert crowdsim("export", run_folder, "--bvh", "--avatars", "3") == 0
    assert sorted(path.name for path in (run_folder / "bvh").iterdir()) == ["avatars.csv", "blue_1.bvh"]
    assert crowdsim("verify", run_folder) == 0
    capsys.readouterr()
    assert crowdsim("export", run_folder) == 2
    assert capsys.readouterr().err == "nothing to export, expected --bvh, --ply, --pcd, --clips, --csv or --glb\n"
    assert crowdsim("export", run_folder, "--bvh", "--avatars", "2-4") == 2
    assert capsys.readouterr().err == "avatars '2-4': there is no avatar 4, expected 0 to 3, or its name\n"
    assert crowdsim("export", workplace, "--bvh") == 2
    assert capsys.readouterr().err == f"{workplace}: no take here; expected take.zarr\n"


def test_avatars_of_other_builds_have_skeletons_of_these_builds(sampler: PoseSampler, tmp_path: Path) -> None:
    small, large = (read_bvh(path) for path in export_bvh(sampler, tmp_path, FPS, avatars=[0, 2]))
    roles, sizes = sampler.policies[0].database.body.roles, np.full((small.joint_count, 1), 1.2)
    for role, factor in {"knee": 1.1, "foot": 1.1, "elbow": 0.9, "hand": 0.9}.items():
        sizes[[roles["left_" + role], roles["right_" + role]]] *= factor
    np.testing.assert_allclose(large.offsets[1:], (small.offsets * sizes)[1:], rtol=1e-5, atol=1e-6)
    assert replace(small, path="").joint_count == large.joint_count

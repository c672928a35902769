"""What avatars carry: keys and findings, capsules of props, takes, and where joints put them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import crowdsim, write_scene

import crowdsim as package
from crowdsim.crowd.attachments import (
    WOOD,
    _box_capsules,
    attachment_findings,
    attachment_warnings,
    shield_radii,
)
from crowdsim.crowd.cast import Cast
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.kernels.layout import BLOCKED
from crowdsim.crowd.meshes import MeshError, face_rods, read_obj
from crowdsim.crowd.props import PROP
from crowdsim.crowd.simulation import crowd_model
from crowdsim.errors import TakeError
from crowdsim.export.pointcloud import CloudSink
from crowdsim.motion import quaternion
from crowdsim.poses.attachments import check_attachments, place_attachments
from crowdsim.poses.guards import Guard, guard_points
from crowdsim.poses.sampler import PoseSampler

STICK = {
    "kind": "capsules",
    "joint": "right_hand",
    "capsules": [{"start": [-0.07, 0.0, -0.1], "end": [-0.07, 0.0, 0.6], "radius": 0.016}],
}
TETRAHEDRON = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 2 3\nf 1/1 2/2 4/3\nf 1 3 4\nf -3 -2 -1\n"


def types(*attachments: dict) -> dict:
    return {"boxer": {"policy": "tiny", "attachments": list(attachments)}}


def validated(folder: Path, capsys: pytest.CaptureFixture[str], *attachments: dict) -> str:
    file = write_scene(folder / "held.yaml", types=types(*attachments))
    assert crowdsim("validate", file) == 2
    said = capsys.readouterr()
    return said.out + said.err


@pytest.fixture
def folder(workplace: Path) -> Path:
    return workplace


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"joint": "right_hnd"}, "joint: 'right_hnd', which the skeleton of policy 'tiny' lacks"),
        ({"joint": "right_hnd"}, " (did you mean 'right_hand'?); expected a role, "),
        ({"joint": "tail"}, "expected a role, pelvis, spine, chest, neck, head, left_shoulder"),
        ({"capsules": [{"start": [0, 0, 0], "end": [0, 0, 1], "radius": 0}]}, "radius: is 0, expected a number"),
        ({"capsules": [{"start": [0, 0, 0], "end": [0, 0, 1], "radius": 1e-50}]},
         "radius: is 1e-50, expected a number"),
        ({"capsules": []}, "capsules: "),
        ({**STICK, "capsules": [{"start": [0, 0, 0], "end": [10, 10, 10], "radius": 1}], "offset": [0, 0, 10],
          "rotation": [0, -45, 0]},
         "capsules: leads to 24.1 m from the joint along an axis, expected at most 20 m"),
        ({"kind": "mesh", "file": "bat.obj", "scale": 1000}, "scale: leads to 100 m from the joint"),
        ({"kind": "mesh", "file": "huge.obj"}, "file: leads to "),
        ({"kind": "mesh", "file": "far.obj"}, "file: leads to 1e+39 m from the joint"),
        ({"kind": "mesh", "file": "flat.obj"}, "file: 'flat.obj' has no area"),
        ({"kind": "mesh", "file": "long.obj"}, "file: 'long.obj' has 5,000,000 bytes, expected at most 4,194,304"),
        ({"kind": "box", "size": [0.1, 0, 0.2]}, "size[1]: is 0, expected a number"),
        ({"kind": "box", "size": [10, 10, 1e-7]}, "size[2]: is 1e-07, expected a number"),
        ({"kind": "mesh", "file": "none.obj"}, "holds no such file, expected"),
        ({"kind": "mesh", "file": "../bat.obj"}, "expected a path inside the scenario's folder"),
        ({"kind": "mesh", "file": "bat.stl"}, "expected a file that ends in .obj"),
        ({"kind": "mesh", "file": "bad.obj"}, "file: 'bad.obj' line 2: is no vertex or face of an OBJ file: 'v 0 x'"),
        ({"kind": "mesh", "file": "empty.obj"}, "file: 'empty.obj' holds no faces, expected an OBJ file"),
        ({"colour": "brown"}, "colour: "),
        ({"joint": "head", "strikes": True}, "strikes: is true, but 'head' is no hand; expected a hand"),
        ({"strikes": True}, "strikes: is true, but policy 'tiny' has learned strikes without it, so that it would keep "
         "a wrong distance; expected a policy that is trained with it, by 'strikes: {limbs: [props], props: [{hand: "
         "right, point: [-0.07, 0, 0.6], radius: 0.016}]}' in its recipe, or 'strikes: false' here"),
        ({"joint": "head", "blocks": True}, "blocks: is true at 'head', which holds no shield, expected a hand"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_found_with_its_position(folder, capsys, changes, words):
    (folder / "bad.obj").write_text("v 0 0 0\nv 0 x\n", encoding="utf-8")
    (folder / "empty.obj").write_text("# nothing\n", encoding="utf-8")
    (folder / "bat.obj").write_text(TETRAHEDRON, encoding="utf-8")
    (folder / "huge.obj").write_text(TETRAHEDRON.replace("0.1", "1e300"), encoding="utf-8")
    (folder / "far.obj").write_text(TETRAHEDRON.replace("0.1", "1e39"), encoding="utf-8")
    (folder / "flat.obj").write_text("v 0 0 0\nv 0 0 1\nv 0 0 2\nf 1 2 3\n", encoding="utf-8")
    with (folder / "long.obj").open("wb") as long:
        long.truncate(5_000_000)
    one = {**STICK, **changes}
    if one["kind"] != "capsules":
        del one["capsules"]
    found = validated(folder, capsys, one)
    assert words in found
    assert "held.yaml:" in found
    assert "types.boxer.attachments[0]" in found


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "attachments[0]: reaches 0.60 m out of the right fist and is only shown, but policy 'tiny' has learned"),
        ({"rotation": [0, 90, 0]}, "point: [0.6, 0, 0.07]"),
        ({"strikes": False}, None),
        ({"blocks": True}, None),
        ({"joint": "head"}, None),
        ({"capsules": [{"start": [-0.07, 0.0, -0.1], "end": [-0.07, 0.0, 0.1], "radius": 0.05}]}, None),
    ],
)
def test_a_prop_that_looks_as_if_it_strikes_and_does_not_is_warned_of(folder, capsys, changes, expected):
    file = write_scene(folder / "held.yaml", types=types({**STICK, **changes}))
    assert crowdsim("validate", file) == 0
    said = capsys.readouterr()
    assert ("only shown" in said.out + said.err) == (expected is not None)
    assert expected is None or expected in said.out + said.err
    assert crowdsim("run", file, "--out", "held", "--threads", "1", "--frames", "4") == 0
    assert ("only shown" in capsys.readouterr().err) == (expected is not None)


@pytest.mark.parametrize(
    ("attachments", "refused", "warned"),
    [
        ([{**STICK, "capsules": [{"start": [0, 0, 0], "end": [-0.39, 0, 0.45], "radius": 0.016}]}], None, None),
        ([STICK], "which ends at [-0.07, 0, 0.6], so that it would keep a wrong distance", "reaches "),
        (
            [{**STICK, "joint": "left_hand"}],
            "has learned strikes without it",
            "attachments: hold nothing in the right hand that ends at [-0.39, 0, 0.45]",
        ),
        (
            [{**STICK, "capsules": [{"start": [0, 0, 0], "end": [-0.07, 0, 0.1], "radius": 0.01}]}],
            "which ends at [-0.07, 0, 0.1], so that it would keep a wrong distance",
            "attachments: hold nothing in the right hand that ends at [-0.39, 0, 0.45]",
        ),
        ([{**STICK, "blocks": True}], "which ends at", "attachments: hold nothing in the right hand that ends at"),
    ],
)
def test_a_prop_is_compared_with_the_one_that_a_policy_has_learned(folder, attachments, refused, warned):
    scenario = package.load_scenario(write_scene(folder / "held.yaml", types=types(*attachments)))
    tiny = package.load_policies(scenario)[0]
    database = tiny.database
    prop = {"joint": database.body.roles["right_hand"], "side": 1, "offset": [-0.39, 0, 0.45], "radius": 0.016}
    armed = replace(tiny, database=replace(database, body=replace(database.body, props=(prop,))))
    found = [str(one) for one in attachment_warnings(scenario, {"tiny": armed})]
    assert bool(found) == (warned is not None)
    assert warned is None or any(warned in one for one in found)
    told = [{**one, "strikes": True} for one in attachments]
    scenario = package.load_scenario(write_scene(folder / "held.yaml", types=types(*told)))
    found = [str(one) for one in attachment_findings(scenario, {"tiny": armed})]
    assert bool(found) == (refused is not None)
    assert refused is None or (refused in found[0] and "types.boxer.attachments[0].strikes" in found[0])


def test_an_obj_file_is_read_and_its_faces_are_covered_by_rods(tmp_path):
    (tmp_path / "bat.obj").write_text(TETRAHEDRON, encoding="utf-8")
    vertices, triangles = read_obj(tmp_path / "bat.obj")
    assert triangles.tolist() == [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]
    rods, faces = face_rods(vertices[triangles])
    assert set(faces) == set(range(4))
    for corners in vertices[triangles]:
        for weights in ([0.98, 0.01, 0.01], [0.3, 0.3, 0.4], [0.1, 0.8, 0.1]):
            point = np.array(weights) @ corners
            axis = rods[:, 3:6] - rods[:, :3]
            share = np.sum((point - rods[:, :3]) * axis, axis=1) / np.maximum(np.sum(axis * axis, axis=1), 1e-12)
            gaps = np.linalg.norm(point - rods[:, :3] - np.clip(share, 0, 1)[:, None] * axis, axis=1) - rods[:, 6]
            assert gaps.min() < 0.004


def test_a_mesh_of_too_many_triangles_is_refused(tmp_path):
    (tmp_path / "big.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "f 1 2 3\n" * 501, encoding="utf-8")
    with pytest.raises(MeshError, match="has 501 triangles, expected at most 500"):
        read_obj(tmp_path / "big.obj")


@pytest.mark.parametrize("size", [(0.34, 0.03, 0.4), (0.1, 0.2, 0.3), (0.5, 0.02, 0.02)])
def test_capsules_of_a_box_are_as_large_as_it(size):
    ends = np.array([point for start, end, _ in _box_capsules(np.array(size)) for point in (start, end)])
    radius = _box_capsules(np.array(size))[0][2]
    np.testing.assert_allclose(np.ptp(ends, axis=0) + 2 * radius, size, atol=1e-9)


def test_a_thin_plate_has_no_more_capsules_than_can_be_drawn():
    capsules = _box_capsules(np.array([10.0, 10.0, 0.001]))
    assert len(capsules) < 2000
    assert {radius for _, _, radius in capsules} == {0.004}


def cast_of(props: np.ndarray) -> Cast:
    return Cast(
        names=np.array(["a", "b", "c"]), types=np.array([1, 0, 1], np.int16), teams=np.zeros(3, np.int16),
        policies=np.zeros(3, np.int16), scales=np.array([1.0, 1.0, 2.0], np.float32), speeds=np.ones(3, np.float32),
        type_names=("bare", "armed"), team_names=("t",), policy_names=("p",), colours=np.full((2, 3), np.nan),
        attachments=props,
    )  # fmt: skip


def test_props_follow_their_joints_and_grow_with_bodies():
    props = np.array(
        [(1, 1, (0, 0, 0), (0, 0, 0.5), 0.02, WOOD, False), (1, 0, (0.1, 0, 0), (0.2, 0, 0), 0.01, WOOD, False)], PROP
    )
    positions = np.array([[[0, 1, 0], [0, 2, 0]]] * 3, np.float32)
    turn = quaternion.from_rotation_vector(np.array([0.0, np.pi / 2, 0.0])).astype(np.float32)
    rotations = np.tile(np.array([1, 0, 0, 0], np.float32), (3, 2, 1))
    rotations[:, 1] = turn
    held = place_attachments(cast_of(props), np.arange(3), positions, rotations)
    assert held.avatars.tolist() == [0, 0, 2, 2]
    np.testing.assert_allclose(held.starts[0], [0, 2, 0], atol=1e-6)
    np.testing.assert_allclose(held.ends[0], [0.5, 2, 0], atol=1e-6)
    np.testing.assert_allclose(held.ends[2], [1.0, 2, 0], atol=1e-6)
    np.testing.assert_allclose(held.radii, [0.02, 0.01, 0.04, 0.02])
    positions[2] = np.nan
    assert place_attachments(cast_of(props), np.arange(3), positions, rotations).avatars.tolist() == [0, 0]


def test_a_prop_at_a_joint_that_is_not_there_is_refused():
    props = np.array([(kind, 7, (0, 0, 0), (0, 0, 0.5), 0.02, WOOD, False) for kind in (0, 1)], PROP)
    wide, narrow = (
        SimpleNamespace(database=SimpleNamespace(skeleton=SimpleNamespace(names=("joint",) * count)))
        for count in (8, 7)
    )
    cast = replace(cast_of(props), policies=np.array([1, 0, 0], np.int16), policy_names=("narrow", "wide"))
    take = SimpleNamespace(cast=cast, scenario="held")
    check_attachments(take, [wide, wide])
    with pytest.raises(TakeError, match=r"^take 'held': attachments\[0\].joint is 7, expected one below 7, .*'bare'"):
        check_attachments(take, [narrow, wide])
    with pytest.raises(TakeError, match=r"attachments\[1\].joint is 7, .*'armed'"):
        check_attachments(take, [wide, narrow])


def test_poses_of_a_take_with_a_prop_at_a_joint_that_is_not_there_are_refused(runs):
    run = package.open_run(runs[1])
    props = run.cast.attachments.copy()
    props["joint"][0] = 9999
    with pytest.raises(TakeError, match=r"attachments\[0\].joint is 9999"):
        PoseSampler(replace(run, cast=replace(run.cast, attachments=props)), run.policies)
    faces = run.cast.faces.copy()
    faces["joint"][1] = 9999
    with pytest.raises(TakeError, match=r"faces\[1\].joint is 9999"):
        PoseSampler(replace(run, cast=replace(run.cast, faces=faces)), run.policies)


@pytest.fixture
def runs(folder: Path) -> tuple[Path, Path]:
    """Runs without and with a stick in right hands."""
    bare = write_scene(folder / "bare.yaml", name="bare")
    (folder / "bat.obj").write_text(TETRAHEDRON, encoding="utf-8")
    mesh = {"kind": "mesh", "joint": "Head", "file": "bat.obj", "offset": [0, 0.2, 0], "rotation": [0, 90, 0]}
    held = write_scene(folder / "held.yaml", name="bare", types=types(STICK, mesh))
    for file in (bare, held):
        assert crowdsim("run", file, "--out", file.stem, "--threads", "1") == 0
    return folder / "bare", folder / "held"


def test_runs_record_what_avatars_carry_and_show_it(runs, capsys):
    bare, held = (package.open_run(folder) for folder in runs)
    assert len(bare.cast.attachments) == 0
    assert "attachments" not in (runs[0] / "take.zarr" / ".zattrs").read_text(encoding="utf-8")
    props = held.cast.attachments
    names = held.policies[0].database.skeleton.names
    assert {names[joint] for joint in props["joint"]} == {"RightHand"}
    assert {names[joint] for joint in held.cast.faces["joint"]} == {"Head"}
    # The tetrahedron is turned by 90 degrees about y, and 0.2 m up.
    corners = np.unique(held.cast.faces["corners"].reshape(-1, 3).round(5), axis=0)
    expected = [[0.0, 0.2, -0.1], [0.0, 0.2, 0.0], [0.0, 0.3, 0.0], [0.1, 0.2, 0.0]]
    np.testing.assert_allclose(corners, expected, atol=1e-6)
    assert len(held.cast.held) == len(props) + len(face_rods(held.cast.faces["corners"].astype(float))[0])
    np.testing.assert_allclose(props["end"][0], [-0.07, 0.0, 0.6], atol=1e-6)
    for name in ("action", "x", "heading"):
        np.testing.assert_array_equal(getattr(bare, name)[:], getattr(held, name)[:])
    pictures = []
    for run in runs:
        capsys.readouterr()
        assert crowdsim("render", run, "--png", "--frames", "0:1", "--size", "160x90", "--out", f"{run}_pics") == 0
        picture = next(Path(f"{run}_pics").rglob("*.png"))
        pictures.append(picture.read_bytes())
    assert pictures[0] != pictures[1]
    # A run that is read again, from its resolved scenario, is the same.
    assert crowdsim("verify", runs[1]) == 0
    assert (runs[1] / "scenario.resolved.yaml").read_text(encoding="utf-8").count("right_hand") == 1


@pytest.mark.parametrize("surface", ["capsules", "body"])
def test_clouds_have_as_many_points_some_of_them_on_props(runs, surface):
    clouds = {}
    for folder in runs:
        run = package.open_run(folder)
        sink = CloudSink(run.sampler, folder, "ply", 60.0, 2000, surface=surface)
        clouds[folder.name] = sink.build(12)
    bare, held = clouds["bare"], clouds["held"]
    assert len(bare.values) == len(held.values) == 4 * 2000
    changed = np.flatnonzero((bare.values[:, :3] != held.values[:, :3]).any(axis=1))
    assert 40 < len(changed) < 0.25 * len(held.values)
    run = package.open_run(runs[1])
    for poses in run.sampler.sample(12, 13, 60.0):
        positions, rotations = poses.joints()
        props = place_attachments(run.cast, poses.avatars, positions[0], rotations[0])
        stick = props.radii > 0.0155
        for avatar, start, end, radius in zip(*(np.asarray(part)[stick] for part in props[:4]), strict=True):
            mine = changed[held.labels[changed, 0] == avatar]
            points = held.values[mine, :3].astype(float)
            axis = end - start
            share = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
            gaps = np.abs(np.linalg.norm(points - start - share[:, None] * axis, axis=1) - radius)
            assert (gaps < 1e-4).sum() > 10


def test_a_cloud_of_a_point_an_avatar_has_it_on_the_body(runs):
    bare, held = (
        CloudSink(package.open_run(folder).sampler, folder, "ply", 60.0, 1).build(12).values[:, :3] for folder in runs
    )
    np.testing.assert_array_equal(bare, held)


SHIELD = {"kind": "box", "joint": "left_elbow", "size": [0.5, 0.04, 0.8], "offset": [0.15, 0, 0], "blocks": True}


def test_shields_are_as_wide_as_the_middle_one_of_their_sizes(folder):
    file = write_scene(folder / "shield.yaml", types=types(SHIELD, {**STICK, "blocks": True}))
    scenario = package.load_scenario(file)
    policies = package.load_policies(scenario)
    crowd = draw_crowd(scenario, policies)
    body = policies[0].database.body
    np.testing.assert_allclose(shield_radii(crowd.cast, np.arange(4), body), [[0.25, 0.0, 0.0, 0.016]] * 4, atol=1e-6)
    assert crowd_model(crowd).shields.shape == (4, 4)
    bare = draw_crowd(package.load_scenario(write_scene(folder / "bare.yaml")), policies)
    assert crowd_model(bare).shields.shape == (0, 4)
    assert not shield_radii(bare.cast, np.arange(4), body).any()


def test_avatars_with_shields_block_more(folder):
    blocked = {}
    for name, held in (
        ("bare", []),
        ("shields", [SHIELD, {**SHIELD, "joint": "right_elbow", "offset": [-0.15, 0, 0]}]),
    ):
        file = write_scene(folder / f"{name}.yaml", name=name, duration=300, types=types(*held))
        assert crowdsim("run", file, "--out", name, "--threads", "1") == 0
        run = package.open_run(name)
        blocked[name] = np.mean(np.asarray(run.events.outcome)[np.asarray(run.events.victim) >= 0] == BLOCKED)
    assert blocked["shields"] > blocked["bare"] + 0.1


def test_a_strike_that_a_shield_blocks_stays_outside_of_it():
    elbows, fists = np.array([[[0.2, 1.2, 0.2], [-0.2, 1.2, 0.2]]]), np.array([[[0.2, 1.45, 0.3], [-0.2, 1.45, 0.3]]])
    point, origin = np.array([[0.2, 1.35, 0.5]]), np.array([[0.1, 1.4, 1.2]])
    found = {}
    for name, shield in (("bare", 0.0), ("shield", np.array([[0.25, 0, 0, 0]]))):
        guard = Guard(elbows, fists, np.array([0.04]), np.array([0.06]), shield)
        found[name] = guard_points(point, origin, guard)[0]
    assert found["shield"][2] > found["bare"][2] + 0.15

"""Skins: closed, bound, dressed, and near the body that control knows."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from crowdsim.body import skin as skins
from crowdsim.body import store
from crowdsim.body.anatomy import GIRTHS, KINDS, Build
from crowdsim.body.binding import bind
from crowdsim.body.field import Shapes, evaluate
from crowdsim.body.meshing import cut, largest_piece, mesh_edges, relax, surface_nets, thicken, thin, unpinched
from crowdsim.body.palette import avatar_paints, skin_paints
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.body.skin import Skin, build_skin, pose_skins
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body, build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.performer.session import perform


@pytest.fixture(scope="module")
def clip():
    return perform(12.0, 3)[0].clip


@pytest.fixture(scope="module")
def skeleton(clip) -> Skeleton:
    return clip.skeleton


@pytest.fixture(scope="module")
def body(skeleton: Skeleton) -> Body:
    return build_body(skeleton)


@pytest.fixture(scope="module")
def skin(skeleton: Skeleton, body: Body, clip) -> Skin:
    return build_skin(skeleton, body, Build(), clip.rotations[::30])


def posed(skin: Skin, skeleton: Skeleton, rotations: np.ndarray) -> np.ndarray:
    places, turned = forward_kinematics(skeleton, np.zeros((1, 3)), rotations[None])
    return pose_skins([skin], skin.matrices(places, turned, np.ones(1)))[0][0].astype(float)


@pytest.mark.parametrize(
    "build",
    [Build(), Build("female", "lean", "bare"), Build("male", "heavy", "bare"), Build("female", "heavy")],
    ids=str,
)
def test_each_build_is_closed_and_has_all_its_parts(skeleton: Skeleton, body: Body, build: Build) -> None:
    skin = build_skin(skeleton, body, build)
    mesh = trimesh.Trimesh(skin.vertices, skin.triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert 5000 <= len(skin.triangles) <= 10000
    assert 0.055 < mesh.volume < 0.12
    missing = {"gloves", "cuffs"} if build.hands == "bare" else set()
    missing |= {"top"} if build.sex == "male" else set()
    assert {SKIN_PARTS[part] for part in np.unique(skin.parts)} == set(SKIN_PARTS) - missing


def test_builds_differ_as_their_names_say(skeleton: Skeleton, body: Body) -> None:
    volumes = [
        trimesh.Trimesh(skin.vertices, skin.triangles, process=False).volume
        for skin in (build_skin(skeleton, body, Build("male", kind, "gloves")) for kind in KINDS)
    ]
    assert volumes == sorted(volumes)
    assert volumes[2] > 1.1 * volumes[0]
    assert tuple(GIRTHS) == KINDS
    for wrong in ({"sex": "men"}, {"kind": "heavi"}, {"hands": "fists"}):
        with pytest.raises(ValueError, match="expected"):
            Build(**wrong)


def test_weights_add_up_and_are_those_of_joints_nearby(skin: Skin) -> None:
    assert skin.weights.shape == skin.joints.shape == (len(skin.vertices), 4)
    np.testing.assert_allclose(skin.weights.sum(axis=1), 1.0, atol=1e-6)
    assert skin.weights.min() >= 0.0
    strongest = skin.joints[np.arange(len(skin.joints)), np.argmax(skin.weights, axis=1)]
    assert np.linalg.norm(skin.vertices - skin.positions[strongest], axis=1).max() < 0.5
    # Nothing beside the middle follows the leg of the other side.
    left = skin.vertices[:, 0] > 0.06
    right_leg = np.isin(skin.joints[left], [18, 19, 20, 21]) & (skin.weights[left] > 0.0)
    assert not right_leg.any()


def test_borders_of_parts_are_straight_lines(skin: Skin) -> None:
    band = np.unique(skin.triangles[skin.parts == SKIN_PARTS.index("band")])
    shorts = np.unique(skin.triangles[skin.parts == SKIN_PARTS.index("shorts")])
    border = skin.vertices[np.intersect1d(band, shorts)]
    assert len(border) > 20
    assert np.ptp(border[:, 1]) < 0.012


def test_types_in_turn_have_stripes_and_hems_on_their_shorts(skin: Skin) -> None:
    middles = {
        name: skin.vertices[skin.triangles[skin.parts == SKIN_PARTS.index(name)]].mean(axis=1)
        for name in ("shorts", "stripes", "hems", "crossings")
    }
    # Stripes are at the outer sides, hems at the lower ends of thighs that lean a little.
    sides = np.abs(middles["stripes"][:, 0])
    assert sides.min() > np.percentile(np.abs(middles["shorts"][:, 0]), 60)
    assert {*np.sign(middles["stripes"][:, 0])} == {*np.sign(middles["hems"][:, 0])} == {-1.0, 1.0}
    assert middles["hems"][:, 1].max() < np.percentile(middles["shorts"][:, 1], 40)
    # Where a stripe crosses a hem it is seen whichever of the two a type has.
    assert np.median(middles["crossings"][:, 1]) < np.percentile(middles["stripes"][:, 1], 10)
    dress = avatar_paints([0, 1])[1]
    names = ("shorts", "band", "stripes", "hems", "crossings")
    shorts, band, stripes, hems, crossings = map(SKIN_PARTS.index, names)
    for kind in range(8):
        paints = skin_paints(1, dress, kind)
        for part, has in ((stripes, kind % 4 in (1, 3)), (hems, kind % 4 in (2, 3)), (crossings, kind % 4 > 0)):
            np.testing.assert_array_equal(paints[part], paints[band if has else shorts])
    assert (skin_paints(1, dress)[stripes] != skin_paints(1, dress)[band]).any()


@pytest.mark.parametrize("coarseness", [1.0, 1.4])
def test_stripes_are_one_piece_at_each_side(skeleton: Skeleton, body: Body, clip, coarseness: float) -> None:
    skin = build_skin(skeleton, body, Build(), clip.rotations[::30], coarseness)
    striped = np.isin(skin.parts, [SKIN_PARTS.index(name) for name in ("stripes", "crossings")])
    mesh = trimesh.Trimesh(skin.vertices, skin.triangles[striped], process=False)
    pieces = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
    assert len(pieces) == 2
    sides = sorted(mesh.triangles_center[piece, 0].mean() for piece in pieces)
    assert sides[0] < -0.1 < 0.1 < sides[1]
    spread = [np.ptp(mesh.triangles_center[piece], axis=0) for piece in pieces]
    np.testing.assert_allclose(spread[0], spread[1], atol=0.02)


def test_the_same_body_is_built_once_and_the_same(
    skeleton: Skeleton, body: Body, skin: Skin, clip, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert build_skin(skeleton, body, Build(), clip.rotations[::30]) is skin
    built, build = [], skins._build
    monkeypatch.setattr(skins, "_build", lambda *arguments: built.append(arguments) or build(*arguments))
    monkeypatch.setattr(store, "cache_folder", lambda kind: tmp_path)

    def again() -> Skin:
        monkeypatch.setattr(skins, "_skins", {})
        return build_skin(skeleton, body, Build(), clip.rotations[::30])

    def assert_same(other: Skin) -> None:
        for name, values in vars(skin).items():
            np.testing.assert_array_equal(getattr(other, name), values)
            assert np.asarray(getattr(other, name)).dtype == np.asarray(values).dtype

    assert_same(again())
    assert_same(again())
    assert len(built) == 1
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    assert_same(again())
    assert_same(again())
    assert len(built) == 2
    monkeypatch.setattr(store, "cache_folder", lambda kind: None)
    assert_same(again())
    assert len(built) == 3


def test_the_oldest_skins_in_the_cache_are_removed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(store, "cache_folder", lambda kind: tmp_path)
    monkeypatch.setattr(store, "_MOST", 2)
    for number in range(3):
        kept = store.kept_arrays(bytes([number]), lambda: {"values": np.arange(3)})
        np.testing.assert_array_equal(kept["values"], [0, 1, 2])
        for path in tmp_path.iterdir():
            os.utime(path, (0, path.stat().st_mtime - 10))
    assert len(list(tmp_path.iterdir())) == 2
    for number, built in ((1, 0), (2, 0), (0, 1)):
        calls: list[int] = []
        store.kept_arrays(bytes([number]), lambda: calls.append(1) or {"values": np.arange(3)})  # noqa: B023
        assert len(calls) == built


def test_skinning_matches_its_plain_twin(skin: Skin, skeleton: Skeleton, clip) -> None:
    places, turned = forward_kinematics(skeleton, clip.root_positions[10:13], clip.rotations[10:13])
    scales = np.array([0.9, 1.0, 1.2])
    matrices = skin.matrices(places, turned, scales)
    vertices, normals = pose_skins([skin] * 3, matrices, threads=2)
    for row in range(3):
        blended = np.einsum("vk,vkij->vij", skin.weights, matrices[row][skin.joints])
        expected = np.einsum("vij,vj->vi", blended[:, :, :3], skin.vertices) + blended[:, :, 3]
        np.testing.assert_allclose(vertices[row], expected, atol=1e-5)
        turned_normals = np.einsum("vij,vj->vi", blended[:, :, :3], skin.normals)
        turned_normals /= np.linalg.norm(turned_normals, axis=1, keepdims=True)
        np.testing.assert_allclose(normals[row], turned_normals, atol=1e-4)


def test_fists_and_soles_of_skin_and_capsules_are_in_the_same_places(
    skin: Skin, skeleton: Skeleton, body: Body
) -> None:
    rest = np.zeros((skeleton.joint_count, 4))
    rest[:, 0] = 1.0
    vertices, places = posed(skin, skeleton, rest), forward_kinematics(skeleton, np.zeros((1, 3)), rest[None])[0][0]
    radius = body.capsule_radii[body.capsule_joints == body.roles["left_hand"]].max()
    for index, side in enumerate(("left", "right")):
        hand, foot = body.roles[f"{side}_hand"], body.roles[f"{side}_foot"]
        fist = places[hand] + body.fist_offsets[index]
        ahead = body.fist_offsets[index] / np.linalg.norm(body.fist_offsets[index])
        mine = vertices[np.linalg.norm(vertices - fist, axis=1) < 0.12]
        assert abs(((mine - fist) @ ahead).max() - radius) < 0.02
        sole = places[foot] + body.sole_offsets[index]
        near = vertices[np.linalg.norm(vertices - sole.mean(axis=0), axis=1) < 0.2]
        assert abs(near[:, 1].min() - sole[:, 1].min()) < 0.01


@pytest.mark.parametrize(("joint", "axis", "degrees"), [("left_elbow", [0, -1, 0], 135), ("left_knee", [1, 0, 0], 130)])
def test_elbows_and_knees_keep_their_volume_where_they_bend(
    skin: Skin, skeleton: Skeleton, body: Body, joint: str, axis: list[int], degrees: float
) -> None:
    def thickness(angle: float) -> float:
        rotations = np.zeros((skeleton.joint_count, 4))
        rotations[:, 0] = 1.0
        rotations[body.roles[joint]] = quaternion.from_rotation_vector(np.deg2rad(angle) * np.array(axis, float))
        vertices = posed(skin, skeleton, rotations)
        place = forward_kinematics(skeleton, np.zeros((1, 3)), rotations[None])[0][0][body.roles[joint]]
        near = skin.joints[np.arange(len(vertices)), np.argmax(skin.weights, axis=1)] == skin.helpers.tolist().index(
            body.roles[joint]
        ) + len(skin.parents)
        return float(np.linalg.norm(vertices[near] - place, axis=1).mean())

    assert thickness(degrees) > 0.8 * thickness(20.0)


def test_girth_and_lengths_shape_limbs_but_neither_head_nor_gloves(skin: Skin, body: Body) -> None:
    lengths = np.ones(len(skin.parents))
    legs = [body.roles[f"{side}_{role}"] for side in ("left", "right") for role in ("hip", "knee")]
    lengths[legs] = 1.1
    shaped = skin.shaped(1.2, lengths)
    assert skin.shaped(skin.girth, np.ones(len(lengths))) is skin
    strongest = skin.joints[np.arange(len(skin.joints)), np.argmax(skin.weights, axis=1)]
    for role, factor in (("chest", 1.2), ("head", 1.0), ("left_hand", 1.0), ("left_foot", 1.0)):
        joint = body.roles[role]
        mine = (strongest == joint) & (skin.weights.max(axis=1) > 0.999)
        assert mine.sum() > 10
        before, after = skin.vertices[mine] - skin.positions[joint], shaped.vertices[mine] - shaped.positions[joint]
        np.testing.assert_allclose(after[:, [0, 2]], factor * before[:, [0, 2]], atol=1e-4)
    knee, foot = body.roles["left_knee"], body.roles["left_foot"]
    shanks = [np.linalg.norm(one.positions[foot] - one.positions[knee]) for one in (skin, shaped)]
    assert shanks[1] == pytest.approx(1.1 * shanks[0])


def test_the_binding_pose_is_in_the_middle_of_what_fighters_do(skeleton: Skeleton, body: Body, clip) -> None:
    binding = bind(skeleton, body, clip.rotations[::30])
    for side in ("left", "right"):
        arm, fore = (binding.segments[f"{side}_{name}"].axes[0] for name in ("upper_arm", "forearm"))
        assert np.rad2deg(np.arccos(arm @ fore)) == pytest.approx(45.0, abs=0.5)
        foot = binding.segments[f"{side}_foot"]
        np.testing.assert_allclose(foot.axes[1], [0, 1, 0], atol=1e-9)
    left, right = (binding.segments[f"{side}_hand"].start for side in ("left", "right"))
    np.testing.assert_allclose(left * [-1, 1, 1], right, atol=1e-3)


def ball(radius: float = 0.1) -> Shapes:
    one = np.zeros((1, 3))
    return Shapes(
        one, one, np.full((1, 2), radius), np.eye(3)[None], np.full(1, 0.01), np.ones(1), np.zeros(1, np.int64)
    )


def test_meshes_of_a_ball_lie_on_it_and_stay_closed() -> None:
    shapes = ball()
    axis = np.linspace(-0.13, 0.13, 27)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    values = (0.1 - np.linalg.norm(points, axis=-1)).astype(np.float32)
    vertices, triangles = surface_nets(values, np.full(3, -0.13), 0.01)
    vertices = relax(shapes, vertices, triangles, 2)
    many = len(triangles)
    vertices, triangles = thin(vertices, triangles, lambda points: np.full(len(points), 0.025))
    vertices = relax(shapes, vertices, triangles, 3)
    assert len(triangles) < 0.4 * many
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.1, atol=1e-4)
    lines = cut(vertices, triangles, np.arange(len(triangles)), vertices[:, 1] - 0.03)
    vertices, triangles, numbers, above = lines
    assert len(numbers) == len(triangles)
    assert vertices[triangles[above]][..., 1].min() > 0.03 - 1e-3
    normals = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    raised, closed, owners, line = thicken(vertices, triangles, unpinched(triangles, above), 0.01 * normals)
    mesh = trimesh.Trimesh(raised, closed, process=False)
    assert mesh.is_watertight
    assert mesh.volume > trimesh.Trimesh(vertices, triangles, process=False).volume
    assert len(owners) == 2 * len(line)
    edges = mesh_edges(closed)
    assert len(raised) - len(edges) + len(closed) == 2


def test_bubbles_and_crumbs_are_no_part_of_a_mesh() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(-8, 9)] * 3, indexing="ij"), axis=-1)
    ball = 6.5 - np.linalg.norm(grid, axis=-1)
    expected = surface_nets(ball, np.zeros(3), 1.0)
    spoiled = ball.copy()
    spoiled[8, 8, 8], spoiled[1, 1, 1] = -1.0, 1.0
    vertices, triangles = surface_nets(spoiled, np.zeros(3), 1.0)
    assert trimesh.Trimesh(vertices, triangles, process=False).body_count == 3
    for found, own in zip(largest_piece(vertices, triangles), expected, strict=True):
        assert len(found) == len(own)
    mesh = trimesh.Trimesh(*largest_piece(vertices, triangles), process=False)
    assert mesh.is_watertight
    assert mesh.body_count == 1
    for found, own in zip(largest_piece(*expected), expected, strict=True):
        np.testing.assert_array_equal(found, own)


def test_distances_of_a_field_are_those_of_its_shape() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    points *= (0.1 + np.linspace(-0.01, 0.01, 50))[:, None] / np.linalg.norm(points, axis=1, keepdims=True)
    gap, normal = evaluate(ball(), points)
    np.testing.assert_allclose(gap, np.linalg.norm(points, axis=1) - 0.1, atol=1e-4)
    np.testing.assert_allclose(normal, points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-6)

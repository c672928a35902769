"""A glTF file through another reader, beside the poses and our own skinning."""

import io
import json
import shutil
import struct
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError
from scenes import write_scene
from test_exports import COMING

from crowdsim.body.anatomy import Build
from crowdsim.body.looks import usual_build
from crowdsim.body.palette import avatar_paints, skin_paints
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.body.skin import build_skin, pose_skins
from crowdsim.body.textures import TEXTURES
from crowdsim.crowd.attachments import WOOD
from crowdsim.crowd.props import FACE, PROP
from crowdsim.errors import CrowdsimError, OutputError
from crowdsim.export import gltf, stream
from crowdsim.export.gltf import sparse_keys, write_gltf
from crowdsim.export.posed import write_posed
from crowdsim.export.prop_meshes import capsule_mesh
from crowdsim.outputs.bvh import BvhOutput
from crowdsim.outputs.glb import GlbOutput
from crowdsim.places.arrays import pack_parts
from crowdsim.places.description import DiscObstacle, WallObstacle
from crowdsim.poses.attachments import place_attachments
from crowdsim.poses.sampler import PoseSampler
from crowdsim.preparation.prepare import load_policies
from crowdsim.render.camera import build_track, resolve_camera
from crowdsim.render.take_source import TakeSource
from crowdsim.runs.runner import run
from crowdsim.scenario.camera_files import load_cameras
from crowdsim.scenario.scenario import load_scenario

pygltflib = pytest.importorskip("pygltflib")
FPS = Fraction(24000, 1001)
DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@pytest.fixture(scope="module")
def sampler(tiny_policy: Path, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("take")
    types = {
        "boxer": {"policy": "tiny"},
        "large": {"policy": "tiny", "scale": 1.2, "legs": 1.1, "arms": 0.9, "girth": 1.2},
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tiny_policy.parent.parent)
        scenario = load_scenario(write_scene(folder / "coming.yaml", **{**COMING, "types": types}))
        policies = load_policies(scenario)
    return PoseSampler(run(scenario, policies), policies)


class Scene:
    """A file as pygltflib reads it, played by the rules of the specification."""

    def __init__(self, path: Path) -> None:
        self.gltf = pygltflib.GLTF2().load(str(path))
        self.blob = self.gltf.binary_blob()
        self.parents = {child: node for node, item in enumerate(self.gltf.nodes) for child in item.children}
        self.names = [node.name for node in self.gltf.nodes]

    def values(self, number: int) -> np.ndarray:
        accessor = self.gltf.accessors[number]
        view = self.gltf.bufferViews[accessor.bufferView]
        width, dtype = WIDTHS[accessor.type], np.dtype(DTYPES[accessor.componentType])
        found = np.frombuffer(self.blob, dtype, accessor.count * width, view.byteOffset + (accessor.byteOffset or 0))
        found = found.reshape(-1, width)
        return np.maximum(found / np.iinfo(dtype).max, -1.0) if accessor.normalized else found

    def at(self, time: float) -> np.ndarray:
        """Matrices of all nodes in the world at a time. Shape (n, 4, 4)."""
        states = [{"translation": node.translation or [0, 0, 0], "rotation": node.rotation or [0, 0, 0, 1],
                   "scale": node.scale or [1, 1, 1]} for node in self.gltf.nodes]  # fmt: skip
        (animation,) = self.gltf.animations
        for channel in animation.channels:
            sampler = animation.samplers[channel.sampler]
            times = self.values(sampler.input)[:, 0]
            row = max(int(np.searchsorted(times, np.float32(time), side="right")) - 1, 0)
            value, *after = self.values(sampler.output)[row : row + 2].astype(float)
            if after and sampler.interpolation != "STEP":
                value = value + (np.float32(time) - times[row]) / (times[row + 1] - times[row]) * (after[0] - value)
            states[channel.target.node][channel.target.path] = value
        found: dict[int, np.ndarray] = {}

        def world(node: int) -> np.ndarray:
            if node not in found:
                state, matrix = states[node], np.eye(4)
                x, y, z, w = np.asarray(state["rotation"]) / np.linalg.norm(state["rotation"])
                matrix[:3, :3] = np.array([
                    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
                ]) * np.asarray(state["scale"])  # fmt: skip
                matrix[:3, 3] = state["translation"]
                found[node] = world(self.parents[node]) @ matrix if node in self.parents else matrix
            return found[node]

        return np.stack([world(node) for node in range(len(states))])

    def skinned(self, world: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Places of joints, helpers last, and of vertices of a skin."""
        skin, mesh = self.gltf.skins[number], self.gltf.meshes[number]
        bindings = self.values(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
        matrices = world[skin.joints] @ bindings
        attributes = mesh.primitives[0].attributes
        vertices = np.hstack(
            [self.values(attributes.POSITION), np.ones((self.gltf.accessors[attributes.POSITION].count, 1))]
        )
        joints, weights = self.values(attributes.JOINTS_0), self.values(attributes.WEIGHTS_0)
        moved = np.einsum("vk,vkij,vj->vi", weights, matrices[joints], vertices)
        return world[skin.joints][:, :3, 3], moved[:, :3]


@pytest.mark.parametrize(("rotations", "joint_error", "vertex_error"), [("float32", 1e-5, 1e-4), ("int16", 2e-4, 1e-3)])
def test_another_reader_finds_joints_and_skin_where_we_have_them(
    sampler: PoseSampler, tmp_path: Path, rotations: str, joint_error: float, vertex_error: float
) -> None:
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=FPS, rotations=rotations)
    scene, take = Scene(path), sampler.take
    count = take.output_frames(float(FPS))
    (poses,) = sampler.sample(0, count, float(FPS))
    positions, turned = (values.astype(float) for values in poses.joints())
    database = sampler.policies[0].database
    assert [skin.name for skin in scene.gltf.skins] == ["red_0", "red_1", "late_0"]
    seen = 0
    for frame in range(count):
        world = scene.at(float(frame / FPS))
        for number in range(3):
            joints, vertices = scene.skinned(world, number)
            if not np.isfinite(positions[frame, number, 0, 0]):
                assert np.ptp(vertices, axis=0).max() < 1e-6
                continue
            seen += number == 2
            assert np.abs(joints[:-4] - positions[frame, number]).max() < joint_error
            if frame % 9 == 0 or number == 2:
                girth = float(poses.girths[number])
                some = database.rotations[:: max(1, len(database.rotations) // 200)][:200]
                skin = build_skin(database.skeleton, database.body, usual_build(girth), some)
                skin = skin.shaped(girth, poses.stretches[number][poses.segments])
                here = slice(number, number + 1)
                matrices = skin.matrices(positions[frame, here], turned[frame, here], poses.scales[here])
                ours, _ = pose_skins([skin], matrices)
                assert np.abs(ours[0] - vertices).max() < vertex_error
    assert 0 < seen < count


def test_times_of_broadcast_rates_are_exact(sampler: PoseSampler, tmp_path: Path) -> None:
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=FPS, frames=(3, 20))
    scene = Scene(path)
    times = scene.values(scene.gltf.animations[0].samplers[0].input)[:, 0]
    np.testing.assert_array_equal(times, np.array([np.float32(k * 1001 / 24000) for k in range(17)]))
    assert scene.gltf.scenes[0].extras["fps"] == "24000/1001"
    (path,) = write_gltf(sampler, tmp_path / "near.glb", fps=29.97002997, frames=(3, 20))
    assert Scene(path).gltf.scenes[0].extras["fps"] == "30000/1001"


def test_chosen_avatars_and_frames_are_part_of_the_whole(
    sampler: PoseSampler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (whole,) = write_gltf(sampler, tmp_path / "whole.glb", fps=30)
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 21)
    monkeypatch.setattr(stream, "_MANY_AVATARS", 2)
    (again,) = write_gltf(sampler, tmp_path / "again.glb", fps=30, threads=3)
    assert whole.read_bytes() == again.read_bytes()
    (part,) = write_gltf(sampler, tmp_path / "part.glb", fps=30, frames=(25, 40), avatars=[2])
    mine, all_of_it = Scene(part), Scene(whole)
    assert [skin.name for skin in mine.gltf.skins] == ["late_0"]
    for frame in (25, 39):
        ours, _ = mine.skinned(mine.at((frame - 25) / 30), 0)
        theirs, _ = all_of_it.skinned(all_of_it.at(frame / 30), 2)
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    assert write_gltf(sampler, tmp_path / "none.glb", fps=30, frames=(0, 10), avatars=[2]) == []
    assert sorted(file.name for file in tmp_path.iterdir()) == ["again.glb", "part.glb", "whole.glb"]


def test_extras_say_teams_types_and_strikes(sampler: PoseSampler, tmp_path: Path) -> None:
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=30)
    scene = Scene(path)
    roots = {node.name: node.extras for node in scene.gltf.nodes if node.extras}
    found = {key: value for key, value in roots["late_0"].items() if key != "health_lost"}
    assert found == {"avatar": 2, "sex": "male", "build": "heavy", "team": "blue", "type": "large"}
    strikes, table = scene.gltf.scenes[0].extras["strikes"], sampler.take.strikes()
    for key in ("attacker", "victim", "limb", "outcome"):
        assert strikes[key] == table[key].tolist()
    harm = sampler.take.events.damage
    assert harm.any() == ("damage" in strikes)
    np.testing.assert_allclose(strikes.get("damage", np.zeros(len(table))), harm, atol=1e-3)
    np.testing.assert_allclose(strikes["seconds"], table["seconds"], atol=1e-3)
    np.testing.assert_allclose(strikes["point"], sampler.take.events.point, atol=5.1e-4)


def test_types_are_told_apart_by_their_shorts(sampler: PoseSampler, tmp_path: Path) -> None:
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=30)
    gltf = Scene(path).gltf
    shorts = {}
    for node in gltf.nodes:
        if node.mesh is not None and node.skin is not None:
            primitives = gltf.meshes[node.mesh].primitives
            parts = {part: {*parts} for one in primitives for parts in [gltf.materials[one.material].name.split("+")]
                     for part in parts}  # fmt: skip
            shorts[node.name] = parts["shorts"]
            looks = [gltf.materials[one.material].pbrMetallicRoughness for one in primitives]
            assert len({(*look.baseColorFactor, look.roughnessFactor) for look in looks}) == len(looks)
    plain = {"shorts", "stripes", "hems", "crossings"}
    assert shorts == {"red_0 skin": plain, "red_1 skin": plain, "late_0 skin": {"shorts", "hems"}}


def test_cloth_hair_leather_and_skin_have_textures_in_the_colours_of_pictures(
    sampler: PoseSampler, tmp_path: Path
) -> None:
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=30, frames=(0, 60))
    scene, cast = Scene(path), sampler.take.cast
    gltf, linear = scene.gltf, {}
    for texture in gltf.textures:
        image = gltf.images[texture.source]
        view = gltf.bufferViews[image.bufferView]
        data = scene.blob[view.byteOffset : view.byteOffset + view.byteLength]
        shown = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), float) / 255.0
        shown = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
        linear[image.name] = shown.mean(axis=(0, 1))
    assert sorted(linear) == ["cloth", "hair", "leather", "skin"]
    dresses = avatar_paints(cast.teams, np.asarray(cast.colours, float)[cast.types])
    seen = set()
    for node in gltf.nodes:
        if node.skin is None:
            continue
        avatar = cast.names.tolist().index(node.name.split()[0])
        paints = skin_paints(avatar, dresses[avatar], int(cast.types[avatar]))
        for primitive in gltf.meshes[node.mesh].primitives:
            material = gltf.materials[primitive.material]
            part = material.name.split("+")[0]
            shown, texture = material.pbrMetallicRoughness, TEXTURES.get(part)
            colour = np.array(shown.baseColorFactor[:3])
            assert (shown.baseColorTexture is None) == (texture is None)
            assert (primitive.attributes.TEXCOORD_0 is None) == (texture is None)
            if texture is not None:
                assert gltf.images[gltf.textures[shown.baseColorTexture.index].source].name == texture
                colour = colour * linear[texture]
                seen.add(part)
            np.testing.assert_allclose(colour, paints[SKIN_PARTS.index(part), :3], atol=0.02)
    assert {"skin", "hair", "shorts", "gloves", "shoes"} <= seen


def test_types_have_bodies_of_their_sex_and_with_their_hands(sampler: PoseSampler, tmp_path: Path) -> None:
    bodies = (("female", "bare"), ("male", "gloves"))
    take = replace(sampler.take, cast=replace(sampler.take.cast, bodies=bodies))
    (path,) = write_gltf(PoseSampler(take, sampler.policies), tmp_path / "crowd.glb", fps=30, frames=(0, 60))
    gltf = Scene(path).gltf
    assert [node.extras["sex"] for node in gltf.nodes if node.extras] == ["female", "female", "male"]
    parts = {
        node.name: {
            part for one in gltf.meshes[node.mesh].primitives for part in gltf.materials[one.material].name.split("+")
        }
        for node in gltf.nodes
        if node.skin is not None
    }
    assert [{"top", "gloves"} & parts[f"{name} skin"] for name in ("red_0", "red_1", "late_0")] == [
        {"top"}, {"top"}, {"gloves"},
    ]  # fmt: skip


def test_extras_say_what_strikes_have_taken_from_health(sampler: PoseSampler, tmp_path: Path) -> None:
    take = sampler.take
    count = len(take.events.frame)
    assert count > 3
    victims, harm = np.zeros(count, np.int32), np.arange(count, dtype=np.float32)
    hurt = replace(take, events=replace(take.events, victim=victims, damage=harm))
    order = np.argsort(take.events.frame, kind="stable")
    seconds, points = np.asarray(take.events.frame)[order] / take.control_rate, np.cumsum(harm[order])
    for start in (0, 30):
        (path,) = write_gltf(PoseSampler(hurt, sampler.policies), tmp_path / f"{start}.glb", (start, 80), fps=30)
        extras = {node.name: node.extras for node in Scene(path).gltf.nodes if node.extras}
        found = np.array(extras["red_0"]["health_lost"])
        assert "health_lost" not in extras["red_1"]
        assert (np.diff(found[:, 0]) > 0).all()
        for time in (0.0, 0.5, 1.0, 2.0, (79 - start) / 30):
            before = points[seconds <= time + start / 30 + 1e-3]
            ours = found[found[:, 0] <= time + 1e-3]
            expected = before[-1] if len(before) else 0.0
            assert (ours[-1, 1] if len(ours) else 0.0) == pytest.approx(expected, abs=1e-3)


def test_targets_come_along_as_balls(sampler: PoseSampler, tmp_path: Path) -> None:
    take = sampler.take
    places = np.random.default_rng(3).normal(size=(take.frame_count, 2, 3)).astype(np.float32)
    shown = PoseSampler(replace(take, targets=places), sampler.policies)
    (path,) = write_gltf(shown, tmp_path / "crowd.glb", (5, 60), fps=FPS)
    scene = Scene(path)
    source = TakeSource(shown.take, shown.policies, float(FPS))
    for frame in (5, 6, 31, 59):
        world = scene.at(float((frame - 5) / FPS))
        for number, expected in enumerate(source.markers(frame)):
            np.testing.assert_allclose(world[scene.names.index(f"target_{number}")][:3, 3], expected, atol=1e-5)
    mesh = scene.gltf.meshes[scene.gltf.nodes[scene.names.index("target_0")].mesh]
    points = scene.values(mesh.primitives[0].attributes.POSITION)
    faces = points[scene.values(mesh.primitives[0].indices).reshape(-1, 3)]
    outwards = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    assert (np.einsum("ij,ij->i", outwards, faces.mean(axis=1)) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 0.13, atol=1e-6)


RED = (0.8, 0.1, 0.1)


@pytest.fixture(scope="module")
def armed(sampler: PoseSampler) -> PoseSampler:
    """The same take with a stick in the right hand of both types, and a plate of two colours on the head of one."""
    roles = sampler.policies[0].database.body.roles
    stick = (roles["right_hand"], (-0.07, 0.0, -0.1), (-0.2, 0.1, 0.6), 0.016, WOOD, False)
    knob = (roles["head"], (0.0, 0.2, 0.0), (0.0, 0.2, 0.0), 0.05, RED, False)
    rods = [(roles["head"], (x, 0.1, -0.1), (x, 0.1, 0.2), 0.004, WOOD, False) for x in np.linspace(-0.1, 0.1, 70)]
    props = np.array([(0, *stick), (1, *stick), (1, *knob), *((1, *rod) for rod in rods)], PROP)
    take = replace(sampler.take, cast=replace(sampler.take.cast, attachments=props))
    return PoseSampler(take, sampler.policies)


def test_props_are_children_of_joints_where_pictures_show_them(armed: PoseSampler, tmp_path: Path) -> None:
    (path,) = write_gltf(armed, tmp_path / "crowd.glb", fps=FPS)
    scene, cast = Scene(path), armed.take.cast
    held = {name: node for node, name in enumerate(scene.names) if name.endswith(" prop")}
    assert list(held) == [f"{name} prop" for name in ("red_0 RightHand", "red_1 RightHand", "late_0 Head",
                                                      "late_0 RightHand")]  # fmt: skip
    assert all(scene.names[scene.parents[node]] == name.split()[1] for name, node in held.items())
    nodes = scene.gltf.nodes
    assert len({nodes[node].mesh for name, node in held.items() if "Hand" in name}) == 1
    (poses,) = armed.sample(0, armed.take.output_frames(float(FPS)), float(FPS))
    positions, rotations = poses.joints()
    seen = set()
    for frame in range(0, len(positions), 3):
        world = scene.at(float(frame / FPS))
        shown = place_attachments(cast, poses.avatars, positions[frame], rotations[frame])
        for name, node in held.items():
            avatar = cast.names.tolist().index(name.split()[0])
            mesh = scene.gltf.meshes[nodes[node].mesh]
            for primitive in mesh.primitives:
                points = scene.values(primitive.attributes.POSITION)
                points = points @ world[node][:3, :3].T + world[node][:3, 3]
                colour = scene.gltf.materials[primitive.material].pbrMetallicRoughness.baseColorFactor[:3]
                alike = np.abs(shown.colours.astype(float) ** 2 - colour).max(axis=1) < 1e-3
                mine = (shown.avatars == avatar) & alike & ((shown.radii > 0.014) == (len(points) < 200))
                if not mine.any():
                    assert np.ptp(points, axis=0).max() < 1e-6
                    continue
                gaps = [
                    np.abs(
                        distance_to(points, *(values[row].astype(float) for values in shown[1:3])) - shown.radii[row]
                    )
                    for row in np.flatnonzero(mine)
                ]
                assert np.min(gaps, axis=0).max() < 1e-5
                seen.add((name, len(points)))
    assert len(seen) == 5


def test_rotations_that_move_a_joint_or_a_prop_are_not_shortened(armed: PoseSampler, tmp_path: Path) -> None:
    for rotations, dtypes in (("float32", ("<f4", "<i2", "<i2")), ("int16", ("<i2", "<i2", "i1"))):
        (path,) = write_gltf(armed, tmp_path / "crowd.glb", fps=30, rotations=rotations, frames=(20, 60))
        scene = Scene(path)
        nodes, (animation,) = scene.gltf.nodes, scene.gltf.animations
        for channel in animation.channels:
            if channel.target.path == "rotation":
                node = channel.target.node
                found = DTYPES[scene.gltf.accessors[animation.samplers[channel.sampler].output].componentType]
                expected = dtypes[0] if nodes[node].children else dtypes[1]
                assert found == (dtypes[2] if scene.names[node].endswith("Half") else expected)


def test_meshes_from_files_are_their_triangles_where_joints_are(sampler: PoseSampler, tmp_path: Path) -> None:
    cast, head = sampler.take.cast, sampler.policies[0].database.body.roles["head"]
    corners = np.array([[[0, 0.2, 0], [0.1, 0.2, 0], [0, 0.2, 0.1]], [[0, 0.2, 0], [0, 0.2, 0], [0, 0.3, 0]]])
    faces = np.array([(1, head, face, RED, False) for face in corners], FACE)
    take = replace(sampler.take, cast=replace(cast, faces=faces))
    (path,) = write_gltf(PoseSampler(take, sampler.policies), tmp_path / "crowd.glb", fps=FPS)
    scene = Scene(path)
    (node,) = (number for number, name in enumerate(scene.names) if name.endswith(" prop"))
    assert scene.names[node] == "late_0 Head prop"
    (primitive,) = scene.gltf.meshes[scene.gltf.nodes[node].mesh].primitives
    points = scene.values(primitive.attributes.POSITION)[scene.values(primitive.indices).reshape(-1, 3)]
    # The triangle without an area is left out.
    np.testing.assert_allclose(points, corners[:1], atol=1e-6)
    np.testing.assert_allclose(scene.values(primitive.attributes.NORMAL), [[0, -1, 0]] * 3, atol=1e-6)
    assert scene.gltf.materials[primitive.material].doubleSided


def distance_to(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Distances of points (n, 3) from a piece of a line."""
    axis = end - start
    share = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * axis, axis=1)


@pytest.mark.parametrize("end", [(0.3, 0.1, -0.2), (0.0, 0.4, 0.0), (0.0, 0.0, 0.0)])
def test_a_capsule_is_a_closed_surface_as_large_as_it(end: tuple[float, float, float]) -> None:
    trimesh = pytest.importorskip("trimesh")
    found = capsule_mesh(np.zeros(3), np.array(end), 0.05, 48, 16)
    shape = trimesh.Trimesh(found.positions, found.triangles)
    expected = np.pi * 0.05**2 * (np.linalg.norm(end) + 4.0 / 3.0 * 0.05)
    assert shape.is_watertight
    assert shape.is_winding_consistent
    assert expected * 0.98 < shape.volume < expected
    corners = found.positions[found.triangles]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ikj->ik", outward, found.normals[found.triangles]) > 0.0).all()
    np.testing.assert_allclose(distance_to(found.positions, np.zeros(3), np.array(end)), 0.05, atol=1e-9)


@pytest.mark.parametrize(("rotations", "metres", "radians"), [("float32", 1e-5, 1e-5), ("int16", 2.1e-4, 1.5e-4)])
@pytest.mark.parametrize("camera", ["fight", "front+side", "orbit"])
def test_cameras_come_along_as_pictures_have_them(
    sampler: PoseSampler, tmp_path: Path, camera: str, rotations: str, metres: float, radians: float
) -> None:
    output = GlbOutput(fps=30.0, frames=(10, 50), camera=camera, rotations=rotations)
    (path,) = write_posed(sampler, tmp_path, [output])["glb"][:1]
    scene, source = Scene(path), TakeSource(sampler.take, sampler.policies, 30.0)
    for number, one in enumerate(resolve_camera(source, camera)):
        node = scene.names.index(f"camera_{number}" if number else "camera")
        track = build_track(source, one, (1280, 720))
        for frame in range(10, 50):
            view, world = track.view(frame), scene.at((frame - 10) / 30)[node]
            np.testing.assert_allclose(world[:3, 3], view.eye, atol=metres)
            np.testing.assert_allclose(-world[:3, 2], view.ahead, atol=radians)
            np.testing.assert_allclose(world[:3, 0], view.right, atol=radians)
        lens = scene.gltf.cameras[scene.gltf.nodes[node].camera].perspective
        assert lens.yfov == pytest.approx(track.view(10).field, abs=1e-6)
        assert lens.aspectRatio == pytest.approx(1280 / 720, abs=1e-5)


@pytest.mark.parametrize("tolerance", [0.0, 1e-3, 0.1])
def test_lines_between_sparse_keys_are_within_the_tolerance(tolerance: float) -> None:
    frames = np.arange(200)
    steps = np.random.default_rng(4).normal(size=(200, 3))
    jump = np.where(frames < 120, 0.0, 7.0)[:, None] * np.ones(3)
    for values in (0.01 * np.cumsum(steps, axis=0), np.sin(frames / 40.0)[:, None] * [1.0, 2.0, 0.5], jump, steps[:1]):
        keys = sparse_keys(values, tolerance)
        between = np.stack([np.interp(frames[: len(values)], keys, column[keys]) for column in values.T], axis=1)
        assert np.abs(between - values).max() <= tolerance + 1e-12
    assert sparse_keys(jump, tolerance).tolist()[:3] == [0, 119, 120]
    assert sparse_keys(jump[:120], tolerance).tolist() == [0]
    assert len(sparse_keys(np.sin(frames / 40.0)[:, None], 0.1)) < 20


def test_each_avatar_may_have_a_file_of_the_frames_in_which_it_is_there(sampler: PoseSampler, tmp_path: Path) -> None:
    split = GlbOutput(fps=30.0, split=True)
    written = write_posed(sampler, tmp_path, [split])["glb"]
    assert [path.name for path in written] == ["red_0.glb", "red_1.glb", "late_0.glb", "avatars.csv"]
    assert "late_0.glb" in written[-1].read_text()
    there = np.flatnonzero(sampler.present(2, 0, sampler.take.output_frames(30.0), 30.0))
    (whole,) = write_gltf(sampler, tmp_path / "whole.glb", fps=30)
    mine, all_of_it = Scene(written[2]), Scene(whole)
    assert mine.gltf.scenes[0].extras["first_frame"] == there[0]
    assert not [channel for channel in mine.gltf.animations[0].channels if channel.target.path == "scale"]
    times = mine.values(mine.gltf.animations[0].samplers[0].input)[:, 0]
    assert len(times) == there[-1] + 1 - there[0]
    for frame in (there[0], there[-1]):
        ours, _ = mine.skinned(mine.at((frame - there[0]) / 30), 0)
        theirs, _ = all_of_it.skinned(all_of_it.at(frame / 30), 2)
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    written[1].unlink()
    before = written[0].read_bytes()
    write_posed(sampler, tmp_path, [split])
    assert written[1].exists()
    assert written[0].read_bytes() == before


def test_cameras_that_there_are_not_are_refused_before_anything_is_written(
    sampler: PoseSampler, tmp_path: Path
) -> None:
    file = tmp_path / "shots.yaml"
    file.write_text("cameras:\n  near: {kind: follow, avatar: nobody}\n  far: {kind: front}\n")
    shown, cameras = sampler.take, load_cameras(file).cameras
    for camera, why in (
        ("nosuch", "camera 'nosuch' is unknown, expected one of near, far, auto"),
        ("follow:9", r"camera 'follow:9': no avatar 9, expected"),
        ("near", "camera 'near': .*'nobody'"),
        (f"{file}#near", "camera '.*#near': .*'nobody'"),
        (f"{file}#no", "camera '.*#no' is unknown"),
        ("far+side", "joins 'far', a camera of the scenario"),
    ):
        with pytest.raises(CrowdsimError, match=why):
            GlbOutput(camera=camera).of_take(shown.cast.names.tolist(), cameras)
    for camera in ("far", f"{file}#far"):
        chosen = GlbOutput(camera=camera).of_take(shown.cast.names.tolist(), cameras)
        assert isinstance(chosen, GlbOutput)
        assert chosen.camera == cameras["far"]


def test_files_of_avatars_have_no_camera() -> None:
    with pytest.raises(ValidationError, match="camera: is given beside split"):
        GlbOutput(split=True, camera="fight")


def test_roots_of_the_scene_are_skins_and_trees_of_joints(sampler: PoseSampler, tmp_path: Path) -> None:
    builds = [Build(), Build("female"), Build("male", "heavy", "bare")]
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=30, builds=builds)
    scene = Scene(path)
    assert all("skin" in scene.names[node] or node not in scene.parents for node in scene.gltf.scenes[0].nodes)
    skinned = [node for node, item in enumerate(scene.gltf.nodes) if item.skin is not None]
    assert len(skinned) == 3
    assert not set(skinned) & set(scene.parents)
    assert len(scene.gltf.animations) == 1


def test_a_file_that_fails_leaves_nothing(
    sampler: PoseSampler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gltf, "_LARGEST", 1000)
    with pytest.raises(OutputError, match=r"crowd\.glb: would have .* GB, glTF files have at most 4\.3"):
        write_gltf(sampler, tmp_path / "crowd.glb", fps=30)
    monkeypatch.undo()

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(gltf, "pack_rotations", fails)
    with pytest.raises(OSError, match="No space"):
        write_gltf(sampler, tmp_path / "crowd.glb", fps=30)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("rotations", ["float32", "int16"])
def test_the_validator_reports_nothing(armed: PoseSampler, tmp_path: Path, rotations: str) -> None:
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("npm is not installed")
    done = subprocess.run(
        ["npm", "install", "--prefix", str(tmp_path), "gltf-validator@2.0.0-dev.3.10"], capture_output=True
    )
    if done.returncode:
        pytest.skip("npm has no gltf-validator")
    places = np.random.default_rng(3).normal(size=(armed.take.frame_count, 2, 3)).astype(np.float32)
    door = {"at": 2.0, "width": 1.0, "opens": 0.2}
    wall = WallObstacle.model_validate({"kind": "wall", "points": [[0, 4], [6, 4]], "height": 2.0, "doors": [door]})
    disc = DiscObstacle(kind="disc", centre=(3.0, 0.0), radius=0.3, height=1.0)
    parts = pack_parts([(0, wall), (1, disc)], None)
    shown = PoseSampler(replace(armed.take, targets=places), armed.policies, obstacles=parts)
    path = write_posed(shown, tmp_path, [GlbOutput(fps=float(FPS), rotations=rotations, camera="fight")])["glb"][0]
    code = (
        "const v=require('gltf-validator'),f=require('fs');"
        "v.validateBytes(new Uint8Array(f.readFileSync(process.argv[1])))"
        ".then(r=>console.log(JSON.stringify(r.issues)))"
    )
    report = subprocess.run(["node", "-e", code, str(path)], cwd=tmp_path, capture_output=True, text=True, check=True)
    issues = json.loads(report.stdout)
    assert (issues["numErrors"], issues["numWarnings"], issues["numInfos"]) == (0, 0, 0), issues["messages"][:5]


def test_the_header_counts_all_bytes(sampler: PoseSampler, tmp_path: Path) -> None:
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=30, frames=(0, 5))
    data = path.read_bytes()
    magic, version, length, text, kind = struct.unpack("<4sIIII", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), 0x4E4F534A)
    assert struct.unpack("<II", data[20 + text : 28 + text]) == (len(data) - 28 - text, 0x004E4942)


@pytest.mark.parametrize("rotations", ["float32", "int16"])
@pytest.mark.parametrize("most", [2, 512])
def test_what_an_interrupted_command_has_posed_is_not_posed_again(
    sampler: PoseSampler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rotations: str, most: int
) -> None:
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 21)
    monkeypatch.setattr(stream, "_MANY_AVATARS", most)
    output = GlbOutput(fps=30.0, rotations=rotations, camera="orbit")
    for name in ("whole", "again"):
        (tmp_path / name).mkdir()
    whole = write_posed(sampler, tmp_path / "whole", [output])["glb"][0].read_bytes()
    frames, parts = sampler.take.output_frames(30.0), 2 if most == 2 else 1
    counts, sample, note, stops = [], PoseSampler.sample, gltf.GltfFile.note, [(0, 25), (parts - 1, 60)]

    def counted(self: PoseSampler, start: int, stop: int, *others: object) -> object:
        counts[-1] += stop - start
        return sample(self, start, stop, *others)

    def interrupted(self: gltf.GltfFile, part: int, rows: int) -> None:
        note(self, part, rows)
        if stops and part == stops[0][0] and rows > stops[0][1]:
            raise KeyboardInterrupt

    monkeypatch.setattr(PoseSampler, "sample", counted)
    monkeypatch.setattr(gltf.GltfFile, "note", interrupted)
    while stops:
        counts.append(0)
        with pytest.raises(KeyboardInterrupt):
            write_posed(sampler, tmp_path / "again", [output])
        stops.pop(0)
        assert not list((tmp_path / "again" / "glb").glob("*.glb"))
    counts.append(0)
    (path,) = write_posed(sampler, tmp_path / "again", [output])["glb"][:1]
    assert path.read_bytes() == whole
    assert counts[2] <= parts * frames - 60
    assert sorted(file.name for file in path.parent.iterdir()) == ["avatars.csv", "take.glb"]
    # Of a file that has all its frames nothing is posed; of another, and where more are noted, nothing is taken over.
    for rows in (-1, frames, frames + 1):
        half = tmp_path / f"noted {rows}" / "glb" / ".take.glb.part"
        half.parent.mkdir(parents=True)
        half.write_bytes(whole + np.full(parts, rows, "<i8").tobytes())
        assert write_posed(sampler, half.parent.parent, [output])["glb"][0].read_bytes() == whole
    for part in ("short", "long"):
        half = tmp_path / part / "glb" / ".take.glb.part"
        half.parent.mkdir(parents=True)
        half.write_bytes(b"x" * (len(whole) + 8 * parts if part == "long" else 100))
        assert write_posed(sampler, tmp_path / part, [output])["glb"][0].read_bytes() == whole


def test_a_file_whose_frames_are_all_written_is_finished_beside_a_longer_one(
    sampler: PoseSampler, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 21)
    outputs = [GlbOutput(fps=30.0, frames=(0, 50)), BvhOutput(fps=30.0)]
    for name in ("whole", "again"):
        (tmp_path / name).mkdir()
    whole = write_posed(sampler, tmp_path / "whole", outputs)
    sample = PoseSampler.sample

    def interrupted(self: PoseSampler, start: int, *others: object) -> object:
        if start > 60:
            raise KeyboardInterrupt
        return sample(self, start, *others)

    with monkeypatch.context() as patch:
        patch.setattr(PoseSampler, "sample", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_posed(sampler, tmp_path / "again", outputs)
    again = write_posed(sampler, tmp_path / "again", outputs)
    for kind, paths in whole.items():
        assert [path.read_bytes() for path in again[kind]] == [path.read_bytes() for path in paths]

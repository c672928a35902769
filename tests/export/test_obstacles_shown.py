"""Obstacles in point clouds and glTF files."""

from pathlib import Path

import numpy as np
import pytest
from naive_places import gap_to, stands
from scenes import crowdsim, write_scene
from test_gltf import Scene

from crowdsim.export.pointcloud import CloudSink
from crowdsim.runs.opening import open_run

OUTPUT = {"fps": 2, "points": 50, "obstacles": 30}
OBSTACLES = [
    {"kind": "wall", "points": [[-6, 4], [6, 4]], "height": 2.0, "doors": [{"at": 6, "width": 1.2, "opens": 1}]},
    {"kind": "box", "centre": [-5, -5], "size": [1.0, 0.5], "height": 0.9},
]


@pytest.fixture(scope="module")
def folder(tiny_policy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("walled")
    (place / "policies").symlink_to(tiny_policy.parent)
    write_scene(place / "walled.yaml", duration="2s", obstacles=OBSTACLES, outputs={"ply": OUTPUT})
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        assert crowdsim("run", "walled.yaml", "--out", "run") == 0
    return place / "run"


def test_points_lie_on_the_obstacles_that_stand(folder: Path) -> None:
    run = open_run(folder)
    for frame in range(4):
        cloud = CloudSink(run.sampler, folder, "ply", 2.0, 50, obstacles=30.0).build(frame)
        data = (folder / "ply" / f"{frame:06d}.ply").read_bytes()
        assert data.endswith(cloud.rows.tobytes())
        on = cloud.labels[:, 0] == -1
        assert (cloud.labels[on, 1] == -1).all()
        assert set(cloud.labels[on, 2]) == ({-1, -2, -5} if frame < 2 else {-1, -2})
        assert (cloud.labels[~on] >= 0).all()
        standing = [part for part in run.obstacles if stands(part, frame / 2)]
        for x, y, z in cloud.positions[on][::17]:
            # On the sides, or in between on the top and the bottom, of one of them.
            found = [(gap_to(part, x, z), min(abs(y), abs(y - part["height"]))) for part in standing]
            assert any(abs(gap) < 2e-3 or (gap < 0 and above < 1e-5) for gap, above in found)
        assert not cloud.velocities[on].any()
        assert np.linalg.norm(cloud.normals[on], axis=1) == pytest.approx(1.0, abs=1e-5)
    area = 2 * 12 * 2.0 + 2 * (1.0 * 0.5 + 1.0 * 0.9 + 0.5 * 0.9)
    assert np.count_nonzero(CloudSink(run.sampler, folder, "ply", 2.0, 50, obstacles=30.0).build(0).avatar < 0) > (
        30 * area * 0.95
    )


def test_clouds_without_obstacles_have_points_on_bodies_alone(folder: Path, tmp_path: Path) -> None:
    sampler = open_run(folder).sampler
    bodies = CloudSink(sampler, tmp_path, "ply", 2.0, 50, obstacles=0.0).build(1)
    both = CloudSink(sampler, tmp_path, "ply", 2.0, 50, obstacles=30.0).build(1)
    assert len(bodies.rows) < len(both.rows)
    assert bodies.rows.tobytes() == both.rows[: len(bodies.rows)].tobytes()


def test_too_many_points_on_obstacles_are_a_finding(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    many = [{"kind": "wall", "points": [[-2000, 40], [2000, 40]], "height": 5.0}]
    write_scene(folder.parent / "many.yaml", obstacles=many, outputs={"ply": {"obstacles": 100_000}})
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder.parent)
        assert crowdsim("validate", "many.yaml") == 2
    assert "points a frame on 41,6" in capsys.readouterr().err


def test_gltf_files_hold_obstacles_and_doors_that_open(folder: Path) -> None:
    pytest.importorskip("pygltflib")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder.parent)
        assert crowdsim("export", "run", "--glb", "--fps", "10") == 0
    scene = Scene(folder / "glb" / "take.glb")
    node = {name: scene.names.index(name) for name in ("obstacle_0", "obstacle_0_door_1", "obstacle_1")}
    for time, shown in ((0.0, 1.0), (0.9, 1.0), (1.0, 0.0), (1.8, 0.0)):
        world = scene.at(time)
        assert np.linalg.norm(world[node["obstacle_0_door_1"]][:3, :3]) == pytest.approx(shown * 3**0.5)
        assert world[node["obstacle_0"]] == pytest.approx(np.eye(4))
    primitive = scene.gltf.meshes[scene.gltf.nodes[node["obstacle_1"]].mesh].primitives[0]
    places = scene.values(primitive.attributes.POSITION)
    assert places.min(axis=0) == pytest.approx([-5.5, 0.0, -5.25])
    assert places.max(axis=0) == pytest.approx([-4.5, 0.9, -4.75])
    assert scene.gltf.materials[primitive.material].name == "box"

"""A glTF file in trimesh and in three.js: bodies, motion, cameras and what is said of avatars arrive."""

import json
import shutil
import subprocess
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from test_gltf import sampler  # noqa: F401 - a fixture

from crowdsim.export.gltf import write_gltf
from crowdsim.export.posed import write_posed
from crowdsim.outputs.glb import GlbOutput
from crowdsim.poses.sampler import PoseSampler

FPS = Fraction(24000, 1001)
THREE = "three@0.187.0"
LOOK = """
import { readFileSync } from 'node:fs';
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

globalThis.self = globalThis;
const bytes = readFileSync(process.argv[2]);
const data = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
const { scene, animations, cameras } = await new GLTFLoader().parseAsync(data, '');
const mixer = new THREE.AnimationMixer(scene);
mixer.clipAction(animations[0]).play();
const meshes = [];
scene.traverse(item => { if (item.isSkinnedMesh) meshes.push(item); });
const found = { animations: animations.length, strikes: scene.userData.strikes, avatars: [], bones: [], eyes: [] };
const bodies = scene.children.filter(item => item.userData.avatar !== undefined);
found.avatars = bodies.map(item => [item.name, item.userData]);
for (const time of process.argv.slice(3).map(Number)) {
  mixer.setTime(time);
  scene.updateMatrixWorld(true);
  const place = item => new THREE.Vector3().setFromMatrixPosition(item.matrixWorld).toArray();
  found.bones.push(bodies.map(body => {
    const { skeleton } = meshes.find(mesh => body.getObjectById(mesh.skeleton.bones[0].id));
    return skeleton.bones.map(place);
  }));
  found.eyes.push(cameras.map(place));
}
console.log(JSON.stringify(found));
"""


def test_trimesh_reads_closed_bodies_of_the_right_size(sampler: PoseSampler, tmp_path: Path) -> None:  # noqa: F811
    trimesh = pytest.importorskip("trimesh")
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=30, frames=(0, 60))
    scene = trimesh.load(path)
    bodies = {name.split(" ")[0] for name in scene.graph.nodes_geometry}
    assert bodies == {"red_0", "red_1", "late_0"}
    for body in bodies:
        parts = [name for name in scene.graph.nodes_geometry if name.split(" ")[0] == body]
        meshes = [scene.geometry[scene.graph[name][1]] for name in parts]
        whole = trimesh.util.concatenate(meshes)
        whole.merge_vertices(merge_tex=True, merge_norm=True)
        assert len(meshes) > 8
        assert whole.is_watertight
        assert 0.055 < whole.volume < 0.2
        assert 1.5 < np.ptp(whole.vertices[:, 1]) < 2.2


@pytest.mark.slow
def test_three_js_moves_the_bodies_that_we_posed(sampler: PoseSampler, tmp_path: Path) -> None:  # noqa: F811
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("npm is not installed")
    if subprocess.run(["npm", "install", "--prefix", str(tmp_path), THREE], capture_output=True).returncode:
        pytest.skip(f"npm has no {THREE}")
    path = write_posed(sampler, tmp_path, [GlbOutput(fps=float(FPS), camera="fight")])["glb"][0]
    (tmp_path / "look.mjs").write_text(LOOK)
    frames, count = (0, 9, 20, 55), sampler.take.output_frames(float(FPS))
    times = [str(float(frame / FPS)) for frame in frames]
    done = subprocess.run(["node", "look.mjs", path, *times], cwd=tmp_path, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    (poses,) = sampler.sample(0, count, float(FPS))
    positions = poses.joints()[0].astype(float)
    assert found["animations"] == 1
    assert [(name, about["avatar"]) for name, about in found["avatars"]] == [("red_0", 0), ("red_1", 1), ("late_0", 2)]
    assert found["strikes"]["attacker"] == sampler.take.strikes()["attacker"].tolist()
    assert np.ptp(np.array(found["eyes"]), axis=0).max() > 0.01
    seen = 0
    for row, frame in enumerate(frames):
        for avatar in range(3):
            ours, theirs = positions[frame, avatar], np.array(found["bones"][row][avatar])
            if np.isfinite(ours[0, 0]):
                seen += 1
                # Between keys, which times as float32 nearly are, three.js interpolates.
                np.testing.assert_allclose(theirs[:-4], ours, atol=1e-4)
            else:
                assert np.ptp(theirs, axis=0).max() < 1e-6
    assert seen > 8

"""A glTF file in Blender: armatures, rate and scale, and bones and skin where we have them."""

import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from test_gltf import sampler  # noqa: F401 - a fixture

from crowdsim.body.looks import usual_build
from crowdsim.body.skin import build_skin, pose_skins
from crowdsim.export.gltf import write_gltf
from crowdsim.poses.sampler import PoseSampler

DOCS = Path(__file__).resolve().parents[2] / "docs"
FPS = Fraction(24000, 1001)
FIND = "import importlib.util, sys; sys.exit(importlib.util.find_spec('bpy') is None)"
LOOK = """
import sys
sys.path.insert(0, sys.argv[1])
import bpy
import numpy as np
from blender_import import open_crowd
open_crowd(sys.argv[2])
scene = bpy.context.scene
found = {"rate": scene.render.fps / scene.render.fps_base, "end": scene.frame_end}
armatures = sorted((o for o in bpy.data.objects if o.type == "ARMATURE"), key=lambda o: o.name)
meshes = sorted((o for o in bpy.data.objects if o.type == "MESH" and o.find_armature()), key=lambda o: o.name)
found["names"] = [o.name for o in armatures]
for frame in map(int, sys.argv[4:]):
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    for number, (armature, mesh) in enumerate(zip(armatures, meshes)):
        bones = armature.pose.bones
        found[f"bones_{frame}_{number}"] = [list(armature.matrix_world @ bone.head) for bone in bones]
        found[f"bone_names_{number}"] = [bone.name for bone in bones]
        moved = mesh.evaluated_get(graph)
        found[f"vertices_{frame}_{number}"] = [list(moved.matrix_world @ v.co) for v in moved.data.vertices]
np.savez(sys.argv[3], **found)
"""


def blender() -> str | None:
    """Return a Python that has Blender: this one, or that of the environment beside it (``make test-slow``)."""
    beside = Path(sys.prefix) / "blender" / "bin" / "python"
    for python in (sys.executable, str(beside)):
        if Path(python).exists() and subprocess.run([python, "-c", FIND]).returncode == 0:
            return python
    return None


@pytest.mark.slow
def test_blender_shows_the_crowd_that_we_posed(sampler: PoseSampler, tmp_path: Path) -> None:  # noqa: F811
    if (python := blender()) is None:
        pytest.skip("bpy is not installed")
    (path,) = write_gltf(sampler, tmp_path / "crowd.glb", fps=FPS)
    frames, out = (0, 9, 20, 55), tmp_path / "found.npz"
    subprocess.run([python, "-c", LOOK, DOCS, path, out, *map(str, frames)], check=True, capture_output=True)
    found, count = np.load(out), sampler.take.output_frames(float(FPS))
    assert list(found["names"]) == ["late_0", "red_0", "red_1"]
    assert found["rate"] == pytest.approx(float(FPS), rel=1e-6)
    assert found["end"] == count - 1
    (poses,) = sampler.sample(0, count, float(FPS))
    positions, turned = (values.astype(float) for values in poses.joints())
    database = sampler.policies[0].database
    some = database.rotations[:: max(1, len(database.rotations) // 200)][:200]
    for number, avatar in enumerate((2, 0, 1)):
        girth = float(poses.girths[avatar])
        skin = build_skin(database.skeleton, database.body, usual_build(girth), some)
        skin = skin.shaped(girth, poses.stretches[avatar][poses.segments])
        for frame in frames:
            # Blender's z points up.
            bones, vertices = (
                found[f"{name}_{frame}_{number}"][:, [0, 2, 1]] * [1, 1, -1] for name in ("bones", "vertices")
            )
            if not np.isfinite(positions[frame, avatar, 0, 0]):
                assert np.ptp(vertices, axis=0).max() < 1e-4
                continue
            order = [list(found[f"bone_names_{number}"]).index(name) for name in database.skeleton.names]
            np.testing.assert_allclose(bones[order], positions[frame, avatar], atol=1e-4)
            here = slice(avatar, avatar + 1)
            ours, _ = pose_skins([skin], skin.matrices(positions[frame, here], turned[frame, here], poses.scales[here]))
            assert cKDTree(vertices).query(ours[0])[0].max() < 5e-4

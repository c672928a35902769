"""Opens a crowd in Blender at its own rate, and prints what is there.

blender --python docs/blender_import.py -- crowd.glb
python docs/blender_import.py crowd.glb          # with the package bpy
"""

from __future__ import annotations

import json
import struct
import sys
from fractions import Fraction

import bpy


def read_times(path: str) -> tuple[Fraction, float]:
    """Return the rate of a file of crowdsim and the time of its last frame [s]."""
    with open(path, "rb") as file:
        (length,) = struct.unpack("<12xI4x", file.read(20))
        document = json.loads(file.read(length))
    moments = document["animations"][0]["samplers"][0]["input"]
    return Fraction(document["scenes"][0]["extras"]["fps"]), document["accessors"][moments]["max"][0]


def open_crowd(path: str) -> None:
    """Replace the scene by a crowd; frame 0 of the time line is the first frame of the file.

    The importer turns seconds into frames of the scene, whose rate must be right before. Blender 5.0 multiplies by
    ``fps_base`` there, by which it should divide; both are tried.
    """
    rate, seconds = read_times(path)
    fps, last = round(rate), round(seconds * rate)
    for base in (float(rate) / fps, fps / float(rate)):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = bpy.context.scene
        scene.render.fps, scene.render.fps_base = fps, base
        bpy.ops.import_scene.gltf(filepath=path)
        if abs(max(action.frame_range[1] for action in bpy.data.actions) - last) < 1e-5 * last:
            break
    scene.render.fps_base = fps / float(rate)
    scene.frame_start, scene.frame_end = 0, last
    scene.frame_set(0)


if __name__ == "__main__":
    name = sys.argv[-1]
    open_crowd(name)
    # The importer adds a mesh that bones are drawn with.
    skins = [item for item in bpy.data.objects if item.type == "MESH" and item.find_armature()]
    armatures = [item for item in bpy.data.objects if item.type == "ARMATURE"]
    render = bpy.context.scene.render
    print(f"{name}: {len(armatures)} armatures, {len(skins)} skins, {render.fps / render.fps_base:.3f} frames a second")

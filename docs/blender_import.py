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


def crowd_rate(path: str) -> Fraction:
    """Return the rate that a file of crowdsim was written at."""
    with open(path, "rb") as file:
        length = struct.unpack("<12xI4x", file.read(20))[0]
        document = json.loads(file.read(length))
    return Fraction(document["scenes"][0]["extras"]["fps"])


def open_crowd(path: str) -> None:
    """Replace the scene by a crowd; frame 0 of the time line is the first frame of the file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    rate, render = crowd_rate(path), bpy.context.scene.render
    # The importer turns seconds into frames of the scene, whose rate must be right before.
    render.fps = round(rate)
    render.fps_base = render.fps / float(rate)
    bpy.ops.import_scene.gltf(filepath=path)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 0, round(max(action.frame_range[1] for action in bpy.data.actions))
    scene.frame_set(0)


if __name__ == "__main__":
    name = sys.argv[-1]
    open_crowd(name)
    # The importer adds a mesh that bones are drawn with.
    skins = [item for item in bpy.data.objects if item.type == "MESH" and item.find_armature()]
    armatures = [item for item in bpy.data.objects if item.type == "ARMATURE"]
    scene = bpy.context.scene
    print(f"{name}: {len(armatures)} armatures, {len(skins)} skins, ", end="")
    print(f"{scene.render.fps / scene.render.fps_base:.3f} frames a second, {scene.frame_end + 1} frames")

"""Draws docs/body.png: the skinned body of each build, and one beside its capsules in motion.

python docs/body_sheet.py [--out docs/body.png]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from PIL import Image

from crowdsim.body.anatomy import Build
from crowdsim.body.palette import avatar_paints, skin_paints
from crowdsim.body.skin import Skin, build_skin, pose_skins
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body, build_body
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.performer.session import perform

matplotlib.use("Agg")

BUILDS = (Build(), Build("female"), Build(kind="lean", hands="bare"), Build(kind="heavy"))
_SUN, _EYE = np.array([-0.45, 0.6, 0.66]), np.array([0.0, 0.0, 1.0])


def draw(axes: Any, vertices: Any, normals: Any, triangles: Any, paints: Any, across: float) -> None:
    """Draw a mesh as seen along -z, furthest triangles first."""
    corners, turned = vertices[triangles], normals[triangles]
    for _ in range(2):
        corners, turned, paints = quartered(corners), quartered(turned), np.tile(paints, (4, 1))
    shown = turned.mean(axis=1)
    shown /= np.linalg.norm(shown, axis=1, keepdims=True)
    light = 0.34 + 0.10 * shown[:, 1] + 0.72 * np.maximum(shown @ _SUN, 0.0) / np.linalg.norm(_SUN)
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    order = order[np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[order, 2] > 0]
    tints = np.clip(paints * light[:, None], 0, 1)[order]
    flat = corners[order][:, :, :2] + [across, 0.0]
    axes.add_collection(PolyCollection(flat, facecolors=tints, edgecolors=tints, linewidths=0.15))


def quartered(corners: Any) -> Any:
    """Return the corners of the four triangles that each is parted into. Shape (4 F, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    d, e, f = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.concatenate([np.stack(three, axis=1) for three in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))])


def capsule_mesh(body: Body, positions: Any, rotations: Any) -> tuple[Any, Any, Any]:
    """Return vertices, normals and triangles of a body's capsules."""
    rings, around = 12, 24
    found: list[tuple[Any, Any, Any]] = []
    for k, joint in enumerate(body.capsule_joints):
        sides = body.capsule_starts[k], body.capsule_ends[k]
        ends = [positions[joint] + quaternion.rotate(rotations[joint], side) for side in sides]
        way = ends[1] - ends[0] if np.linalg.norm(ends[1] - ends[0]) > 1e-6 else np.array([0.0, 1e-6, 0.0])
        turn = quaternion.between([0.0, 1.0, 0.0], way)
        height = np.repeat(np.sin(np.linspace(-np.pi / 2, np.pi / 2, 2 * rings)), around)
        angle = np.tile(np.linspace(0, 2 * np.pi, around, endpoint=False), 2 * rings)
        wide = np.sqrt(np.maximum(1 - height**2, 0))
        normal = quaternion.rotate(turn, np.stack([wide * np.cos(angle), height, -wide * np.sin(angle)], axis=1))
        far = np.repeat([0, 1], rings * around)
        vertices = np.stack(ends)[far] + body.capsule_radii[k][far][:, None] * normal
        a = np.arange((2 * rings - 1) * around)
        b = a - a % around + (a + 1) % around
        triangles = np.concatenate([np.stack([a, b, a + around], 1), np.stack([b, b + around, a + around], 1)])
        found.append((vertices, normal, triangles + k * len(vertices)))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))  # type: ignore[return-value]


def posed(skin: Skin, positions: Any, rotations: Any) -> tuple[Any, Any]:
    """Return vertices and normals of one avatar."""
    vertices, normals = pose_skins([skin], skin.matrices(positions[None], rotations[None], np.ones(1)))
    return vertices[0].astype(float), normals[0].astype(float)


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("body.png"))
    out = parser.parse_args().out
    clip = max((one.clip for one in perform(30.0, 3)), key=lambda one: one.frame_count)
    body = build_body(clip.skeleton)
    positions, rotations = (np.asarray(values, float) for values in clip_kinematics(clip))
    roles = body.roles
    reach = np.linalg.norm(positions[:, roles["right_hand"]] - positions[:, roles["chest"]], axis=-1)
    figure, axes = plt.subplots(figsize=(14, 2.85))
    across = 0.0
    frames = [20, 20, int(reach.argmax()), int(reach.argmax()), int(positions[:, 0, 1].argmin())]
    kinds = ["capsules", Build(), "capsules", Build(), Build("female")]
    for build, frame in [*((build, None) for build in BUILDS), *zip(kinds, frames, strict=True)]:
        skin = build_skin(clip.skeleton, body, build if isinstance(build, Build) else Build(), clip.rotations[::20])
        if frame is None:
            place, turned = skin.positions[: -len(skin.helpers)], skin.rotations[: -len(skin.helpers)]
        else:
            hips = positions[frame, roles["left_hip"]] - positions[frame, roles["right_hip"]]
            face = quaternion.about_y(np.arctan2(hips[2], hips[0]))
            place = quaternion.rotate(face, positions[frame] - positions[frame, 0] * [1, 0, 1])
            turned = quaternion.multiply(face, rotations[frame])
        side = quaternion.about_y(0.45 if frame is None else 0.75)
        place, turned = quaternion.rotate(side, place), quaternion.multiply(side, turned)
        if isinstance(build, Build):
            vertices, normals = posed(skin, place, turned)
            kind = 0 if frame else BUILDS.index(build)
            paints = skin_paints(len(BUILDS) if frame else kind, avatar_paints([0])[0], kind)
            draw(axes, vertices - [0, vertices[:, 1].min(), 0], normals, skin.triangles,
                 np.sqrt(paints[skin.parts, :3]), across)  # fmt: skip
        else:
            vertices, normals, triangles = capsule_mesh(body, place, turned)
            grey = np.full((len(triangles), 3), 0.72)
            draw(axes, vertices - [0, vertices[:, 1].min(), 0], normals, triangles, grey, across)
        across += 1.05
    axes.set(xlim=(-0.6, across - 0.45), ylim=(-0.05, 1.85), aspect="equal")
    axes.axis("off")
    figure.tight_layout(pad=0.1)
    # Triangles are drawn without smoothing between them: a large picture made small has it.
    figure.savefig(out, dpi=330, facecolor="white")
    with Image.open(out) as large:
        small = large.convert("RGB").resize((large.width // 3, large.height // 3), Image.Resampling.LANCZOS)
    small.quantize(192).save(out, optimize=True)
    print(out)


if __name__ == "__main__":
    main()

"""Obstacles in pictures: flat faces, whose capsules side by side cast the shadows, and ropes, which are capsules."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np

from crowdsim.core.types import Array
from crowdsim.places.kernels.records import BOX, DISC, PART, ROPES
from crowdsim.places.mesh import OBSTACLE_PAINTS, POST, ROPE_LEVELS, join_meshes, mesh_of, refined
from crowdsim.render.raycast import Capsules, PosedSkins

_POST_PAINT = (0.06, 0.06, 0.07, 0.3)
_GROOVE = 0.6
"""How far apart capsules are beside one another, over their diameter."""
_LOOKED_AT, _TRUNK = 500, 1.1
"""Of how many avatars it is looked at whether obstacles hide them, and the height of the middle of a trunk [m]."""
_CLOSE = 1.0
"""How near the eye an obstacle fills the picture [m]."""
_EDGE = 0.6
"""Length of the edges of faces at most, so that none of them begins behind the eye and ends far ahead of it [m]."""
_MOST_RADIUS, _FACE = 0.25, 0.06
"""Radius of capsules of walls at most, and of those in the faces of boxes [m]."""


def add_obstacles(
    capsules: Capsules, skins: PosedSkins | None, parts: Array, seconds: float
) -> tuple[Capsules, PosedSkins | None]:
    """Return capsules and skins of figures with those of obstacles at a time; each part is a figure of its own.

    Args:
        capsules: Capsules of figures.
        skins: Their skins.
        parts: Parts of obstacles, whose doors open by seconds (``places.arrays.pack_parts``). Shape (n,), ``PART``.
        seconds: The time.
    """
    stands = ~((parts["opens"] <= seconds) & (seconds < parts["closes"]))
    own, faces = _scenery_of(parts[stands].tobytes())
    joined = capsules.joined(own)
    if not len(faces.triangles):
        return joined, skins
    faces = replace(faces, homes=faces.homes + np.int32(len(capsules.shapes)))
    if skins is None:
        return joined, faces
    faces = replace(
        faces,
        triangles=faces.triangles + np.int32(len(skins.vertices)),
        looks=faces.looks + np.int32(len(skins.paints)),
    )
    return joined, PosedSkins(*(np.concatenate(pair) for pair in zip(_values(skins), _values(faces), strict=True)))


def _values(one: PosedSkins) -> list[Array]:
    return [getattr(one, field.name) for field in fields(one)]


def hide_avatars(parts: Array, eye: Array, ground: Array) -> Array:
    """Return which parts of obstacles are between an eye and the trunk of an avatar, or right before the eye.

    Args:
        parts: Parts of obstacles. Shape (n,), ``PART``.
        eye: Position of the eye [m]. Shape (3,).
        ground: Where avatars are, x and z [m], NaN while absent; of a crowd some stand for all. Shape (N, 2).

    Returns:
        Shape (n,), bool.
    """
    ground = ground[np.isfinite(ground).all(axis=1)]
    ground = ground[:: max(1, len(ground) // _LOOKED_AT)].astype(float)
    found = np.zeros(len(parts), bool)
    for number, part in enumerate(parts):
        along, across = np.array([part["ux"], part["uz"]]), np.array([-part["uz"], part["ux"]])
        axes, middle = np.array([along, across]), np.array([part["x"], part["z"]])
        half = np.array([part["half_along"], part["half_across"]]) + part["radius"]
        start, way = axes @ (eye[[0, 2]] - middle), (ground - eye[[0, 2]]) @ axes.T
        way = np.where(np.abs(way) < 1e-9, 1e-9, way)
        ends = np.sort(np.stack([(-half - start) / way, (half - start) / way]), axis=0)
        first, last = np.maximum(ends[0].max(axis=1), 0.0), np.minimum(ends[1].min(axis=1), 1.0)
        # The line of sight to the middle of a trunk is lowest where it leaves the part.
        low = eye[1] + (_TRUNK - eye[1]) * np.stack([first, last])
        hides = ((first < last) & (low.min(axis=0) < part["height"])).any()
        is_close = np.linalg.norm(np.maximum(np.abs(start) - half, 0.0)) < _CLOSE and eye[1] < part["height"] + _CLOSE
        found[number] = hides or is_close
    return found


@lru_cache(maxsize=8)
def _scenery_of(packed: bytes) -> tuple[Capsules, PosedSkins]:
    """Return what shows parts that stand, given as bytes: most pictures of a video show the same ones."""
    shapes, paints, owners = [np.empty((0, 8))], [np.empty((0, 4))], [np.empty(0)]
    meshes, faced, sides, row = [], [], [np.empty(0)], 0
    for number, part in enumerate(np.frombuffer(packed, PART)):
        lines, paint = _lines_of(part)
        shapes.append(lines)
        paints.append(np.broadcast_to(paint, (len(lines), 4)))
        owners.append(np.full(len(lines), -2 - number))
        if int(part["kind"]) != ROPES:
            mesh = refined(mesh_of(part), _EDGE)
            meshes.append(mesh)
            # Sides of one part are figures of their own, between which edges are as smooth as between others.
            around = [[part["ux"], 0.0, part["uz"]], [-part["uz"], 0.0, part["ux"]], [0.0, 1.0, 0.0]]
            towards = mesh.normals[mesh.triangles].mean(axis=1) @ np.array(around).T
            sides.append(8 * (-2 - number) - np.concatenate([towards, -towards], axis=1).argmax(axis=1))
            faced.append((number, int(part["kind"]), row))
        row += len(lines)
    capsules = Capsules(
        np.concatenate(shapes).astype(np.float32),
        np.concatenate(paints).astype(np.float32),
        np.concatenate(owners).astype(np.int32),
    )
    mesh = join_meshes(meshes)
    numbers, kinds, rows = np.array(faced, np.int32).reshape(-1, 3).T
    counts = [len(one.triangles) for one in meshes]
    return capsules, PosedSkins(
        -2 - numbers.astype(np.int64),
        mesh.positions.astype(np.float32),
        mesh.normals.astype(np.float32),
        mesh.triangles.astype(np.int32),
        np.concatenate(sides).astype(np.int32),
        np.repeat(kinds, counts),
        np.repeat(rows, counts),
        np.array([OBSTACLE_PAINTS[kind] for kind in range(len(OBSTACLE_PAINTS))], np.float32),
    )


def _lines_of(part: Array) -> tuple[Array, Array]:
    """Return the capsules of a part, both ends and both radii (m, 8), and their paints (m, 4) or (4,)."""
    kind, height, radius = int(part["kind"]), float(part["height"]), float(part["radius"])
    along = np.array([part["ux"], part["uz"]])
    across = np.array([-part["uz"], part["ux"]])
    middle = np.array([part["x"], part["z"]])
    reach, aside = float(part["half_along"]) * along, float(part["half_across"]) * across
    if kind == ROPES:
        levels = height * (1.0 + np.arange(ROPE_LEVELS)) / ROPE_LEVELS - radius
        lines = [_line(middle - reach, middle + reach, level, level, radius) for level in levels]
        post = _line(middle - reach, middle - reach, 0.0, height, POST)
        return np.array([*lines, post]), np.array([*([OBSTACLE_PAINTS[ROPES]] * ROPE_LEVELS), _POST_PAINT])
    paint = np.array(OBSTACLE_PAINTS[kind])
    if kind == DISC:
        top = max(height - radius, 0.0)
        return np.array([_line(middle, middle, 0.0, top, radius)]), paint
    if kind == BOX:
        faces = []
        inner = _FACE / np.array([max(np.linalg.norm(reach), _FACE), max(np.linalg.norm(aside), _FACE)])
        reach, aside = reach * (1.0 - inner[0]), aside * (1.0 - inner[1])
        for level in _levels(height, _FACE):
            corners = [middle + s * reach + t * aside for s, t in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
            faces += [_line(a, b, level, level, _FACE) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
        count = math.ceil(2.0 * float(np.linalg.norm(aside)) / (_GROOVE * 2 * _FACE)) + 1
        shares = np.linspace(-1.0, 1.0, count)
        top = height - _FACE
        faces += [_line(middle - reach + t * aside, middle + reach + t * aside, top, top, _FACE) for t in shares]
        return np.array(faces), paint
    thick = min(radius, _MOST_RADIUS)
    lines = []
    for share in np.linspace(-1.0, 1.0, 1 if radius == thick else math.ceil((radius - thick) / thick) + 1):
        offset = share * (radius - thick) * across
        lines += [
            _line(middle - reach + offset, middle + reach + offset, level, level, thick)
            for level in _levels(height, thick)
        ]
    return np.array(lines), paint


def _levels(height: float, radius: float) -> Array:
    """Return the heights of capsules of a radius one above another, from the floor to a height [m]."""
    top = max(height - radius, 0.0)
    return np.linspace(0.0, top, math.ceil(top / (2.0 * _GROOVE * radius)) + 1)


def _line(start: Array, end: Array, low: float, high: float, radius: float) -> Array:
    """Return a capsule over the ground from a point and height to others. Shape (8,)."""
    return np.array([start[0], low, start[1], end[0], high, end[1], radius, radius])

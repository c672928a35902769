"""Obstacles as triangles: upright walls, boxes and discs with rounded ends, and ropes between posts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.places.kernels.records import BOX, DISC, DOOR, ROPES, WALL

OBSTACLE_KINDS = {WALL: "wall", BOX: "box", DISC: "disc", ROPES: "ropes", DOOR: "door"}
OBSTACLE_PAINTS = {
    WALL: (0.36, 0.33, 0.30, 0.05),
    BOX: (0.25, 0.17, 0.10, 0.10),
    DISC: (0.30, 0.31, 0.33, 0.15),
    ROPES: (0.55, 0.03, 0.03, 0.3),
    DOOR: (0.12, 0.09, 0.07, 0.25),
}
"""Linear colours of obstacles, and how much they shine."""
ROPE_LEVELS, POST = 3, 0.05
"""Ropes above one another, and the radius of the posts between them [m]."""
_ROUND = 32
"""Sides of a full circle."""


class Mesh(NamedTuple):
    """Triangles with vertices of their own at every edge; V vertices.

    Attributes:
        positions: Positions [m]. Shape (V, 3).
        normals: Outward normals of unit length. Shape (V, 3).
        triangles: Vertices of each triangle, counterclockwise from outside. Shape (T, 3).
    """

    positions: Array
    normals: Array
    triangles: Array


def mesh_of(part: Array) -> Mesh:
    """Return a part of an obstacle as triangles, a closed surface or several.

    Args:
        part: The part, a ``PART``.
    """
    along = np.array([part["ux"], 0.0, part["uz"]])
    across = np.array([-part["uz"], 0.0, part["ux"]])
    middle, up = np.array([part["x"], 0.0, part["z"]]), np.array([0.0, 1.0, 0.0])
    half, radius, height = float(part["half_along"]), float(part["radius"]), float(part["height"])
    if int(part["kind"]) != ROPES:
        return _prism(middle, (along, across, up), (half, float(part["half_across"])), radius, height)
    start = middle - half * along
    ropes = [
        _prism(start + level * up, (across, up, along), (0.0, 0.0), radius, 2.0 * half)
        for level in height * (1.0 + np.arange(ROPE_LEVELS)) / ROPE_LEVELS - radius
    ]
    return join_meshes([*ropes, _prism(start, (along, across, up), (0.0, 0.0), POST, height)])


def refined(mesh: Mesh, most: float) -> Mesh:
    """Return a mesh without common vertices whose edges are no longer than ``most`` [m]."""
    done = []
    corners = np.stack([mesh.positions[mesh.triangles], mesh.normals[mesh.triangles]], axis=2)
    while len(corners):
        lengths = np.linalg.norm(corners[:, :, 0] - np.roll(corners[:, :, 0], -1, axis=1), axis=2)
        is_short = lengths.max(axis=1) <= most
        done.append(corners[is_short])
        corners, longest = corners[~is_short], lengths[~is_short].argmax(axis=1)
        # Both halves of the longest edge, which comes first.
        corners = np.take_along_axis(corners, ((longest[:, None] + np.arange(3)) % 3)[:, :, None, None], axis=1)
        middle = 0.5 * (corners[:, 0] + corners[:, 1])
        first, second = corners.copy(), corners.copy()
        first[:, 1], second[:, 0] = middle, middle
        corners = np.concatenate([first, second])
    found = np.concatenate([np.empty((0, 3, 2, 3)), *done])
    normals = found[:, :, 1].reshape(-1, 3)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(found[:, :, 0].reshape(-1, 3), normals, np.arange(3 * len(found)).reshape(-1, 3))


def area_of(parts: Array) -> float:
    """Return the area of the surface of parts of obstacles (n,), ``PART`` [m2]."""
    return sum(float(triangle_areas(mesh.positions[mesh.triangles]).sum()) for mesh in map(mesh_of, parts))


def triangle_areas(corners: Array) -> Array:
    """Return the area of triangles (T, 3, 3) [m2]. Shape (T,)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(normals, axis=1))


def flat_mesh(corners: Array) -> Mesh:
    """Return triangles (T, 3, 3) [m] as a mesh with flat faces, those without an area left out."""
    corners = corners.astype(float)
    corners = corners[triangle_areas(corners) > 0.0]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), np.repeat(normals, 3, axis=0), triangles)


def join_meshes(meshes: list[Mesh]) -> Mesh:
    """Return meshes as one."""
    firsts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    return Mesh(
        np.concatenate([np.empty((0, 3)), *(mesh.positions for mesh in meshes)]),
        np.concatenate([np.empty((0, 3)), *(mesh.normals for mesh in meshes)]),
        np.concatenate([
            np.empty((0, 3), np.int64),
            *(mesh.triangles + first for mesh, first in zip(meshes, firsts, strict=False)),
        ]),
    )  # fmt: skip


def _prism(
    base: Array, axes: tuple[Array, Array, Array], half: tuple[float, float], radius: float, length: float
) -> Mesh:
    """Return all points within a radius of a rectangle, drawn out along the third axis from a base."""
    steps = max(1, _ROUND // 4) if radius > 0.0 else 1
    angles = np.array([
        quarter * math.pi / 2 + step * math.pi / (2 * steps) for quarter in range(4) for step in range(steps + 1)
    ])  # fmt: skip
    corner = np.repeat(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]), steps + 1, axis=0) * np.array(half)
    frame = np.array(axes)
    if np.linalg.det(frame) < 0.0:
        # Around such axes the other way is counterclockwise.
        angles, corner = angles[::-1], corner[::-1]
    outward = np.column_stack([np.cos(angles), np.sin(angles)])
    rim, normals = (corner + radius * outward) @ frame[:2] + base, outward @ frame[:2]
    count, far = len(rim), length * frame[2]
    first = np.arange(count)
    beside = np.roll(first, -1)
    sides = np.concatenate([
        np.column_stack([first, beside, beside + count]), np.column_stack([first, beside + count, first + count]),
    ])  # fmt: skip
    fan = np.column_stack([np.zeros(count - 2, np.int64), first[1:-1], first[2:]])
    caps = np.concatenate([fan[:, ::-1] + 2 * count, fan + 3 * count])
    positions = np.concatenate([rim, rim + far, rim, rim + far])
    flat = np.broadcast_to(frame[2], rim.shape)
    triangles = np.concatenate([sides, caps])
    return Mesh(
        positions,
        np.concatenate([normals, normals, -flat, flat]),
        triangles[triangle_areas(positions[triangles]) > 1e-12],
    )

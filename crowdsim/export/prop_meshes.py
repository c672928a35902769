"""What avatars carry as triangles in the frames of joints, for files whose readers move joints themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.cast import Cast
from crowdsim.places.mesh import Mesh, flat_mesh, join_meshes, triangle_areas

GLOSS = 0.15
"""How much props shine."""
_FINE, _COARSE = (16, 4), (6, 1)
"""Sides of capsules and rings of each of their ends, for props of few and of many capsules."""
_FEW = 64
"""Capsules of a prop that has fine ones, at the most."""


@dataclass(frozen=True)
class PropMesh:
    """All that avatars of a type carry at a joint.

    Attributes:
        joint: The joint.
        parts: A mesh in the joint's frame for each colour, and that colour, linear red, green and blue.
        key: The same for props that are alike, whichever type carries them.
    """

    joint: int
    parts: list[tuple[Mesh, tuple[float, float, float]]]
    key: bytes


def prop_meshes(cast: Cast, kind: int) -> list[PropMesh]:
    """Return what avatars of a type carry, by joints, ascending.

    Args:
        cast: All avatars.
        kind: Number of the type.
    """
    props, faces = (rows[rows["type"] == kind] for rows in (cast.attachments, cast.faces))
    found = []
    for joint in np.union1d(props["joint"], faces["joint"]):
        capsules, triangles = props[props["joint"] == joint], faces[faces["joint"] == joint]
        sides, rings = _FINE if len(capsules) <= _FEW else _COARSE
        parts = []
        colours, own = np.unique(np.concatenate([capsules["colour"], triangles["colour"]]), axis=0, return_inverse=True)
        own, count = own.reshape(-1), len(capsules)
        shares = np.split(np.argsort(own, kind="stable"), np.cumsum(np.bincount(own))[:-1])
        for colour, rows in zip(colours, shares, strict=True):
            flat = triangles[rows[rows >= count] - count]
            meshes = [
                capsule_mesh(row["start"].astype(float), row["end"].astype(float), float(row["radius"]), sides, rings)
                for row in capsules[rows[rows < count]]
            ]
            # Colours are linear in files and pictures; those of types are as screens show them.
            red, green, blue = (round(float(value) ** 2, 4) for value in colour)
            mesh = join_meshes([*meshes, flat_mesh(flat["corners"])])
            if len(mesh.triangles):
                parts.append((mesh, (red, green, blue)))
        names = ("start", "end", "radius", "colour")
        key = [capsules[name] for name in names] + [triangles[name] for name in ("corners", "colour")]
        if parts:
            found.append(PropMesh(int(joint), parts, b"".join(values.tobytes() for values in key)))
    return found


def capsule_mesh(start: Array, end: Array, radius: float, sides: int, rings: int) -> Mesh:
    """Return a capsule as a closed surface of triangles, with the capsule's own normals.

    Args:
        start: One end of its axis [m]. Shape (3,).
        end: The other end [m]. Shape (3,).
        radius: Its radius [m].
        sides: Sides around it.
        rings: Rings of vertices of each of its ends, that of the full radius included.
    """
    along = end - start
    length = float(np.linalg.norm(along))
    up = along / length if length > 0.0 else np.array([0.0, 1.0, 0.0])
    across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    across /= np.linalg.norm(across)
    frame = np.array([across, np.cross(up, across), up])
    # Rings from one pole to the other; an end's full ring is there once for each end.
    heights = 0.5 * np.pi * np.arange(1, rings + 1) / rings
    angles = np.concatenate([heights - 0.5 * np.pi, 0.5 * np.pi - heights[::-1]])
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(sides)], axis=1)
    normals = np.cos(angles)[:, None, None] * ring + np.sin(angles)[:, None, None] * [0.0, 0.0, 1.0]
    normals = np.concatenate([[[0.0, 0.0, -1.0]], normals.reshape(-1, 3), [[0.0, 0.0, 1.0]]]) @ frame
    centres = np.repeat([start, end], 1 + rings * sides, axis=0)
    first = 1 + np.arange((2 * rings - 1) * sides)
    beside = first - (first - 1) % sides + first % sides
    bottom, top = 1 + np.arange(sides), 1 + (2 * rings - 1) * sides + np.arange(sides)
    triangles = np.concatenate([
        np.column_stack([np.zeros(sides, np.int64), np.roll(bottom, -1), bottom]),
        np.column_stack([first, beside, beside + sides]),
        np.column_stack([first, beside + sides, first + sides]),
        np.column_stack([np.full(sides, len(normals) - 1), top, np.roll(top, -1)]),
    ])  # fmt: skip
    positions = centres + radius * normals
    if length == 0.0:
        # Both full rings are one, with nothing between them.
        triangles = triangles[triangle_areas(positions[triangles]) > 1e-9 * radius * radius]
    return Mesh(positions, normals, triangles)

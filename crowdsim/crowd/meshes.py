"""Meshes of props from OBJ files, and the rods that show their faces."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from crowdsim.core.types import Array

MOST_TRIANGLES, _MOST_BYTES = 500, 4 << 20
_APART, _MOST_RODS = 0.02, 12
"""How far apart rods on a face lie [m], and how many they are at the most."""
THINNEST = 0.004
"""Radius of rods at the least [m]."""


class MeshError(Exception):
    """A file is no mesh that can be used: what is wrong with it."""


def read_obj(path: Path) -> tuple[Array, Array]:
    """Return the vertices (V, 3) and triangles (T, 3) of an OBJ file; polygons are cut into triangles.

    Raises:
        MeshError: It cannot be read, is no OBJ file, or has no triangles, too many, or none with an area.
    """
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise MeshError(f"has {size:,} bytes, expected at most {_MOST_BYTES:,}")
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"cannot be read: {error.strerror}") from None
    vertices: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), start=1):
        word, *rest = line.split() or [""]
        try:
            if word == "v":
                vertices.append([float(value) for value in rest[:3]])
                if len(vertices[-1]) < 3 or not all(map(math.isfinite, vertices[-1])):
                    raise ValueError
            elif word == "f":
                corners = [int(corner.split("/")[0]) for corner in rest]
                corners = [corner - 1 if corner > 0 else len(vertices) + corner for corner in corners]
                if len(corners) < 3 or not all(0 <= corner < len(vertices) for corner in corners):
                    raise ValueError
                triangles += [(corners[0], b, c) for b, c in pairwise(corners[1:])]
        except ValueError:
            raise MeshError(f"line {number}: is no vertex or face of an OBJ file: {line.strip()[:40]!r}") from None
    if not triangles:
        raise MeshError("holds no faces, expected an OBJ file with lines 'v x y z' and 'f 1 2 3'")
    if len(triangles) > MOST_TRIANGLES:
        raise MeshError(f"has {len(triangles):,} triangles, expected at most {MOST_TRIANGLES}")
    points = np.array(vertices)
    first, second, third = points[np.array(triangles)].swapaxes(0, 1)
    # Of coordinates too large for areas these are infinite, or no numbers.
    with np.errstate(over="ignore", invalid="ignore"):
        areas = np.cross(second - first, third - first)
    if not areas.any():
        raise MeshError("has no area: the corners of each of its triangles are on a line")
    return points, np.array(triangles, np.int64)


def face_rods(triangles: Array) -> Array:
    """Return rods that lie side by side on triangles, parallel to the longest edge: both ends and a radius [m]. (R, 7).

    Args:
        triangles: Corners of each triangle [m]. Shape (T, 3, 3).
    """
    rods = []
    for corners in triangles:
        edges = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        first = int(np.argmax(edges))
        start, end, apex = corners[first], corners[(first + 1) % 3], corners[(first + 2) % 3]
        longest = float(edges[first])
        height = float(np.linalg.norm(np.cross(end - start, apex - start))) / max(longest, 1e-9)
        count = int(np.clip(math.ceil(height / _APART), 1, _MOST_RODS))
        radius = max(THINNEST, 0.55 * height / count)
        for share in (np.arange(count) + 0.25) / count:
            rods.append([*(start + share * (apex - start)), *(end + share * (apex - end)), radius])
    return np.array(rods).reshape(-1, 7)

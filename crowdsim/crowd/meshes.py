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


def face_rods(triangles: Array) -> tuple[Array, Array]:
    """Return rods that lie side by side on triangles, parallel to the longest edge, and the triangle that each is on.

    Args:
        triangles: Corners of each triangle [m]. Shape (T, 3, 3).

    Returns:
        Both ends and the radius of each rod [m]. Shape (R, 7). And the numbers of triangles. Shape (R,).
    """
    each = np.arange(len(triangles))
    edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    first = edges.argmax(axis=1)
    start, end, apex = (triangles[each, (first + corner) % 3] for corner in range(3))
    heights = np.linalg.norm(np.cross(end - start, apex - start), axis=1) / np.maximum(edges[each, first], 1e-9)
    counts = np.clip(np.ceil(heights / _APART), 1, _MOST_RODS).astype(int)
    radii = np.maximum(THINNEST, 0.55 * heights / counts)
    of = np.repeat(each, counts)
    places = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    shares = ((places + 0.25) / counts[of])[:, None]
    begins, ends = (side[of] + shares * (apex - side)[of] for side in (start, end))
    return np.concatenate([begins, ends, radii[of, None]], axis=1), of

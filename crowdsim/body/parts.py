"""Parts of a skin: hair, clothes, gloves and shoes, with lines between them that edges follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from crowdsim.body.anatomy import Build
from crowdsim.body.binding import SIDES, Binding
from crowdsim.body.meshing import cut, thicken, unpinched
from crowdsim.core.types import Array

SKIN_PARTS = (
    "skin", "hair", "brows", "eyes", "pupils", "lips", "top", "shorts", "band", "gloves", "cuffs", "shoes", "soles",
    "stripes", "hems", "crossings",
)  # fmt: skip

_HAIRLINE = {
    "male": ([-10, -7.5, -5.2, -4.2, -3.6, -3.0, -1.8, -0.4, 0.8, 1.8, 2.6, 3.4, 4.2, 5.2, 6.4, 8.0],
             [-5.3, -5.1, -4.4, -3.2, -0.6, 2.4, 3.4, 3.2, 1.4, 1.0, 2.0, 3.6, 4.7, 5.4, 5.8, 6.0]),
    "female": ([-10, -7.5, -5.2, -4.2, -3.6, -3.0, -1.8, -0.4, 0.8, 1.8, 2.6, 3.4, 4.2, 5.2, 6.4, 8.0],
               [-5.6, -5.4, -4.8, -3.6, -0.8, 2.4, 3.4, 3.0, 1.0, 0.5, 1.4, 3.2, 4.6, 5.5, 6.0, 6.3]),
}  # fmt: skip
"""Height over the middle of the head of the line where hair begins, by how far to the front [cm]."""
_SNAP, _CROSSING = 0.25, 0.02
"""Share of an edge up to which vertices near a line are moved onto it, and that where lines cross others."""
_STRIPE, _HEM = 2.2, 3.2
"""Half the width of the stripes at the sides of shorts, and the height of their hems [cm]."""


def wanted_lengths(binding: Binding, build: Build, coarseness: float = 1.0) -> Callable[[Array], Array]:
    """Return how long edges should be at points [m]: short in the face and at hands, long at the trunk."""
    size, segments = binding.size, binding.segments
    head = segments["head"].start
    spots = [(head + size * np.array([0.0, -0.02, 0.085]), 0.045, 0.0095), (head, 0.11, 0.0155)]
    spots += [
        (head + size * np.array([out, up, 0.08]), 0.016, 0.0055) for out in (-0.031, 0.031) for up in (-0.0045, 0.0135)
    ]
    spots += [(head + size * np.array([out, -0.065, 0.083]), 0.010, 0.0075) for out in (-0.012, 0.012)]
    spots += [(head + size * np.array([out, -0.008, -0.012]), 0.028, 0.0115) for out in (-0.075, 0.075)]
    for side in SIDES:
        hand, fore, shank, foot = (segments[f"{side}_{name}"] for name in ("hand", "forearm", "shank", "foot"))
        bare = build.hands == "bare"
        spots.append((hand.start + hand.axes[0] * hand.length, 0.075, 0.0085 if bare else 0.0150))
        spots.append((hand.start, 0.05, 0.016))
        spots.append((fore.start, 0.06, 0.016))
        spots.append((shank.start, 0.08, 0.019))
        spots.append((foot.start + foot.axes[0] * 0.5 * foot.length, 0.14, 0.018))
    spots.append((segments["trunk"].start + segments["trunk"].axes[0] * 0.45 * segments["trunk"].length
                  + [0, 0, 0.09 * size], 0.10, 0.017))  # fmt: skip

    def lengths(points: Array) -> Array:
        found = np.full(len(points), 0.0262 * size)
        columns = np.ascontiguousarray(points.T)
        for centre, radius, length in spots:
            x, y, z = columns - centre[:, None]
            beyond = np.maximum(np.sqrt(x * x + y * y + z * z) - radius * size, 0.0)
            np.minimum(found, length * size + 0.28 * beyond, out=found)
        return found * coarseness

    return lengths


def dress(
    vertices: Array, triangles: Array, binding: Binding, build: Build
) -> tuple[Array, Array, Array, Callable[[Array, Array], tuple[Array, Array, Array, Array]]]:
    """Cut a skin along the lines of its parts.

    Args:
        vertices: Shape (V, 3).
        triangles: Shape (F, 3).
        binding: The binding pose.
        build: What the body is like.

    Returns:
        Vertices; triangles; part of each triangle, an index into ``SKIN_PARTS``; and a function that raises clothes,
        hair and shoes over the skin along normals and returns vertices, triangles, parts, and which vertex each
        copy was.
    """
    lines = _lines(binding, build)
    parts = np.zeros(len(triangles), np.int64)
    for part, *values in lines:
        within = np.ones(len(triangles), bool)
        # Lines that cross others move no vertices of these.
        snap = _CROSSING if part in ("stripes", "hems", "crossings") else _SNAP
        for value in values:
            numbers = np.arange(len(triangles))
            vertices, triangles, numbers, inside = cut(vertices, triangles, numbers, value(vertices), snap)
            parts, within = parts[numbers], within[numbers] & inside
        if part == "stripes":
            within &= _outside(binding, vertices[triangles].mean(axis=1))
        parts[within & np.isin(parts, _UNDER[part])] = SKIN_PARTS.index(part)

    def raised(vertices: Array, normals: Array) -> tuple[Array, Array, Array, Array]:
        made, kinds, origins = triangles, parts, np.arange(len(vertices))
        for names, amount in _thicknesses(binding, build):
            numbers = [SKIN_PARTS.index(name) for name in names]
            group = unpinched(made, np.isin(kinds, numbers))
            kinds = np.where(group & ~np.isin(kinds, numbers), numbers[0], kinds)
            if group.any():
                vertices, made, owners, line = thicken(
                    vertices, made, group, amount(vertices)[:, None] * normals[origins]
                )
                kinds = np.concatenate([kinds, kinds[owners]])
                origins = np.concatenate([origins, origins[line]])
        return vertices, made, kinds, origins

    return vertices, triangles, parts, raised


_UNDER = {
    name: [SKIN_PARTS.index(under) for under in unders]
    for name, unders in {
        "hair": ("skin",), "brows": ("skin",), "eyes": ("skin",), "pupils": ("eyes",), "lips": ("skin",),
        "top": ("skin",), "shorts": ("skin",),
        "band": ("shorts",), "stripes": ("shorts",), "hems": ("shorts",), "crossings": ("stripes",),
        "gloves": ("skin",), "cuffs": ("gloves",), "shoes": ("skin",), "soles": ("shoes",),
    }.items()
}  # fmt: skip
"""Parts in whose place each comes."""


def _coordinates(binding: Binding, name: str, points: Array) -> Array:
    """Coordinates of points along the axes of a segment for a body of the usual size [cm]. Shape (n, 3)."""
    segment = binding.segments[name]
    return np.asarray((points - segment.start) @ segment.axes.T / (0.01 * binding.size))


def _outside(binding: Binding, points: Array) -> Array:
    """Which points (n, 3) are on the outer side of thighs. Shape (n,), bool."""
    thighs = [binding.segments[f"{side}_thigh"] for side in SIDES]
    out = [points[:, 0] - one.start[0] - (points - one.start) @ one.axes[0] * one.axes[0, 0] for one in thighs]
    return (out[0] > 0) | (out[1] < 0)


def _lines(binding: Binding, build: Build) -> list[tuple[Any, ...]]:
    """Each part with functions of points that are positive where it is [m], in the order in which they are cut.

    A part that is narrower than edges may be long has a line for each border: edges cross both of them.
    """
    size = binding.size
    middle = binding.segments["trunk"].start[0]
    trunk = 100 * binding.segments["trunk"].length / size

    def both(distance: Callable[[str, Array], Array]) -> Callable[[Array], Array]:
        return lambda points: 0.01 * np.maximum(distance("left", points), distance("right", points))

    def hair(points: Array) -> Array:
        up, front, _ = _coordinates(binding, "head", points).T
        return 0.01 * (up - np.interp(front, *_HAIRLINE[build.sex]))

    def blob(
        up: float, front: float, out: float, radii: tuple[float, float], tilt: float = 0.0
    ) -> Callable[[Array], Array]:
        def value(points: Array) -> Array:
            u, f, o = _coordinates(binding, "head", points).T
            o = np.abs(o)
            across, high = o - out, u - up - tilt * (o - out)
            flat = np.sqrt((across / radii[0]) ** 2 + (high / radii[1]) ** 2)
            return 0.01 * np.minimum((1.0 - flat) * radii[1], f - front)

        return value

    def shorts(points: Array) -> Array:
        found = []
        for sign, side in zip((1.0, -1.0), SIDES, strict=True):
            thigh = 100 * binding.segments[f"{side}_thigh"].length / size
            hem = 0.50 * thigh - _coordinates(binding, f"{side}_thigh", points)[:, 0]
            found.append(np.where(sign * (points[:, 0] - middle) >= 0, hem, np.inf))
        waist = 0.185 * trunk - _coordinates(binding, "trunk", points)[:, 0]
        aside = 31.0 - 100 * np.abs(points[:, 0] - middle) / size
        return 0.01 * np.minimum(np.minimum(found[0], found[1]), np.minimum(waist, aside))

    def near(value: Callable[[Array], Array]) -> Callable[[Array], Array]:
        # Lines on shorts end just beyond them.
        return lambda points: np.minimum(value(points), shorts(points) + 0.01)

    def stripe(ahead: float) -> Callable[[Array], Array]:
        def value(points: Array) -> Array:
            found = []
            for side in SIDES:
                thigh = binding.segments[f"{side}_thigh"]
                from_hip = points - thigh.start
                found.append(
                    _STRIPE - 100 * ahead * (from_hip[:, 2] - from_hip @ thigh.axes[0] * thigh.axes[0, 2]) / size
                )
            return 0.01 * np.where(points[:, 0] >= middle, *found)

        return value

    def hem(points: Array) -> Array:
        below = [
            _coordinates(binding, f"{side}_thigh", points)[:, 0]
            - 50 * binding.segments[f"{side}_thigh"].length / size
            + _HEM
            for side in SIDES
        ]
        return 0.01 * np.where(points[:, 0] >= middle, *below)

    def band(points: Array) -> Array:
        return 0.01 * (_coordinates(binding, "trunk", points)[:, 0] - 0.115 * trunk)

    def top(points: Array) -> Array:
        up = _coordinates(binding, "trunk", points)[:, 0]
        aside = 17.2 - 100 * np.abs(points[:, 0] - middle) / size
        return 0.01 * np.minimum(np.minimum(up - 0.545 * trunk, 0.775 * trunk - up), aside)

    def sleeve(from_wrist: float) -> Callable[[Array], Array]:
        def distance(side: str, points: Array) -> Array:
            own = _coordinates(binding, f"{side}_hand", points)
            return np.minimum(own[:, 0] - from_wrist, 16.0 - np.hypot(own[:, 1], own[:, 2]))

        return both(distance)

    def shoe(side: str, points: Array) -> Array:
        own, length = (
            _coordinates(binding, f"{side}_shank", points),
            100 * binding.segments[f"{side}_shank"].length / size,
        )
        return np.minimum(own[:, 0] - 0.68 * length, 36.0 - np.hypot(own[:, 1], own[:, 2]))

    def sole(side: str, points: Array) -> Array:
        return 1.5 - _coordinates(binding, f"{side}_foot", points)[:, 1]

    lines: list[tuple[Any, ...]] = [
        ("hair", hair), ("shorts", shorts), ("band", band),
        ("stripes", near(stripe(1.0)), near(stripe(-1.0))), ("hems", near(hem)), ("crossings", near(hem)),
        ("shoes", both(shoe)), ("soles", both(sole)),
        ("eyes", blob(-0.45, 5.5, 3.15, (1.35, 0.62), 0.10)),
        ("pupils", blob(-0.42, 5.5, 3.1, (0.55, 0.62))),
        ("brows", blob(1.35, 4.5, 3.3, (2.1, 0.42), -0.10)),
        ("lips", blob(-6.45, 5.0, 0.0, (2.5, 0.85))),
    ]  # fmt: skip
    if build.sex == "female":
        lines.append(("top", top))
    if build.hands == "gloves":
        lines += [("gloves", sleeve(-6.2)), ("cuffs", lambda points: -sleeve(0.6)(points))]
    return lines


def _thicknesses(binding: Binding, build: Build) -> list[tuple[tuple[str, ...], Callable[[Array], Array]]]:
    """Parts that are raised together, and how far [m]."""
    size = 0.01 * binding.size

    def even(amount: float) -> Callable[[Array], Array]:
        return lambda points: np.full(len(points), amount * size)

    def flared(points: Array) -> Array:
        share = np.maximum(*(_coordinates(binding, f"{side}_thigh", points)[:, 0] for side in SIDES)) / 21.0
        return size * (0.45 + 1.1 * np.clip(share, 0.0, 1.0))

    def grown(points: Array) -> Array:
        up, front, _ = _coordinates(binding, "head", points).T
        return size * np.clip(0.25 + 0.14 * (up - np.interp(front, *_HAIRLINE[build.sex])), 0.25, 0.9)

    return [(("hair",), grown), (("shorts", "band", "stripes", "hems", "crossings"), flared),
            (("top",), even(0.3)), (("gloves", "cuffs"), even(0.35)),
            (("shoes", "soles"), even(0.3))]  # fmt: skip

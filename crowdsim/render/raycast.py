"""Pictures of capsules over a ground, ray-cast on the processor."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from crowdsim.core.types import Array
from crowdsim.render.kernels.capsules import (
    choose_capsules,
    contact_segments,
    near_capsules,
    shadow_bounds,
    shadow_segments,
    view_capsules,
)
from crowdsim.render.kernels.cells import count_entries, fill_entries
from crowdsim.render.kernels.columns import (
    A_RADIUS,
    CENTRE_X,
    CENTRE_Z,
    COLUMNS,
    EYE_X,
    FOCAL,
    GREATEST_U,
    GREATEST_V,
    GRID_U,
    GRID_V,
    HALF_X,
    HALF_Z,
    LEAST_U,
    LEAST_V,
    LIGHT,
    MIDDLE_X,
    MIDDLE_Y,
    PER_METRE,
    RADIUS,
    REACH,
    RIGHT_X,
    ROWS,
    SOFTNESS,
    SUN_RED,
    SUN_X,
    SUN_Y,
    U_X,
    V_X,
    WIDEST,
)
from crowdsim.render.kernels.drawing import draw_tiles
from crowdsim.render.kernels.records import Cones, Grids, Lists, Skins
from crowdsim.render.kernels.skins import choose_triangles, list_triangles, project_skins
from crowdsim.render.look import Look
from crowdsim.render.view import View

SUN_ELEVATION = math.radians(52.0)
SUN_SOFTNESS = 0.030
"""Tangent of the sun's apparent radius; the true sun's is 0.005, which looks hard on a smooth floor."""
SHADOW_REACH = 3.0
"""How far out of view a capsule may be whose shadow is still visible [m]."""
CONTACT_REACH = 0.30
"""Distance from the floor at which a capsule stops to darken it [m]."""
SMALLEST = 0.12
"""Capsules that cover fewer pixels than this are left out."""
LINE = 0.04
"""Half the width of the line around an arena [m]."""
THINNEST = 1.0
"""Capsules that show thinner than this cast no shadow of their own [px]."""
_FINE = 28.0
"""Pixels a metre from which bodies darken their own creases."""
_NEIGHBOURS = 16


@dataclass(frozen=True)
class Capsules:
    """Rounded cones in the world, those of one avatar beside one another.

    Attributes:
        shapes: Both ends (3, 3) and both radii [m]. Shape (K, 8), float32.
        paints: Linear red, green, blue and gloss, each 0..1. Shape (K, 4), float32.
        owners: Avatar of each. Shape (K,), int32.
    """

    shapes: Array
    paints: Array
    owners: Array

    def joined(self, other: Capsules) -> Capsules:
        """Return these and others behind them."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("shapes", "paints", "owners"))
        return Capsules(*(np.concatenate(pair) for pair in pairs))


@dataclass(frozen=True)
class PosedSkins:
    """Skins of some avatars in the world; V vertices and T triangles in all.

    Attributes:
        avatars: The avatars, ascending; their capsules only cast shadows and darken creases. Shape (n,), int64.
        vertices: Shape (V, 3) [m], float32.
        normals: Unit. Shape (V, 3), float32.
        triangles: Corners, counter-clockwise from outside. Shape (T, 3), int32.
        owners: Avatar of each triangle. Shape (T,), int32.
        looks: Row of its paint. Shape (T,), int32.
        homes: Row of ``Capsules`` on which it lies. Shape (T,), int32.
        paints: Linear red, green, blue and gloss. Shape (P, 4), float32.
    """

    avatars: Array
    vertices: Array
    normals: Array
    triangles: Array
    owners: Array
    looks: Array
    homes: Array
    paints: Array


@dataclass(frozen=True)
class Flashes:
    """Moments at which strikes reach furthest.

    Attributes:
        points: Where [m]. Shape (H, 3).
        ages: Time since, as a share of the time that a flash lasts, 0..1. Shape (H,).
        powers: Brightness, about 1. Shape (H,).
        outcomes: Numbers of ``crowd.events.OUTCOMES``, which marks follow. Shape (H,).
    """

    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    ages: Array = field(default_factory=lambda: np.zeros(0))
    powers: Array = field(default_factory=lambda: np.zeros(0))
    outcomes: Array = field(default_factory=lambda: np.zeros(0, np.uint8))


def sun_direction(azimuth: float, elevation: float = SUN_ELEVATION) -> Array:
    """Return the unit direction to a sun at heading ``azimuth`` [rad], ``elevation`` [rad] high."""
    level = math.cos(elevation)
    return np.array([level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)])


def draw(
    capsules: Capsules,
    view: View,
    size: tuple[int, int],
    sun: Array,
    flashes: Flashes | None = None,
    threads: int = 1,
    arena: Array | None = None,
    look: Look | None = None,
    skins: PosedSkins | None = None,
) -> Array:
    """Draw one picture; the same arguments give the same bytes for any number of threads.

    Args:
        capsules: The figures, on the ground at y = 0.
        view: The camera.
        size: Width and height [px].
        sun: Unit direction to the sun, above the horizon. Shape (3,).
        flashes: Strikes.
        threads: How many threads share the picture.
        arena: Kind (0 none, 1 circle, 2 rectangle), centre x and z, half the sizes along x and z [m]; open ground by
            default. Shape (5,).
        look: Light and background.
        skins: Skins of some avatars, which are seen instead of their capsules.

    Returns:
        Red, green and blue, shape (height, width, 3), uint8; and how much of each pixel figures cover where the look is
        transparent, shape (height, width, 4).
    """
    width, height = size
    camera = view.pack(width, height)
    chosen = np.empty(len(capsules.shapes), np.int32)
    count = choose_capsules(capsules.shapes, camera, width, height, SHADOW_REACH, SMALLEST, chosen)
    chosen = chosen[:count]
    look = look or Look()
    light = np.zeros(LIGHT)
    light[SUN_RED:] = look.pack()
    across = np.cross(sun, [0.0, 0.0, 1.0] if abs(sun[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    light[SUN_X:U_X], light[U_X:V_X], light[V_X:GRID_U], light[SOFTNESS] = (
        sun,
        across,
        np.cross(sun, across),
        SUN_SOFTNESS,
    )
    cones, shades = np.empty((count, 8), np.float32), np.empty((count, 9), np.float32)
    segments, spans = np.empty((count, 6), np.float32), np.empty((count, 2), np.int32)
    view_capsules(capsules.shapes, chosen, camera, light, cones, shades, segments, spans)
    owners = np.ascontiguousarray(capsules.owners[chosen])
    paints = np.ascontiguousarray(capsules.paints[chosen])
    neighbours = np.empty((count, _NEIGHBOURS), np.int32)
    near_capsules(cones, owners, camera, _FINE, neighbours)
    if skins is not None:
        segments[np.isin(owners, skins.avatars), A_RADIUS] = -1.0
    tiles = _lists(segments, (width + 7) // 8, (height + 7) // 8)
    faces, seen = _seen_skins(skins, chosen, len(capsules.shapes), camera, size)
    shadows = _shadow_lists(shades, cones, camera, light, segments)
    floor, contacts = _contact_lists(cones, camera, segments)
    picture = np.empty((height, width, 4 if look.transparent else 3), np.uint8)
    lamps = _project_flashes(flashes, camera)
    shared = (
        camera, light, floor, Cones(cones, spans, shades, paints, owners, neighbours), seen,
        Grids(tiles, faces, shadows, contacts), np.append(np.zeros(5) if arena is None else arena, LINE), lamps,
        picture,
    )  # fmt: skip
    if threads <= 1:
        draw_tiles(0, 1, *shared)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda first: draw_tiles(first, threads, *shared), range(threads)))
    return picture


def _seen_skins(
    skins: PosedSkins | None, chosen: Array, count: int, camera: Array, size: tuple[int, int]
) -> tuple[Lists, Skins]:
    """Triangles of skins that each tile may show, and the skins as the camera sees them; ``chosen`` of the capsules."""
    columns, rows = (size[0] + 7) // 8, (size[1] + 7) // 8
    offsets = np.zeros(columns * rows + 1, np.int32)
    if skins is None:
        none = np.zeros((0, 3), np.float32)
        numbers, paints = np.zeros(0, np.int32), np.zeros((0, 4), np.float32)
        return Lists(offsets, numbers), Skins(np.zeros((0, 3), np.int32), numbers, numbers, numbers, paints, none, none)
    screen = np.empty_like(skins.vertices)
    project_skins(0, len(screen), skins.vertices, camera, screen)
    faces, spans = np.empty(len(skins.triangles), np.int32), np.empty((len(skins.triangles), 4), np.int16)
    faces = faces[: choose_triangles(skins.triangles, screen, *size, columns, offsets, faces, spans)]
    entries = np.empty(int(offsets[-1]), np.int32)
    list_triangles(faces, spans, columns, offsets, entries)
    cones = np.full(count, -1, np.int32)
    cones[chosen] = np.arange(len(chosen), dtype=np.int32)
    homes = cones[skins.homes]
    return Lists(offsets, entries), Skins(
        skins.triangles, skins.owners, skins.looks, homes, skins.paints, screen, skins.normals
    )


def _lists(segments: Array, columns: int, rows: int) -> Lists:
    """CSR lists of the segments that touch each cell."""
    offsets = np.empty(columns * rows + 1, np.int32)
    count_entries(segments, columns, rows, offsets)
    entries = np.empty(max(int(offsets[-1]), 1), np.int32)
    fill_entries(segments, columns, rows, offsets, entries)
    return Lists(offsets, entries)


def _cells(extent_x: float, extent_y: float, finest: float, most: int) -> tuple[float, int, int]:
    """Size of a cell, columns and rows of a grid over an extent [m] with about ``most`` cells at the most."""
    cell = max(finest, math.sqrt(max(extent_x, finest) * max(extent_y, finest) / most))
    cell = max(cell, extent_x / most, extent_y / most)
    return cell, int(extent_x / cell) + 1, int(extent_y / cell) + 1


def _shadow_lists(shades: Array, cones: Array, camera: Array, light: Array, segments: Array) -> Lists:
    """Lists of the capsules that may shade each cell of light space; completes ``light``."""
    if not len(shades):
        light[PER_METRE], light[COLUMNS], light[ROWS] = 1.0, 1, 1
        return Lists(np.zeros(2, np.int32), np.zeros(1, np.int32))
    bounds = np.empty(4)
    shadow_bounds(shades, bounds)
    pad = SUN_SOFTNESS * 2.5 / light[SUN_Y] + 0.25
    bounds += [-pad, -pad, pad, pad]
    u, v = bounds[LEAST_U], bounds[LEAST_V]
    cell, columns, rows = _cells(bounds[GREATEST_U] - u, bounds[GREATEST_V] - v, 0.08, 400_000)
    light[GRID_U], light[GRID_V], light[PER_METRE], light[COLUMNS], light[ROWS] = u, v, 1.0 / cell, columns, rows
    # Where cells are large the crowd is far away, and shadows may blur over a pixel there.
    light[WIDEST] = max(0.05, 0.45 * cell)
    shadow_segments(shades, cones, camera, light, THINNEST, segments)
    return _lists(segments, columns, rows)


def _contact_lists(cones: Array, camera: Array, segments: Array) -> tuple[Array, Lists]:
    """Grid of the capsules on the floor or just over it, and its lists."""
    floor = np.array([0.0, 0.0, 1.0, 1.0, 1.0, CONTACT_REACH])
    if not len(cones):
        return floor, Lists(np.zeros(2, np.int32), np.zeros(1, np.int32))
    middle = cones[:, [CENTRE_X, CENTRE_Z]]
    around = np.abs(cones[:, [HALF_X, HALF_Z]]) + (cones[:, [RADIUS]] + CONTACT_REACH)
    low, high = (middle - around).min(axis=0), (middle + around).max(axis=0)
    cell, columns, rows = _cells(float(high[0] - low[0]), float(high[1] - low[1]), 0.15, 200_000)
    floor[:REACH] = low[0], low[1], 1.0 / cell, columns, rows
    contact_segments(cones, camera, floor, segments)
    return floor, _lists(segments, columns, rows)


def _project_flashes(flashes: Flashes | None, camera: Array) -> Array:
    """Positions of flashes on the picture, see ``draw_tiles``; those behind the eye fall out."""
    if flashes is None or not len(flashes.points):
        return np.zeros((0, 7), np.float32)
    basis = camera[RIGHT_X:FOCAL].reshape(3, 3)
    x, y, z = basis @ (np.asarray(flashes.points, float) - camera[EYE_X:RIGHT_X]).T
    seen = z > 0.2
    x, y, z = x[seen], y[seen], z[seen]
    focal = camera[FOCAL]
    # Far flashes fade, so that they do not hide a crowd.
    true = 0.24 * focal / z
    size = np.maximum(true, 2.0)
    fade = np.clip(true / 6.0, 0.2, 1.0)
    return np.stack(
        [
            camera[MIDDLE_X] + focal * x / z,
            camera[MIDDLE_Y] - focal * y / z,
            np.sqrt(x * x + y * y + z * z) - 0.45,
            size,
            np.asarray(flashes.ages, float)[seen],
            np.asarray(flashes.powers, float)[seen] * fade,
            np.asarray(flashes.outcomes, float)[seen],
        ],
        axis=1,
    ).astype(np.float32)

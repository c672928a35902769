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
from crowdsim.render.kernels.drawing import draw_tiles
from crowdsim.render.kernels.records import (
    ARENA,
    CAMERA,
    CAPSULE,
    CONE,
    FLASH,
    LIGHT,
    PAINT,
    SEGMENT,
    SHADE,
    SPAN,
    Cones,
    Grids,
    Lists,
    Plane,
    Skins,
    as_records,
)
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
    camera = view.pack(width, height).view(CAMERA)
    shapes = as_records(capsules.shapes, CAPSULE)
    chosen = np.empty(len(shapes), np.int32)
    count = choose_capsules(shapes, camera, width, height, SHADOW_REACH, SMALLEST, chosen)
    chosen = chosen[:count]
    look = look or Look()
    across = np.cross(sun, [0.0, 0.0, 1.0] if abs(sun[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    light = np.concatenate([sun, across, np.cross(sun, across), [SUN_SOFTNESS, 0.0], look.pack()]).view(LIGHT)
    cones, shades = np.empty(count, CONE), np.empty(count, SHADE)
    segments, spans = np.empty(count, SEGMENT), np.empty(count, SPAN)
    view_capsules(shapes, chosen, camera, light, cones, shades, segments, spans)
    owners = np.ascontiguousarray(capsules.owners[chosen])
    paints = as_records(capsules.paints, PAINT)[chosen]
    neighbours = np.empty((count, _NEIGHBOURS), np.int32)
    near_capsules(cones, owners, camera, _FINE, neighbours)
    if skins is not None:
        segments["a_radius"][np.isin(owners, skins.avatars)] = -1.0
    tiles = _lists(segments, (width + 7) // 8, (height + 7) // 8)
    faces, seen = _seen_skins(skins, chosen, len(shapes), camera, size)
    lit, shadows = _shadow_lists(shades, cones, camera, light, segments)
    floor, contacts = _contact_lists(cones, camera, segments)
    picture = np.empty((height, width, 4 if look.transparent else 3), np.uint8)
    lamps = _project_flashes(flashes, camera)
    shared = (
        camera, light, Cones(cones, spans, shades, paints, owners, neighbours), seen,
        Grids(tiles, faces, lit, shadows, floor, contacts, CONTACT_REACH),
        np.append(np.zeros(5) if arena is None else arena, LINE).view(ARENA), lamps, picture,
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
        numbers, paints = np.zeros(0, np.int32), np.zeros(0, PAINT)
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
        skins.triangles, skins.owners, skins.looks, homes, as_records(skins.paints, PAINT), screen, skins.normals
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


def _shadow_lists(shades: Array, cones: Array, camera: Array, light: Array, segments: Array) -> tuple[Plane, Lists]:
    """Plane across the light, and the capsules that may shade its cells; completes ``light``."""
    if not len(shades):
        return Plane(0.0, 0.0, 1.0, 1.0, 1.0), Lists(np.zeros(2, np.int32), np.zeros(1, np.int32))
    pad = SUN_SOFTNESS * 2.5 / light["sun_y"][0] + 0.25
    bounds = shadow_bounds(shades) + np.array([-pad, -pad, pad, pad])
    cell, columns, rows = _cells(bounds[2] - bounds[0], bounds[3] - bounds[1], 0.08, 400_000)
    plane = Plane(float(bounds[0]), float(bounds[1]), float(1.0 / cell), float(columns), float(rows))
    # Where cells are large the crowd is far away, and shadows may blur over a pixel there.
    light["widest"] = max(0.05, 0.45 * cell)
    shadow_segments(shades, cones, camera, light, plane, THINNEST, segments)
    return plane, _lists(segments, columns, rows)


def _contact_lists(cones: Array, camera: Array, segments: Array) -> tuple[Plane, Lists]:
    """Plane of the floor, and the capsules on it or just over it in its cells."""
    if not len(cones):
        return Plane(0.0, 0.0, 1.0, 1.0, 1.0), Lists(np.zeros(2, np.int32), np.zeros(1, np.int32))
    around = cones["radius"] + CONTACT_REACH
    low, high = [], []
    for middle, half in (("centre_x", "half_x"), ("centre_z", "half_z")):
        reach = np.abs(cones[half]) + around
        low.append((cones[middle] - reach).min())
        high.append((cones[middle] + reach).max())
    cell, columns, rows = _cells(float(high[0] - low[0]), float(high[1] - low[1]), 0.15, 200_000)
    plane = Plane(float(low[0]), float(low[1]), 1.0 / cell, float(columns), float(rows))
    contact_segments(cones, camera, plane, CONTACT_REACH, segments)
    return plane, _lists(segments, columns, rows)


def _project_flashes(flashes: Flashes | None, camera: Array) -> Array:
    """Positions of flashes on the picture; those behind the eye fall out. Shape (H,), ``FLASH``."""
    if flashes is None or not len(flashes.points):
        return np.zeros(0, FLASH)
    seen_from = camera.view(np.float64)
    x, y, z = seen_from[3:12].reshape(3, 3) @ (np.asarray(flashes.points, float) - seen_from[:3]).T
    seen = z > 0.2
    x, y, z = x[seen], y[seen], z[seen]
    focal = camera["focal"]
    # Far flashes fade, so that they do not hide a crowd.
    true = 0.24 * focal / z
    found = np.empty(len(z), FLASH)
    found["x"], found["y"] = camera["middle_x"] + focal * x / z, camera["middle_y"] - focal * y / z
    found["depth"], found["size"] = np.sqrt(x * x + y * y + z * z) - 0.45, np.maximum(true, 2.0)
    found["age"], found["outcome"] = np.asarray(flashes.ages)[seen], np.asarray(flashes.outcomes)[seen]
    found["power"] = np.asarray(flashes.powers, float)[seen] * np.clip(true / 6.0, 0.2, 1.0)
    return found

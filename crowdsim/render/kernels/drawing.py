"""Compiled drawing of pictures, one tile of 8 x 8 pixels at a time."""

import numpy as np

from crowdsim.jit import kernel
from crowdsim.render.kernels.colour import add_flashes, develop, paint_points
from crowdsim.render.kernels.columns import (
    CENTRE_X,
    CENTRE_Y,
    CENTRE_Z,
    FIRST_ROW,
    FOCAL,
    HALF_X,
    HALF_Y,
    HALF_Z,
    LAST_ROW,
    RADIUS,
    TAPER,
)
from crowdsim.render.kernels.cones import meet_cone, start_tile
from crowdsim.render.kernels.ground import lay_arena, lay_ground, paint_background
from crowdsim.render.kernels.points import gather_points
from crowdsim.render.kernels.records import Layers, Lit, Near
from crowdsim.render.kernels.shade import find_sky, find_sun
from crowdsim.render.kernels.skins import meet_skins
from crowdsim.render.kernels.tiles import FLAGS, LAYER, POINT_SCRATCH, POINTS, SAMPLES, SCRATCH, TOGETHER, F, N


@kernel(fastmath=FLAGS)
def draw_tiles(first, step, camera, light, floor, scene, skins, grids, arena, flashes, out):
    """Draw every ``step``-th tile of a picture, from tile ``first`` on.

    Tiles are independent, so any division among threads gives the same picture.

    Args:
        first: Number of the first tile; tiles count along rows.
        step: Distance to the next one.
        camera: See ``columns``. Shape (16,).
        light: See ``columns``. Shape (16,).
        floor: See ``columns``. Shape (6,).
        scene: The cones, a ``Cones``.
        skins: The triangles, a ``Skins``.
        grids: Which of both each cell may show or be shaded by, a ``Grids``.
        arena: Kind (0 none, 1 circle, 2 rectangle), centre x and z, half the sizes along x and z, half the width of
            the line around it [m]. Shape (6,).
        flashes: Place x, y [px], distance [m], size [px], age 0..1, power, outcome. Shape (H, 7), float32.
        out: The picture. Shape (height, width, 3), uint8.
    """
    buf = np.zeros(SCRATCH, np.float32)
    lit = Lit(np.zeros(POINT_SCRATCH, np.float32), np.zeros(POINTS, np.int32), np.zeros(POINTS, np.int32))
    layers = Layers(
        np.zeros(2 * SAMPLES * N, np.float32),
        np.zeros(LAYER * SAMPLES * N, np.float32),
        np.zeros(SAMPLES * N, np.int32),
        F(camera[FOCAL]),
    )
    cones, spans, tiles, faces = scene.cones, scene.spans, grids.tiles, grids.faces
    room = Near(np.zeros(cones.shape[0] + 1, np.int32), np.empty(TOGETHER, np.int32))
    columns, rows = (out.shape[1] + 7) // 8, (out.shape[0] + 7) // 8
    for tile in range(first, columns * rows, step):
        x0, y0 = 8 * (tile % columns), 8 * (tile // columns)
        start_tile(buf, x0, y0, camera)
        listed = tiles.entries[tiles.offsets[tile] : tiles.offsets[tile + 1]]
        for index in range(listed.shape[0]):
            c = cones[listed[index]]
            span = spans[listed[index]]
            top, bottom = max(span[FIRST_ROW] - y0, 0), min(span[LAST_ROW] - y0, 7)
            cone = c[CENTRE_X], c[CENTRE_Y], c[CENTRE_Z], c[HALF_X], c[HALF_Y], c[HALF_Z], c[RADIUS], c[TAPER]
            meet_cone(buf, 8 * top, 8 * bottom + 8, F(index), cone)
        met = faces.entries[faces.offsets[tile] : faces.offsets[tile + 1]]
        if met.shape[0] > 0:
            meet_skins(buf, x0, y0, met, skins, layers)
        lay_ground(buf, camera)
        lay_arena(buf, camera, arena)
        count = gather_points(buf, listed, met.shape[0] > 0, camera, scene, layers, lit)
        find_sun(lit, count, light, scene.shades, grids.shadows, room)
        find_sky(lit, count, scene, floor, grids.contacts, room)
        paint_background(buf, lit.values, camera, light)
        if count > N:
            paint_points(buf, lit, count, camera, light)
        if flashes.shape[0] > 0:
            add_flashes(buf, x0, y0, flashes)
        develop(buf, lit.pixels, x0, y0, out)

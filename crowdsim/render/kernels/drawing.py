"""Compiled drawing of pictures, one tile of 8 x 8 pixels at a time."""

import numpy as np

import crowdsim.render.kernels.tiles as tiles
from crowdsim.jit import kernel
from crowdsim.render.kernels.colour import add_flashes, develop, paint_points
from crowdsim.render.kernels.cones import meet_cone, start_tile
from crowdsim.render.kernels.ground import lay_arena, lay_ground, paint_background
from crowdsim.render.kernels.points import gather_points
from crowdsim.render.kernels.records import Layers, Lit, Near
from crowdsim.render.kernels.shade import find_sky, find_sun
from crowdsim.render.kernels.skins import meet_skins
from crowdsim.render.kernels.tiles import FLAGS, F, N


@kernel(allocates=True, fastmath=FLAGS)
def draw_tiles(first, step, cameras, lights, scene, skins, grids, arenas, flashes, out):
    """Draw every ``step``-th tile of a picture, from tile ``first`` on.

    Tiles are independent, so any division among threads gives the same picture.

    Args:
        first: Number of the first tile; tiles count along rows.
        step: Distance to the next one.
        cameras: The camera. Shape (1,), ``CAMERA``.
        lights: The light. Shape (1,), ``LIGHT``.
        scene: The cones, a ``Cones``.
        skins: The triangles, a ``Skins``.
        grids: Which of both each cell may show or be shaded by, a ``Grids``.
        arenas: The arena. Shape (1,), ``ARENA``.
        flashes: Shape (H,), ``FLASH``.
        out: The picture. Shape (height, width, 3), uint8.
    """
    camera, light = cameras[0], lights[0]
    buf = np.zeros(tiles.SCRATCH, np.float32)
    points = tiles.POINTS
    lit = Lit(np.zeros(tiles.POINT_SCRATCH, np.float32), np.zeros(points, np.int32), np.zeros(points, np.int32))
    layers = Layers(
        np.zeros(2 * tiles.SAMPLES * N, np.float32),
        np.zeros(tiles.LAYER * tiles.SAMPLES * N, np.float32),
        np.zeros(tiles.SAMPLES * N, np.int32),
        F(camera.focal),
    )
    cones, spans, by_tile, faces = scene.cones, scene.spans, grids.tiles, grids.faces
    room = Near(np.zeros(cones.shape[0] + 1, np.int32), np.empty(tiles.TOGETHER, np.int32))
    columns, rows = (out.shape[1] + 7) // 8, (out.shape[0] + 7) // 8
    for tile in range(first, columns * rows, step):
        x0, y0 = 8 * (tile % columns), 8 * (tile // columns)
        start_tile(buf, x0, y0, camera)
        listed = by_tile.entries[by_tile.offsets[tile] : by_tile.offsets[tile + 1]]
        for index in range(listed.shape[0]):
            c = cones[listed[index]]
            span = spans[listed[index]]
            top, bottom = max(span.first - y0, 0), min(span.last - y0, 7)
            cone = c.centre_x, c.centre_y, c.centre_z, c.half_x, c.half_y, c.half_z, c.radius, c.taper
            meet_cone(buf, 8 * top, 8 * bottom + 8, F(index), cone)
        met = faces.entries[faces.offsets[tile] : faces.offsets[tile + 1]]
        if met.shape[0] > 0:
            meet_skins(buf, x0, y0, met, skins, layers)
        lay_ground(buf, camera)
        lay_arena(buf, camera, arenas[0])
        count = gather_points(buf, listed, met.shape[0] > 0, camera, scene, layers, lit)
        find_sun(lit, count, light, scene.shades, grids.light, grids.shadows, room)
        find_sky(lit, count, scene, grids.floor, grids.contacts, F(grids.reach), room)
        paint_background(buf, lit.values, camera, light)
        if count > N:
            paint_points(buf, lit, count, camera, light)
        if flashes.shape[0] > 0:
            add_flashes(buf, x0, y0, flashes)
        develop(buf, lit.pixels, x0, y0, out)

"""Compiled rasterisation of skins: projection, sorting of triangles into tiles, and what each pixel shows of them.

Every pixel has four samples on a rotated grid: each has a row and a column of its own among quarters of the pixel.
Those that meet one surface of one avatar make a layer; the share of a layer is that of the samples which nearer layers
have left, so that layers together cover what they truly cover.
"""

import math

import numpy as np

import crowdsim.render.kernels.tiles as tiles
from crowdsim.jit import kernel
from crowdsim.render.kernels.cones import sort_in
from crowdsim.render.kernels.tiles import FAR, FLAGS, ONE, TINY, ZERO, F, N, U

_NEAREST = 0.05
"""Depth from which a corner can be projected [m]; triangles with a nearer one are left out."""
_EDGE = F(1e-3)
"""How far beyond an edge a sample still is in a triangle, so that there are no cracks between two [px]."""
_APART = F(0.04)
"""Difference of depth from which samples of one avatar are on surfaces of their own [m]."""


@kernel
def project_skins(low, high, vertices, cameras, out):
    """Write where vertices ``low`` to ``high`` are in the picture.

    Args:
        low: First vertex.
        high: One past the last.
        vertices: In the world [m]. Shape (V, 3), float32.
        cameras: The camera. Shape (1,), ``CAMERA``.
        out: x and y [px], and one over the depth [1/m], -1 where that is too small. Shape (V, 3), float32.
    """
    camera = cameras[0]
    focal = camera.focal
    for v in range(low, high):
        x, y, z = vertices[v, 0] - camera.eye_x, vertices[v, 1] - camera.eye_y, vertices[v, 2] - camera.eye_z
        depth = x * camera.ahead_x + y * camera.ahead_y + z * camera.ahead_z
        if depth < _NEAREST:
            out[v, 2] = -1.0
            continue
        over = 1.0 / depth
        right = x * camera.right_x + y * camera.right_y + z * camera.right_z
        up = x * camera.up_x + y * camera.up_y + z * camera.up_z
        out[v, 0] = camera.middle_x + focal * right * over
        out[v, 1] = camera.middle_y - focal * up * over
        out[v, 2] = over


@kernel
def choose_triangles(triangles, screen, width, height, columns, offsets, chosen, spans):
    """Choose the triangles that may show, count them for each tile of 8 x 8 pixels, and return how many they are.

    Args:
        triangles: Corners, counter-clockwise from outside. Shape (T, 3), int32.
        screen: What ``project_skins`` wrote. Shape (V, 3).
        width: Of the picture [px].
        height: Likewise.
        columns: Tiles of a row.
        offsets: CSR offsets of tiles, written. Shape (tiles + 1,), int32.
        chosen: Triangles, ascending, written. Shape (T,), int32.
        spans: First and last column and row of tiles of each, written. Shape (T, 4), int16.
    """
    for tile in range(offsets.shape[0]):
        offsets[tile] = 0
    count = 0
    for t in range(triangles.shape[0]):
        a, b, c = screen[triangles[t, 0]], screen[triangles[t, 1]], screen[triangles[t, 2]]
        if min(a[2], min(b[2], c[2])) <= 0.0:
            continue
        # The picture's y points down, so what faces the eye is clockwise there.
        if (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) >= 0.0:
            continue
        left, right = min(a[0], min(b[0], c[0])), max(a[0], max(b[0], c[0]))
        top, bottom = min(a[1], min(b[1], c[1])), max(a[1], max(b[1], c[1]))
        if right < 0.0 or bottom < 0.0 or left >= width or top >= height:
            continue
        # Samples lie on a grid of quarters of a pixel; between its lines there is none.
        if math.floor(4.0 * right - 0.49) < math.ceil(4.0 * left - 0.51):
            continue
        if math.floor(4.0 * bottom - 0.49) < math.ceil(4.0 * top - 0.51):
            continue
        span = spans[count]
        span[0], span[1] = int(max(left, 0.0)) >> 3, int(min(right, width - 1.0)) >> 3
        span[2], span[3] = int(max(top, 0.0)) >> 3, int(min(bottom, height - 1.0)) >> 3
        for row in range(span[2], span[3] + 1):
            for column in range(span[0], span[1] + 1):
                offsets[row * columns + column + 1] += 1
        chosen[count] = t
        count += 1
    for tile in range(1, offsets.shape[0]):
        offsets[tile] += offsets[tile - 1]
    return count


@kernel
def list_triangles(chosen, spans, columns, offsets, entries):
    """Write the chosen triangles of each tile, ascending, into ``entries``; ``offsets`` comes back as it was."""
    for index in range(chosen.shape[0]):
        for row in range(spans[index, 2], spans[index, 3] + 1):
            for column in range(spans[index, 0], spans[index, 1] + 1):
                tile = row * columns + column
                entries[offsets[tile]] = chosen[index]
                offsets[tile] += 1
    for tile in range(offsets.shape[0] - 1, 0, -1):
        offsets[tile] = offsets[tile - 1]
    offsets[0] = 0


@kernel(fastmath=FLAGS)
def meet_skins(buf, x0, y0, listed, skins, layers):
    """Let the pixels of a tile meet some triangles, and sort the layers that they show in by distance.

    Args:
        buf: The tile's scratch, see ``tiles``.
        x0: Left edge of the tile [px].
        y0: Its top edge.
        listed: The triangles.
        skins: Of which they are, a ``Skins``.
        layers: Room for samples and layers, a ``Layers``.
    """
    samples = layers.samples
    for s in range(tiles.SAMPLES * N):
        samples[s] = ZERO
    for index in range(listed.shape[0]):
        _cover_samples(samples, F(x0), F(y0), F(index), listed[index], skins)
    count = 0
    for i in range(N):
        count = _gather_layers(buf, i, x0, y0, listed, skins, layers, count)


@kernel(fastmath=FLAGS)
def _cover_samples(samples, x0, y0, index, face, skins):
    """Write a triangle where it is the nearest at a sample."""
    corners, screen = skins.triangles, skins.screen
    a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
    ax, ay, az = screen[a, 0] - x0, screen[a, 1] - y0, screen[a, 2]
    bx, by, bz = screen[b, 0] - x0, screen[b, 1] - y0, screen[b, 2]
    cx, cy, cz = screen[c, 0] - x0, screen[c, 1] - y0, screen[c, 2]
    inverse = ONE / min((bx - ax) * (cy - ay) - (by - ay) * (cx - ax), F(-1e-12))
    # One over the depth is linear in the picture.
    z_x = ((by - cy) * (az - cz) + (cy - ay) * (bz - cz)) * inverse
    z_y = ((cx - bx) * (az - cz) + (ax - cx) * (bz - cz)) * inverse
    z_0 = cz - z_x * cx - z_y * cy
    # Inside is what lies right of edges that lead down, and left of those that lead up.
    left_ab, left_ab_y, right_ab, right_ab_y = _bounds(ax, ay, bx, by)
    left_bc, left_bc_y, right_bc, right_bc_y = _bounds(bx, by, cx, cy)
    left_ca, left_ca_y, right_ca, right_ca_y = _bounds(cx, cy, ax, ay)
    first = max(int(np.ceil(max(min(ay, min(by, cy)), ZERO) * F(tiles.SAMPLES) - F(0.502))), 0)
    last = min(int(np.floor(min(max(ay, max(by, cy)), F(8.0)) * F(tiles.SAMPLES) - F(0.498))), 8 * tiles.SAMPLES - 1)
    # That the compiler does not know it is eight keeps it from unrolling what vector instructions are for.
    width = samples.shape[0] // (16 * tiles.SAMPLES)
    for line in range(first, last + 1):
        s, y = line & 3, F(0.25) * F(line) + F(0.125)
        aside = F(0.25) * F((2 * s + 1 - (s >> 1)) & 3) + F(0.125)
        left = max(left_ab + y * left_ab_y, max(left_bc + y * left_bc_y, left_ca + y * left_ca_y)) - aside
        right = min(right_ab + y * right_ab_y, min(right_bc + y * right_bc_y, right_ca + y * right_ca_y)) - aside
        start, depth = U(8 * line), z_0 + z_y * y + z_x * aside
        for column in range(width):
            at, x = start + U(column), F(column)
            own, old = depth + z_x * x, samples[at]
            nearer = (x >= left) & (x <= right) & (own > old)
            samples[at] = own if nearer else old
            samples[U(tiles.SAMPLES * N) + at] = index if nearer else samples[U(tiles.SAMPLES * N) + at]


@kernel(inline=True, fastmath=FLAGS)
def _bounds(ax, ay, bx, by):
    """Return where an edge bounds rows from the left, at y = 0 and by how much more for each y, and from the right."""
    slope = (bx - ax) / (by - ay) if by != ay else ZERO
    at = ax - ay * slope
    if by > ay:
        return at - _EDGE, slope, FAR, ZERO
    if by < ay:
        return -FAR, ZERO, at + _EDGE, slope
    return -FAR, ZERO, FAR, ZERO


@kernel(fastmath=FLAGS)
def _gather_layers(buf, i, x0, y0, listed, skins, layers, count):
    """Make layers of the samples of a pixel, from near to far, and sort them in; return how many layers there are."""
    samples, values = layers.samples, layers.values
    owners, looks, paints = skins.owners, skins.looks, skins.paints
    base, left = 32 * (i >> 3) + (i & 7), tiles.SAMPLES
    while left > 0:
        nearest, most = -1, ZERO
        for s in range(base, base + 8 * tiles.SAMPLES, 8):
            if samples[s] > most:
                nearest, most = s, samples[s]
        if nearest < 0:
            break
        face = listed[int(samples[tiles.SAMPLES * N + nearest])]
        owner, look, furthest = owners[face], looks[face], most / (ONE + _APART * most)
        _write_normal(F(x0), F(y0), nearest, face, skins, layers, count)
        alike, several, depths, red, green, blue, gloss = 0, 0, ZERO, ZERO, ZERO, ZERO, ZERO
        for s in range(base, base + 8 * tiles.SAMPLES, 8):
            other = listed[int(samples[tiles.SAMPLES * N + s])] if samples[s] > furthest else -1
            if other >= 0 and owners[other] == owner:
                if looks[other] == look:
                    alike += 1
                else:
                    paint = paints[looks[other]]
                    red, green, blue = red + paint.red, green + paint.green, blue + paint.blue
                    gloss += paint.gloss
                several, depths, samples[s] = several + 1, depths + samples[s], ZERO
        share, own, at = ONE / F(several), F(alike), count * tiles.LAYER
        values[at + tiles.LAYER_RED] = (red + own * paints[look].red) * share
        values[at + tiles.LAYER_GREEN] = (green + own * paints[look].green) * share
        values[at + tiles.LAYER_BLUE] = (blue + own * paints[look].blue) * share
        values[at + tiles.LAYER_GLOSS] = (gloss + own * paints[look].gloss) * share
        layers.homes[count] = skins.homes[face]
        t = F(several) / (depths * buf[tiles.SPREAD + i] * layers.focal)
        sort_in(buf, U(i), F(-1 - count), t, ZERO, F(several) / F(left))
        left -= several
        count += 1
    return count


@kernel(fastmath=FLAGS)
def _write_normal(x0, y0, sample, face, skins, layers, count):
    """Write the normal that a triangle has at a sample as that of a layer."""
    corners, screen, normals = skins.triangles, skins.screen, skins.normals
    line, s = sample >> 3, (sample >> 3) & 3
    x = x0 + F(sample & 7) + F(0.25) * F((2 * s + 1 - (s >> 1)) & 3) + F(0.125)
    y = y0 + F(0.25) * F(line) + F(0.125)
    a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
    ax, ay, bx, by = screen[a, 0] - x, screen[a, 1] - y, screen[b, 0] - x, screen[b, 1] - y
    cx, cy = screen[c, 0] - x, screen[c, 1] - y
    # Shares of the corners, those of perspective.
    first, second, third = (
        (bx * cy - by * cx) * screen[a, 2],
        (cx * ay - cy * ax) * screen[b, 2],
        (ax * by - ay * bx) * screen[c, 2],
    )
    whole = first + second + third
    inverse = ONE / (whole if whole < F(-1e-12) else F(-1e-12))
    first, second = min(max(first * inverse, ZERO), ONE), min(max(second * inverse, ZERO), ONE)
    third = max(ONE - first - second, ZERO)
    nx = first * normals[a, 0] + second * normals[b, 0] + third * normals[c, 0]
    ny = first * normals[a, 1] + second * normals[b, 1] + third * normals[c, 1]
    nz = first * normals[a, 2] + second * normals[b, 2] + third * normals[c, 2]
    length = ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, TINY))
    at = count * tiles.LAYER
    layers.values[at + tiles.LAYER_X], layers.values[at + tiles.LAYER_Y] = nx * length, ny * length
    layers.values[at + tiles.LAYER_Z] = nz * length

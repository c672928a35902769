"""Compiled list of the points that a tile shows."""

import math

import numpy as np

from crowdsim.jit import kernel
from crowdsim.render.kernels.columns import (
    CENTRE_X,
    CENTRE_Y,
    CENTRE_Z,
    EYE_Y,
    GLOSS,
    HALF_X,
    HALF_Y,
    HALF_Z,
    PAINT_BLUE,
    PAINT_GREEN,
    PAINT_RED,
)
from crowdsim.render.kernels.tiles import (
    DX,
    DY,
    DZ,
    EDGE_C,
    EDGE_I,
    EDGE_S,
    EDGE_T,
    FAR,
    FLAGS,
    FLOOR,
    FRONT_I,
    FRONT_S,
    FRONT_T,
    GROUND_X,
    GROUND_Z,
    HALF,
    LAYER,
    LAYER_BLUE,
    LAYER_GLOSS,
    LAYER_GREEN,
    LAYER_RED,
    LAYER_X,
    LAYER_Y,
    LAYER_Z,
    NEXT_I,
    NEXT_S,
    NEXT_T,
    NOTHING,
    NX,
    NY,
    NZ,
    ONE,
    REST,
    SHARE,
    SPREAD,
    TINT_BLUE,
    TINT_GLOSS,
    TINT_GREEN,
    TINT_RED,
    WAY,
    WIDTH,
    WIDTH_X,
    WIDTH_Z,
    ZERO,
    F,
    N,
    X,
    Y,
    Z,
)


@kernel(fastmath=FLAGS)
def _add_point(lit, count, buf, i, c, t, s, share, scene):
    """Note that pixel ``i`` shows cone ``c`` at ``t``, where the normal points away from c(s)."""
    points, cones, paints = lit.values, scene.cones, scene.paints
    dx, dy, dz = buf[DX + i], buf[DY + i], buf[DZ + i]
    x, y, z = t * dx, t * dy, t * dz
    nx, ny, nz = (
        x - cones[c, CENTRE_X] - s * cones[c, HALF_X],
        y - cones[c, CENTRE_Y] - s * cones[c, HALF_Y],
        z - cones[c, CENTRE_Z] - s * cones[c, HALF_Z],
    )
    inverse = ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, F(1e-12)))
    points[X + count], points[Y + count], points[Z + count] = x, y, z
    points[NX + count], points[NY + count], points[NZ + count] = nx * inverse, ny * inverse, nz * inverse
    points[WIDTH + count], points[SHARE + count], points[WAY + count] = t * buf[SPREAD + i], share, t
    points[TINT_RED + count], points[TINT_GREEN + count] = paints[c, PAINT_RED], paints[c, PAINT_GREEN]
    points[TINT_BLUE + count], points[TINT_GLOSS + count] = paints[c, PAINT_BLUE], paints[c, GLOSS]
    lit.ids[count], lit.pixels[count] = c, i


@kernel(fastmath=FLAGS)
def _add_layer(lit, count, buf, i, layer, t, share, layers):
    """Note that pixel ``i`` shows a layer of skin at ``t``."""
    points, values, at = lit.values, layers.values, layer * LAYER
    points[X + count], points[Y + count], points[Z + count] = t * buf[DX + i], t * buf[DY + i], t * buf[DZ + i]
    points[NX + count], points[NY + count] = values[at + LAYER_X], values[at + LAYER_Y]
    points[NZ + count] = values[at + LAYER_Z]
    points[WIDTH + count], points[SHARE + count], points[WAY + count] = t * buf[SPREAD + i], share, t
    points[TINT_RED + count], points[TINT_GREEN + count] = values[at + LAYER_RED], values[at + LAYER_GREEN]
    points[TINT_BLUE + count], points[TINT_GLOSS + count] = values[at + LAYER_BLUE], values[at + LAYER_GLOSS]
    home = layers.homes[layer]
    lit.ids[count], lit.pixels[count] = home if home >= 0 else NOTHING, i


@kernel(fastmath=FLAGS)
def _share_crossing(buf, points, i, front, count, gap, rest):
    """Share a pixel between two surfaces that cross near it, points ``front`` and ``count``; return 1 where they do."""
    dx, dy, dz = buf[DX + i], buf[DY + i], buf[DZ + i]
    ax, ay, az = points[NX + front], points[NY + front], points[NZ + front]
    bx, by, bz = points[NX + count], points[NY + count], points[NZ + count]
    a = ONE / min(ax * dx + ay * dy + az * dz, F(-0.08))
    b = ONE / min(bx * dx + by * dy + bz * dz, F(-0.08))
    gx, gy, gz = ax * a - bx * b, ay * a - by * b, az * a - bz * b
    slope = points[WIDTH + front] * math.sqrt(gx * gx + gy * gy + gz * gz)
    if gap < HALF * slope:
        points[SHARE + count] = rest * (HALF - gap / slope)
        points[SHARE + front] = rest * (HALF + gap / slope)
        return 1
    return 0


@kernel(fastmath=FLAGS)
def gather_points(buf, listed, has_skins, camera, scene, layers, lit):
    """List the points that a tile shows, each with its share of the pixel; return how many.

    From near to far, each edge covers its share of what is left, then the front covers the rest, or the floor does.
    """
    points, ids, owners = lit.values, lit.ids, scene.owners
    ground = F(-camera[EYE_Y])
    for i in range(N):
        seen = (buf[DY + i] < F(-1e-6)) & (buf[FRONT_T + i] >= FAR)
        ids[i] = FLOOR if seen else NOTHING
        points[X + i], points[Y + i], points[Z + i] = buf[GROUND_X + i], ground, buf[GROUND_Z + i]
        points[NX + i], points[NY + i], points[NZ + i] = ZERO, ONE, ZERO
        points[WIDTH + i] = HALF * min(buf[WIDTH_X + i], buf[WIDTH_Z + i])
    count = np.int64(N)
    if listed.shape[0] == 0 and not has_skins:
        return count
    for i in range(N):
        front_t = buf[FRONT_T + i]
        if front_t >= FAR and buf[EDGE_T + i] >= FAR:
            continue
        owner, last_t, before, rest = -1, ZERO, ONE, ONE
        for slot in range(4):
            o = slot * N + i
            t = buf[EDGE_T + o]
            if t >= front_t or t >= FAR:
                break
            index = int(buf[EDGE_I + o])
            # Capsules of one limb share their outline: together they cover what the widest of them does.
            own = owners[listed[index]] if index >= 0 else NOTHING + index
            if own != owner or t - last_t > F(0.12):
                before = rest
            owner, last_t = own, t
            left = min(rest, before * (ONE - buf[EDGE_C + o]))
            if rest - left < F(0.003):
                continue
            if index >= 0:
                _add_point(lit, count, buf, i, listed[index], t, buf[EDGE_S + o], rest - left, scene)
            else:
                _add_layer(lit, count, buf, i, -1 - index, t, rest - left, layers)
            count += 1
            rest = left
        if front_t < FAR:
            front = count
            index, behind = int(buf[FRONT_I + i]), int(buf[NEXT_I + i])
            if index >= 0:
                _add_point(lit, count, buf, i, listed[index], front_t, buf[FRONT_S + i], rest, scene)
            else:
                _add_layer(lit, count, buf, i, -1 - index, front_t, rest, layers)
            count += 1
            gap = buf[NEXT_T + i] - front_t
            if gap < F(12.0) * points[WIDTH + front] and index >= 0 and behind >= 0:
                # Two surfaces cross near the pixel: they share it by how far the crossing line is from its middle.
                _add_point(lit, count, buf, i, listed[behind], buf[NEXT_T + i], buf[NEXT_S + i], ZERO, scene)
                count += _share_crossing(buf, points, i, front, count, gap, rest)
            rest = ZERO
        buf[REST + i] = rest
    return count

"""Compiled list of the points that a tile shows."""

import math

import numpy as np

import crowdsim.render.kernels.tiles as tiles
from crowdsim.jit import kernel
from crowdsim.render.kernels.tiles import FAR, FLAGS, HALF, ONE, ZERO, F, N


@kernel(fastmath=FLAGS)
def _add_point(lit, count, buf, i, c, t, s, share, scene):
    """Note that pixel ``i`` shows cone ``c`` at ``t``, where the normal points away from c(s)."""
    points, cones, paints = lit.values, scene.cones, scene.paints
    dx, dy, dz = buf[tiles.DX + i], buf[tiles.DY + i], buf[tiles.DZ + i]
    x, y, z = t * dx, t * dy, t * dz
    nx, ny, nz = (
        x - cones[c].centre_x - s * cones[c].half_x,
        y - cones[c].centre_y - s * cones[c].half_y,
        z - cones[c].centre_z - s * cones[c].half_z,
    )
    inverse = ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, F(1e-12)))
    points[tiles.X + count], points[tiles.Y + count], points[tiles.Z + count] = x, y, z
    points[tiles.NX + count], points[tiles.NY + count], points[tiles.NZ + count] = (
        nx * inverse,
        ny * inverse,
        nz * inverse,
    )
    points[tiles.WIDTH + count], points[tiles.SHARE + count], points[tiles.WAY + count] = (
        t * buf[tiles.SPREAD + i],
        share,
        t,
    )
    points[tiles.TINT_RED + count], points[tiles.TINT_GREEN + count] = paints[c].red, paints[c].green
    points[tiles.TINT_BLUE + count], points[tiles.TINT_GLOSS + count] = paints[c].blue, paints[c].gloss
    lit.ids[count], lit.pixels[count] = c, i


@kernel(fastmath=FLAGS)
def _add_layer(lit, count, buf, i, layer, t, share, layers):
    """Note that pixel ``i`` shows a layer of skin at ``t``."""
    points, values, at = lit.values, layers.values, layer * tiles.LAYER
    points[tiles.X + count], points[tiles.Y + count], points[tiles.Z + count] = (
        t * buf[tiles.DX + i],
        t * buf[tiles.DY + i],
        t * buf[tiles.DZ + i],
    )
    points[tiles.NX + count], points[tiles.NY + count] = values[at + tiles.LAYER_X], values[at + tiles.LAYER_Y]
    points[tiles.NZ + count] = values[at + tiles.LAYER_Z]
    points[tiles.WIDTH + count], points[tiles.SHARE + count], points[tiles.WAY + count] = (
        t * buf[tiles.SPREAD + i],
        share,
        t,
    )
    points[tiles.TINT_RED + count], points[tiles.TINT_GREEN + count] = (
        values[at + tiles.LAYER_RED],
        values[at + tiles.LAYER_GREEN],
    )
    points[tiles.TINT_BLUE + count], points[tiles.TINT_GLOSS + count] = (
        values[at + tiles.LAYER_BLUE],
        values[at + tiles.LAYER_GLOSS],
    )
    home = layers.homes[layer]
    lit.ids[count], lit.pixels[count] = home if home >= 0 else tiles.NOTHING, i


@kernel(fastmath=FLAGS)
def _share_crossing(buf, points, i, front, count, gap, rest):
    """Share a pixel between two surfaces that cross near it, points ``front`` and ``count``; return 1 where they do."""
    dx, dy, dz = buf[tiles.DX + i], buf[tiles.DY + i], buf[tiles.DZ + i]
    ax, ay, az = points[tiles.NX + front], points[tiles.NY + front], points[tiles.NZ + front]
    bx, by, bz = points[tiles.NX + count], points[tiles.NY + count], points[tiles.NZ + count]
    a = ONE / min(ax * dx + ay * dy + az * dz, F(-0.08))
    b = ONE / min(bx * dx + by * dy + bz * dz, F(-0.08))
    gx, gy, gz = ax * a - bx * b, ay * a - by * b, az * a - bz * b
    slope = points[tiles.WIDTH + front] * math.sqrt(gx * gx + gy * gy + gz * gz)
    if gap < HALF * slope:
        points[tiles.SHARE + count] = rest * (HALF - gap / slope)
        points[tiles.SHARE + front] = rest * (HALF + gap / slope)
        return 1
    return 0


@kernel(fastmath=FLAGS)
def gather_points(buf, listed, has_skins, camera, scene, layers, lit):
    """List the points that a tile shows, each with its share of the pixel; return how many.

    From near to far, each edge covers its share of what is left, then the front covers the rest, or the floor does.
    """
    points, ids, owners = lit.values, lit.ids, scene.owners
    ground = F(-camera.eye_y)
    for i in range(N):
        seen = (buf[tiles.DY + i] < F(-1e-6)) & (buf[tiles.FRONT_T + i] >= FAR)
        ids[i] = tiles.FLOOR if seen else tiles.NOTHING
        points[tiles.X + i], points[tiles.Y + i], points[tiles.Z + i] = (
            buf[tiles.GROUND_X + i],
            ground,
            buf[tiles.GROUND_Z + i],
        )
        points[tiles.NX + i], points[tiles.NY + i], points[tiles.NZ + i] = ZERO, ONE, ZERO
        points[tiles.WIDTH + i] = HALF * min(buf[tiles.WIDTH_X + i], buf[tiles.WIDTH_Z + i])
    count = np.int64(N)
    if listed.shape[0] == 0 and not has_skins:
        return count
    for i in range(N):
        front_t = buf[tiles.FRONT_T + i]
        if front_t >= FAR and buf[tiles.EDGE_T + i] >= FAR:
            continue
        owner, last_t, before, rest = -1, ZERO, ONE, ONE
        for slot in range(4):
            o = slot * N + i
            t = buf[tiles.EDGE_T + o]
            if t >= front_t or t >= FAR:
                break
            index = int(buf[tiles.EDGE_I + o])
            # Capsules of one limb share their outline: together they cover what the widest of them does.
            own = owners[listed[index]] if index >= 0 else tiles.NOTHING + index
            if own != owner or t - last_t > F(0.12):
                before = rest
            owner, last_t = own, t
            left = min(rest, before * (ONE - buf[tiles.EDGE_C + o]))
            if rest - left < F(0.003):
                continue
            if index >= 0:
                _add_point(lit, count, buf, i, listed[index], t, buf[tiles.EDGE_S + o], rest - left, scene)
            else:
                _add_layer(lit, count, buf, i, -1 - index, t, rest - left, layers)
            count += 1
            rest = left
        if front_t < FAR:
            front = count
            index, behind = int(buf[tiles.FRONT_I + i]), int(buf[tiles.NEXT_I + i])
            if index >= 0:
                _add_point(lit, count, buf, i, listed[index], front_t, buf[tiles.FRONT_S + i], rest, scene)
            else:
                _add_layer(lit, count, buf, i, -1 - index, front_t, rest, layers)
            count += 1
            gap = buf[tiles.NEXT_T + i] - front_t
            if gap < F(12.0) * points[tiles.WIDTH + front] and index >= 0 and behind >= 0:
                # Two surfaces cross near the pixel: they share it by how far the crossing line is from its middle.
                _add_point(
                    lit, count, buf, i, listed[behind], buf[tiles.NEXT_T + i], buf[tiles.NEXT_S + i], ZERO, scene
                )
                count += _share_crossing(buf, points, i, front, count, gap, rest)
            rest = ZERO
        buf[tiles.REST + i] = rest
    return count

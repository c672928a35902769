"""Compiled light: the shares of sun and sky that points see past cones."""

import math

import numpy as np

import crowdsim.render.kernels.tiles as tiles
from crowdsim.jit import kernel
from crowdsim.render.kernels.tiles import FAR, FLAGS, HALF, ONE, TINY, TWO, ZERO, F, N, U

_ROUNDING = F(0.002)
"""How much further shadows may reach in single numbers [m]."""


@kernel(fastmath=FLAGS)
def _cell(u, v, plane):
    """Return the number of the cell of a plane that a place lies in, -1 outside."""
    per_metre = F(plane.per_metre)
    column, row = np.floor((u - F(plane.left)) * per_metre), np.floor((v - F(plane.top)) * per_metre)
    if column >= ZERO and row >= ZERO and column < plane.columns and row < plane.rows:
        return int(row) * int(plane.columns) + int(column)
    return -1


@kernel(fastmath=FLAGS)
def _collect(points, start, stop, axes, plane, lists, room, most):
    """List every cone of the cells of a grid that some points may lie in, each once.

    Return how many, or -1 where there are more than ``most``. ``axes`` are the two of the plane in the world. The
    points of the floor, whole rows of pixels, lie between those at the corners.
    """
    ax, ay, az, bx, by, bz = axes
    offsets, entries, stamps, near = lists.offsets, lists.entries, room.stamps, room.cones
    low_u, high_u, low_v, high_v = FAR, -FAR, FAR, -FAR
    floor = stop <= N
    for q in range(4 if floor else stop - start):
        p = start + (7 * (q & 1) + (stop - start - 8) * (q >> 1) if floor else q)
        x, y, z = points[tiles.X + p], points[tiles.Y + p], points[tiles.Z + p]
        u, v = x * ax + y * ay + z * az, x * bx + y * by + z * bz
        low_u, high_u = min(low_u, u), max(high_u, u)
        low_v, high_v = min(low_v, v), max(high_v, v)
    left, top, per_metre = F(plane.left), F(plane.top), F(plane.per_metre)
    columns, rows = int(plane.columns), int(plane.rows)
    first = max(np.floor((low_u - left) * per_metre), ZERO)
    last = min(np.floor((high_u - left) * per_metre), F(columns - 1))
    above = max(np.floor((low_v - top) * per_metre), ZERO)
    below = min(np.floor((high_v - top) * per_metre), F(rows - 1))
    if first > last or above > below:
        return 0
    if below - above > F(48.0):
        return -1
    left_cell, right_cell = int(first), int(last) + 1
    stamp = stamps[-1] + 1
    stamps[-1] = stamp
    count = 0
    for row in range(int(above), int(below) + 1):
        begin, end = offsets[row * columns + left_cell], offsets[row * columns + right_cell]
        if end - begin > 16 * most:
            return -1
        for place in range(begin, end):
            c = entries[place]
            if stamps[c] != stamp:
                stamps[c] = stamp
                if count == most:
                    return -1
                near[count] = c
                count += 1
    return count


@kernel(fastmath=FLAGS)
def _cast_shadow(points, start, c, shades, sun):
    """Take from eight points the share of the sun that cone ``c`` hides from them.

    In light space (u, v across the rays, w towards the sun) a cone is a flat segment with a width. Its edge is soft by
    the sun's apparent size times the distance that the light travels: shadows are sharp where they meet what casts
    them.
    """
    lx, ly, lz, ux, uy, uz, vx, vy, vz, softness, widest = sun
    su, sv, sw, bu, bv, bw = (
        shades[c].u,
        shades[c].v,
        shades[c].w,
        shades[c].along_u,
        shades[c].along_v,
        shades[c].along_w,
    )
    first, more, over = shades[c].radius, shades[c].taper, shades[c].per_square
    for q in range(8):
        p = U(start) + U(q)
        x, y, z = points[tiles.AT_X + p], points[tiles.AT_Y + p], points[tiles.AT_Z + p]
        au, av = x * ux + y * uy + z * uz - su, x * vx + y * vy + z * vz - sv
        along = min(max((au * bu + av * bv) * over, ZERO), ONE)
        du, dv = au - along * bu, av - along * bv
        radius = first + along * more
        way = max(sw + along * bw - (x * lx + y * ly + z * lz), ZERO)
        soft = max(softness * way, min(points[tiles.AT_WIDTH + p], widest))
        gap = math.sqrt(du * du + dv * dv) - radius
        dark = min(max(HALF - HALF * gap / soft, ZERO), ONE)
        # What lies beside the point rather than above it, as its own cone does, casts no shadow on it.
        dark = dark * dark * (F(3.0) - TWO * dark) * min(way / (F(0.4) * radius), ONE)
        points[tiles.AT_SUN + p] = min(points[tiles.AT_SUN + p], ONE - dark)


@kernel(fastmath=FLAGS)
def _cast_shadows(points, start, stop, listed, shades, light):
    """Take from some points, eight at a time, the share of the sun that each of some cones hides.

    Those of the last eight beyond ``stop`` are points that nothing shows.
    """
    lx, ly, lz = F(light.sun_x), F(light.sun_y), F(light.sun_z)
    ux, uy, uz, vx, vy, vz = F(light.u_x), F(light.u_y), F(light.u_z), F(light.v_x), F(light.v_y), F(light.v_z)
    softness, widest = F(light.softness), F(light.widest)
    sun = lx, ly, lz, ux, uy, uz, vx, vy, vz, softness, widest
    for low in range(start, stop, 8):
        least_u, most_u, least_v, most_v, least_w = FAR, -FAR, FAR, -FAR, FAR
        for p in range(low, min(low + 8, stop)):
            x, y, z = points[tiles.X + p], points[tiles.Y + p], points[tiles.Z + p]
            u, v = x * ux + y * uy + z * uz, x * vx + y * vy + z * vz
            least_u, most_u, least_v, most_v = min(least_u, u), max(most_u, u), min(least_v, v), max(most_v, v)
            least_w = min(least_w, x * lx + y * ly + z * lz)
        for index in range(listed.shape[0]):
            c = listed[index]
            u, v, w = shades[c].u, shades[c].v, shades[c].w
            bu, bv, bw = shades[c].along_u, shades[c].along_v, shades[c].along_w
            reach = shades[c].radius + max(shades[c].taper, ZERO) + _ROUNDING
            reach += max(softness * (w + max(bw, ZERO) - least_w), widest)
            if (
                (u + min(bu, ZERO) - reach < most_u)
                & (u + max(bu, ZERO) + reach > least_u)
                & (v + min(bv, ZERO) - reach < most_v)
                & (v + max(bv, ZERO) + reach > least_v)
            ):
                _cast_shadow(points, low, c, shades, sun)


@kernel(fastmath=FLAGS)
def find_sun(lit, count, light, shades, plane, lists, room):
    """Write the share of the sun that every point sees past all cones."""
    points, near = lit.values, room.cones
    ux, uy, uz, vx, vy, vz = F(light.u_x), F(light.u_y), F(light.u_z), F(light.v_x), F(light.v_y), F(light.v_z)
    axes = ux, uy, uz, vx, vy, vz
    for p in range(count):
        points[tiles.SUN + p] = ONE
    for part in range(2):
        start, stop = (0, N) if part == 0 else (N, count)
        if start == stop:
            continue
        several = _collect(points, start, stop, axes, plane, lists, room, np.int64(tiles.TOGETHER))
        if several > 0:
            _cast_shadows(points, start, stop, near[:several], shades, light)
        if several >= 0:
            continue
        for low in range(start, stop, 8):
            high = min(low + 8, stop)
            several = _collect(points, low, high, axes, plane, lists, room, near.shape[0])
            if several > 0:
                _cast_shadows(points, low, high, near[:several], shades, light)
            if several >= 0:
                continue
            for p in range(low, high):
                x, y, z = points[tiles.X + p], points[tiles.Y + p], points[tiles.Z + p]
                cell = _cell(x * ux + y * uy + z * uz, x * vx + y * vy + z * vz, plane)
                if cell >= 0:
                    listed = lists.entries[lists.offsets[cell] : lists.offsets[cell + 1]]
                    _cast_shadows(points, p - p % 8, p + 1, listed, shades, light)


@kernel(fastmath=FLAGS)
def _cover_sky(points, ids, start, stop, only, c, cones, strength, reach):
    """Take from the points of cone ``only`` the share of their sky that cone ``c`` hides, none beyond ``reach``."""
    mx, my, mz, r, k = cones[c].centre_x, cones[c].centre_y, cones[c].centre_z, cones[c].radius, cones[c].taper
    hx, hy, hz = cones[c].half_x, cones[c].half_y, cones[c].half_z
    over = ONE / max(hx * hx + hy * hy + hz * hz, TINY)
    fade = ONE / reach
    for q in range(stop - start):
        p = U(start) + U(q)
        ox, oy, oz = points[tiles.AT_X + p] - mx, points[tiles.AT_Y + p] - my, points[tiles.AT_Z + p] - mz
        s = min(max((ox * hx + oy * hy + oz * hz) * over, -ONE), ONE)
        vx, vy, vz = s * hx - ox, s * hy - oy, s * hz - oz
        radius = r + s * k
        square = max(vx * vx + vy * vy + vz * vz, TINY)
        distance = math.sqrt(square)
        near = min(max(ONE - (distance - radius) * fade, ZERO), ONE)
        facing = (
            max(vx * points[tiles.AT_NX + p] + vy * points[tiles.AT_NY + p] + vz * points[tiles.AT_NZ + p], ZERO)
            / distance
        )
        share = facing * min(radius * radius / square, ONE) * near * near
        free = points[tiles.AT_SKY + p]
        points[tiles.AT_SKY + p] = free * (ONE - strength * share) if ids[p] == only else free


@kernel(fastmath=FLAGS)
def find_sky(lit, count, scene, plane, lists, reach, room):
    """Write the share of the sky that every point sees past what is near it: feet on the floor, limbs on a body."""
    points, ids, near, stamps = lit.values, lit.ids, room.cones, room.stamps
    cones, neighbours = scene.cones, scene.neighbours
    start, stop, floor = np.int64(0), np.int64(N), np.int32(tiles.FLOOR)
    for p in range(count):
        points[tiles.SKY + p] = ONE
    several = _collect(points, start, stop, (ONE, ZERO, ZERO, ZERO, ZERO, ONE), plane, lists, room, near.shape[0])
    for index in range(several):
        _cover_sky(points, ids, start, stop, floor, near[index], cones, ONE, reach)
    if several < 0:
        for p in range(N):
            cell = _cell(points[tiles.X + p], points[tiles.Z + p], plane)
            if cell >= 0 and ids[p] == tiles.FLOOR:
                for place in range(lists.offsets[cell], lists.offsets[cell + 1]):
                    _cover_sky(points, ids, p, p + 1, floor, lists.entries[place], cones, ONE, reach)
    stamp = stamps[-1] + 1
    stamps[-1] = stamp
    for first in range(N, count):
        c = ids[first]
        if c >= 0 and stamps[c] != stamp:
            stamps[c] = stamp
            for slot in range(neighbours.shape[1]):
                if neighbours[c, slot] < 0:
                    break
                _cover_sky(points, ids, first, count, c, neighbours[c, slot], cones, F(0.75), F(0.15))

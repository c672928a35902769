"""Compiled ray-casting of rounded cones over a ground, one tile of 8 x 8 pixels at a time.

A rounded cone is the union of the spheres about ``c(s) = m + s h`` with radius ``r(s) = r + s k``, s in -1..1. For a
ray ``t d`` from the eye (d of unit length), with the axis moved to the point of the ray nearest to m, the squared
distance between the ray and c(s) is ``D(s)^2 = d0^2 + A (s - s*)^2``, with A = |h|^2 - (h.d)^2. Two values of s matter:

* ``s_c``, where ``D(s) - r(s)`` is least: that gap, measured in pixels, gives the share of the pixel that is covered;
* ``s_h``, where the ray enters first, ``t(s) = s (h.d) - sqrt(r(s)^2 - D(s)^2)``: the hit, whose normal points away
  from c(s_h).

Where ``A < k^2`` the ray looks along the axis into the cone, D(s) - r(s) falls towards the wider end, and the root of
t'(s) is another one; where even ``|h|^2 < k^2`` the wider end's sphere is all there is.

The loops over the 64 pixels of a tile have no branches and work in float32 on one flat scratch array with a fixed
distance between its rows, so that the compiler can use vector instructions.
"""

import math

import numpy as np

from crowdsim.jit import kernel

F = np.float32
# Unsigned numbers tell the compiler that an index is never negative, without which it uses no vector instructions.
U = np.uint64
N = 64
DX, DY, DZ, SPREAD = 0, N, 2 * N, 3 * N
FRONT_T, FRONT_S, FRONT_I = 4 * N, 5 * N, 6 * N
NEXT_T, NEXT_S, NEXT_I = 7 * N, 8 * N, 9 * N
EDGE_T, EDGE_S, EDGE_C, EDGE_I = 10 * N, 14 * N, 18 * N, 22 * N
GROUND_X, GROUND_Z, GROUND_T, WIDTH_X, WIDTH_Z = 26 * N, 27 * N, 28 * N, 29 * N, 30 * N
REST = 31 * N
RED, GREEN, BLUE = 32 * N, 33 * N, 34 * N
LINE, OUTSIDE = 35 * N, 36 * N
SCRATCH = 37 * N

POINTS = 7 * N
"""Points to be lit in a tile: the floor in every pixel, then up to four edges and two crossing fronts a pixel."""
X, Y, Z, NX, NY, NZ = 0, POINTS, 2 * POINTS, 3 * POINTS, 4 * POINTS, 5 * POINTS
WIDTH, SHARE, SUN, SKY, WAY = 6 * POINTS, 7 * POINTS, 8 * POINTS, 9 * POINTS, 10 * POINTS
POINT_SCRATCH = 11 * POINTS
TOGETHER = 48
"""Cones up to which all points of a tile meet each of them; beyond, eight points at a time look for fewer."""
FLOOR, NOTHING = -1, -2
AT_X, AT_Y, AT_Z, AT_NX, AT_NY, AT_NZ = U(X), U(Y), U(Z), U(NX), U(NY), U(NZ)
AT_WIDTH, AT_SUN, AT_SKY = U(WIDTH), U(SUN), U(SKY)

FAR = F(1e9)
TINY = F(1e-9)
ZERO, HALF, ONE, TWO = F(0.0), F(0.5), F(1.0), F(2.0)
FULL, FAINT = F(0.996), F(0.004)
NEAR = F(0.05)

FLAGS = {"contract", "nsz", "arcp", "reassoc", "nnan"}


@kernel(fastmath=FLAGS)
def _start_tile(buf, x0, y0, camera):
    """Write the ray of every pixel, and empty the lists of what they meet."""
    inverse = F(1.0 / camera[12])
    cx, cy = F(camera[13]), F(camera[14])
    rx, ry, rz = F(camera[3]), F(camera[4]), F(camera[5])
    ux, uy, uz = F(camera[6]), F(camera[7]), F(camera[8])
    fx, fy, fz = F(camera[9]), F(camera[10]), F(camera[11])
    left, top = F(x0) + HALF - cx, F(y0) + HALF - cy
    for i in range(N):
        sx = (left + F(i & 7)) * inverse
        sy = -(top + F(i >> 3)) * inverse
        length = ONE / math.sqrt(ONE + sx * sx + sy * sy)
        buf[DX + i] = (fx + sx * rx + sy * ux) * length
        buf[DY + i] = (fy + sx * ry + sy * uy) * length
        buf[DZ + i] = (fz + sx * rz + sy * uz) * length
        buf[SPREAD + i] = inverse * length
    for i in range(N):
        buf[FRONT_T + i] = FAR
        buf[NEXT_T + i] = FAR
        buf[REST + i] = ONE
    for i in range(4 * N):
        buf[EDGE_T + i] = FAR


@kernel(fastmath=FLAGS)
def _meet(buf, start, stop, index, mx, my, mz, hx, hy, hz, r, k):
    """Let the rays of pixels ``start`` to ``stop`` of a tile meet one rounded cone, and sort that in by distance.

    A pixel keeps the two nearest that cover it wholly and the four nearest that cover a part of it.
    """
    hh = hx * hx + hy * hy + hz * hz
    # One end's sphere holds all others.
    swallowed = hh <= k * k
    open_ = max(hh - k * k, TINY)
    for p in range(stop - start):
        i = U(start) + U(p)
        dx, dy, dz = buf[U(DX) + i], buf[U(DY) + i], buf[U(DZ) + i]
        t0 = mx * dx + my * dy + mz * dz
        px, py, pz = mx - t0 * dx, my - t0 * dy, mz - t0 * dz
        hd = hx * dx + hy * dy + hz * dz
        ph = px * hx + py * hy + pz * hz
        a = max(hh - hd * hd, TINY)
        b = a - k * k
        middle = -ph / a
        d0 = max(px * px + py * py + pz * pz + ph * middle, ZERO)
        # Where the ray comes nearest to the surface, or is deepest in it.
        wider = ONE if k > ZERO else -ONE
        sc = middle + k * math.sqrt(d0 / (a * max(b, TINY)))
        sc = min(max(sc, -ONE), ONE) if b > ZERO else wider
        q = sc - middle
        rc = r + sc * k
        dc = d0 + a * q * q
        gap = math.sqrt(dc) - rc
        per_pixel = ONE / max((t0 + sc * hd) * buf[U(SPREAD) + i], TINY)
        cover = min(max(HALF - gap * per_pixel, ZERO), ONE) - min(max(HALF - (gap + TWO * rc) * per_pixel, ZERO), ONE)
        # Where it enters first: of the two ways to write the root, the one that takes no difference of equals.
        g = r * k + a * middle
        foot = r + k * middle
        inside = a * foot * foot - b * d0
        root = hd * math.sqrt(max(inside, ZERO) / open_)
        same = g * hd > ZERO
        over = open_ * (g + root) if same else b
        over = over if abs(over) > TINY else (TINY if over >= ZERO else -TINY)
        sh = (g * g - hd * hd * (r * r - d0 - a * middle * middle) if same else g - root) / over
        # Seen from its wider end, an open cone hides behind that.
        sh = wider if swallowed | ((b <= ZERO) & (hd * k <= ZERO)) else min(max(sh, -ONE), ONE)
        q = sh - middle
        rh = r + sh * k
        chord = rh * rh - d0 - a * q * q
        outside = chord < ZERO
        s = sc if outside else sh
        chord = rc * rc - dc if outside else chord
        t = t0 + s * hd - math.sqrt(max(chord, ZERO))
        cover = cover if t > NEAR else ZERO

        new_t = t if cover >= FULL else FAR
        front_t, front_s, front_i = buf[U(FRONT_T) + i], buf[U(FRONT_S) + i], buf[U(FRONT_I) + i]
        next_t, next_s, next_i = buf[U(NEXT_T) + i], buf[U(NEXT_S) + i], buf[U(NEXT_I) + i]
        first = new_t < front_t
        second = new_t < next_t
        buf[U(NEXT_T) + i] = front_t if first else (new_t if second else next_t)
        buf[U(NEXT_S) + i] = front_s if first else (s if second else next_s)
        buf[U(NEXT_I) + i] = front_i if first else (index if second else next_i)
        buf[U(FRONT_T) + i] = new_t if first else front_t
        buf[U(FRONT_S) + i] = s if first else front_s
        buf[U(FRONT_I) + i] = index if first else front_i

        edge_t = t if (cover < FULL) & (cover > FAINT) else FAR
        edge_s, edge_c, edge_i = s, cover, index
        for slot in range(4):
            o = U(slot * N) + i
            old_t, old_s, old_c, old_i = buf[U(EDGE_T) + o], buf[U(EDGE_S) + o], buf[U(EDGE_C) + o], buf[U(EDGE_I) + o]
            nearer = edge_t < old_t
            buf[U(EDGE_T) + o] = edge_t if nearer else old_t
            buf[U(EDGE_S) + o] = edge_s if nearer else old_s
            buf[U(EDGE_C) + o] = edge_c if nearer else old_c
            buf[U(EDGE_I) + o] = edge_i if nearer else old_i
            edge_t = old_t if nearer else edge_t
            edge_s = old_s if nearer else edge_s
            edge_c = old_c if nearer else edge_c
            edge_i = old_i if nearer else edge_i


@kernel(fastmath=FLAGS)
def _lay_ground(buf, camera):
    """Write where every ray meets the floor, relative to the eye, and how wide the pixel lies there."""
    height = F(camera[1])
    for i in range(N):
        dx, dy, dz, spread = buf[DX + i], buf[DY + i], buf[DZ + i], buf[SPREAD + i]
        down = max(-dy, F(1e-6))
        t = min(height / down, F(1e6))
        level = math.sqrt(max(dx * dx + dz * dz, F(1e-8)))
        wide = t * spread
        long = wide / down
        ax, az = abs(dx) / level, abs(dz) / level
        buf[GROUND_T + i] = t
        buf[GROUND_X + i] = t * dx
        buf[GROUND_Z + i] = t * dz
        buf[WIDTH_X + i] = max(wide * az + long * ax, F(1e-6))
        buf[WIDTH_Z + i] = max(wide * ax + long * az, F(1e-6))


@kernel(fastmath=FLAGS)
def _rise(x):
    """Integral of a square wave that is +1 and -1 on alternate units."""
    half = x * HALF
    return ONE - abs((half - np.floor(half)) * TWO - ONE)


@kernel(fastmath=FLAGS)
def _checks(x, w):
    """Mean of that square wave over a window of width ``w``, faded out where the window holds several units."""
    mean = (_rise(x + HALF * w) - _rise(x - HALF * w)) / w
    return mean * min(max(F(1.6) - F(0.8) * w, ZERO), ONE)


@kernel(fastmath=FLAGS)
def _stripes(x, w, thick):
    """Share of a window of width ``w`` that lies on a line of width ``thick`` about every whole number."""
    low, high = x - HALF * w + HALF * thick, x + HALF * w + HALF * thick
    below, above = np.floor(low), np.floor(high)
    return ((above - below) * thick + min(high - above, thick) - min(low - below, thick)) / w


@kernel(fastmath=FLAGS)
def _add_point(points, ids, pixels, count, buf, i, c, t, s, share, cones):
    """Note that pixel ``i`` shows cone ``c`` at ``t``, where the normal points away from c(s)."""
    dx, dy, dz = buf[DX + i], buf[DY + i], buf[DZ + i]
    x, y, z = t * dx, t * dy, t * dz
    nx, ny, nz = x - cones[c, 0] - s * cones[c, 3], y - cones[c, 1] - s * cones[c, 4], z - cones[c, 2] - s * cones[c, 5]
    inverse = ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, F(1e-12)))
    points[X + count], points[Y + count], points[Z + count] = x, y, z
    points[NX + count], points[NY + count], points[NZ + count] = nx * inverse, ny * inverse, nz * inverse
    points[WIDTH + count], points[SHARE + count], points[WAY + count] = t * buf[SPREAD + i], share, t
    ids[count], pixels[count] = c, i


@kernel(fastmath=FLAGS)
def _gather(buf, listed, camera, owners, cones, points, ids, pixels):
    """List the points that a tile shows, each with its share of the pixel; return how many.

    From near to far, each edge covers its share of what is left, then the front covers the rest, or the floor does.
    """
    ground = F(-camera[1])
    for i in range(N):
        seen = (buf[DY + i] < F(-1e-6)) & (buf[FRONT_T + i] >= FAR)
        ids[i] = FLOOR if seen else NOTHING
        points[X + i], points[Y + i], points[Z + i] = buf[GROUND_X + i], ground, buf[GROUND_Z + i]
        points[NX + i], points[NY + i], points[NZ + i] = ZERO, ONE, ZERO
        points[WIDTH + i] = HALF * min(buf[WIDTH_X + i], buf[WIDTH_Z + i])
    count = np.int64(N)
    if listed.shape[0] == 0:
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
            c = listed[int(buf[EDGE_I + o])]
            # Capsules of one limb share their outline: together they cover what the widest of them does.
            if owners[c] != owner or t - last_t > F(0.12):
                before = rest
            owner, last_t = owners[c], t
            left = min(rest, before * (ONE - buf[EDGE_C + o]))
            if rest - left < F(0.003):
                continue
            _add_point(points, ids, pixels, count, buf, i, c, t, buf[EDGE_S + o], rest - left, cones)
            count += 1
            rest = left
        if front_t < FAR:
            front = count
            c = listed[int(buf[FRONT_I + i])]
            _add_point(points, ids, pixels, count, buf, i, c, front_t, buf[FRONT_S + i], rest, cones)
            count += 1
            gap = buf[NEXT_T + i] - front_t
            if gap < F(12.0) * points[WIDTH + front]:
                # Two surfaces cross near the pixel: they share it by how far the crossing line is from its middle.
                c = listed[int(buf[NEXT_I + i])]
                _add_point(points, ids, pixels, count, buf, i, c, buf[NEXT_T + i], buf[NEXT_S + i], ZERO, cones)
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
                    count += 1
            rest = ZERO
        buf[REST + i] = rest
    return count


@kernel(fastmath=FLAGS)
def _cell(u, v, grid):
    """Return the number of the cell of a grid that a place lies in, -1 outside."""
    column, row = np.floor((u - F(grid[0])) * F(grid[2])), np.floor((v - F(grid[1])) * F(grid[2]))
    if column >= ZERO and row >= ZERO and column < grid[3] and row < grid[4]:
        return int(row) * int(grid[3]) + int(column)
    return -1


@kernel(fastmath=FLAGS)
def _collect(points, start, stop, ax, ay, az, bx, by, bz, grid, offsets, entries, stamps, near, most):
    """List every cone of the cells of a grid that some points may lie in, each once.

    Return how many, or -1 where there are more than ``most``. The axes a and b of the grid are given in the world. The
    points of the floor, whole rows of pixels, lie between those at the corners.
    """
    low_u, high_u, low_v, high_v = FAR, -FAR, FAR, -FAR
    floor = stop <= N
    for q in range(4 if floor else stop - start):
        p = start + (7 * (q & 1) + (stop - start - 8) * (q >> 1) if floor else q)
        x, y, z = points[X + p], points[Y + p], points[Z + p]
        u, v = x * ax + y * ay + z * az, x * bx + y * by + z * bz
        low_u, high_u = min(low_u, u), max(high_u, u)
        low_v, high_v = min(low_v, v), max(high_v, v)
    left, top, per_metre, columns, rows = F(grid[0]), F(grid[1]), F(grid[2]), int(grid[3]), int(grid[4])
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
def _cast_shadow(points, ids, start, stop, c, shades, lx, ly, lz, ux, uy, uz, vx, vy, vz, softness, widest):
    """Take from some points the share of the sun that cone ``c`` hides from them, save from its own.

    In light space (u, v across the rays, w towards the sun) a cone is a flat segment with a width. Its edge is soft by
    the sun's apparent size times the way the light has to go: shadows are sharp where they meet what casts them.
    """
    su, sv, sw, bu, bv, bw = shades[c, 0], shades[c, 1], shades[c, 2], shades[c, 3], shades[c, 4], shades[c, 5]
    first, more, over = shades[c, 6], shades[c, 7], shades[c, 8]
    for q in range(stop - start):
        p = U(start) + U(q)
        x, y, z = points[AT_X + p], points[AT_Y + p], points[AT_Z + p]
        au, av = x * ux + y * uy + z * uz - su, x * vx + y * vy + z * vz - sv
        along = min(max((au * bu + av * bv) * over, ZERO), ONE)
        du, dv = au - along * bu, av - along * bv
        radius = first + along * more
        way = max(sw + along * bw - (x * lx + y * ly + z * lz), ZERO)
        soft = max(softness * way, min(points[AT_WIDTH + p], widest))
        gap = math.sqrt(du * du + dv * dv) - radius
        dark = min(max(HALF - HALF * gap / soft, ZERO), ONE)
        # What lies beside the point rather than above it casts no shadow on it.
        dark = dark * dark * (F(3.0) - TWO * dark) * min(way / (F(0.4) * radius), ONE)
        dark = ZERO if ids[p] == c else dark
        points[AT_SUN + p] = min(points[AT_SUN + p], ONE - dark)


@kernel(fastmath=FLAGS)
def _cast_shadows(points, ids, start, stop, listed, shades, light):
    """Take from some points the share of the sun that each of some cones hides."""
    lx, ly, lz = F(light[0]), F(light[1]), F(light[2])
    ux, uy, uz, vx, vy, vz = F(light[3]), F(light[4]), F(light[5]), F(light[6]), F(light[7]), F(light[8])
    softness, widest = F(light[14]), F(light[15])
    for index in range(listed.shape[0]):
        _cast_shadow(
            points, ids, start, stop, listed[index], shades, lx, ly, lz, ux, uy, uz, vx, vy, vz, softness, widest
        )


@kernel(fastmath=FLAGS)
def _find_sun(points, ids, count, light, grid, shades, offsets, entries, stamps, near):
    """Write the share of the sun that every point sees past all cones but its own."""
    ux, uy, uz, vx, vy, vz = F(light[3]), F(light[4]), F(light[5]), F(light[6]), F(light[7]), F(light[8])
    for p in range(count):
        points[SUN + p] = ONE
    for part in range(2):
        start, stop = (0, N) if part == 0 else (N, count)
        if start == stop:
            continue
        several = _collect(
            points, start, stop, ux, uy, uz, vx, vy, vz, grid, offsets, entries, stamps, near, np.int64(TOGETHER)
        )
        if several > 0:
            _cast_shadows(points, ids, start, stop, near[:several], shades, light)
        if several >= 0:
            continue
        for low in range(start, stop, 8):
            high = min(low + 8, stop)
            several = _collect(
                points, low, high, ux, uy, uz, vx, vy, vz, grid, offsets, entries, stamps, near, near.shape[0]
            )
            if several > 0:
                _cast_shadows(points, ids, low, high, near[:several], shades, light)
            if several >= 0:
                continue
            for p in range(low, high):
                x, y, z = points[X + p], points[Y + p], points[Z + p]
                cell = _cell(x * ux + y * uy + z * uz, x * vx + y * vy + z * vz, grid)
                if cell >= 0:
                    _cast_shadows(points, ids, p, p + 1, entries[offsets[cell] : offsets[cell + 1]], shades, light)


@kernel(fastmath=FLAGS)
def _cover_sky(points, ids, start, stop, only, c, cones, strength, reach):
    """Take from the points of cone ``only`` the share of their sky that cone ``c`` hides, none beyond ``reach``."""
    mx, my, mz, r, k = cones[c, 0], cones[c, 1], cones[c, 2], cones[c, 6], cones[c, 7]
    hx, hy, hz = cones[c, 3], cones[c, 4], cones[c, 5]
    over = ONE / max(hx * hx + hy * hy + hz * hz, TINY)
    fade = ONE / reach
    for q in range(stop - start):
        p = U(start) + U(q)
        ox, oy, oz = points[AT_X + p] - mx, points[AT_Y + p] - my, points[AT_Z + p] - mz
        s = min(max((ox * hx + oy * hy + oz * hz) * over, -ONE), ONE)
        vx, vy, vz = s * hx - ox, s * hy - oy, s * hz - oz
        radius = r + s * k
        square = max(vx * vx + vy * vy + vz * vz, TINY)
        distance = math.sqrt(square)
        near = min(max(ONE - (distance - radius) * fade, ZERO), ONE)
        facing = max(vx * points[AT_NX + p] + vy * points[AT_NY + p] + vz * points[AT_NZ + p], ZERO) / distance
        share = facing * min(radius * radius / square, ONE) * near * near
        free = points[AT_SKY + p]
        points[AT_SKY + p] = free * (ONE - strength * share) if ids[p] == only else free


@kernel(fastmath=FLAGS)
def _find_sky(points, ids, count, cones, neighbours, grid, reach, offsets, entries, stamps, near):
    """Write the share of the sky that every point sees past what is near it: feet on the floor, limbs on a body."""
    start, stop, floor = np.int64(0), np.int64(N), np.int32(FLOOR)
    for p in range(count):
        points[SKY + p] = ONE
    several = _collect(
        points, start, stop, ONE, ZERO, ZERO, ZERO, ZERO, ONE, grid, offsets, entries, stamps, near, near.shape[0]
    )
    for index in range(several):
        _cover_sky(points, ids, start, stop, floor, near[index], cones, ONE, reach)
    if several < 0:
        for p in range(N):
            cell = _cell(points[X + p], points[Z + p], grid)
            if cell >= 0 and ids[p] == FLOOR:
                for place in range(offsets[cell], offsets[cell + 1]):
                    _cover_sky(points, ids, p, p + 1, floor, entries[place], cones, ONE, reach)
    stamp = stamps[-1] + 1
    stamps[-1] = stamp
    for first in range(N, count):
        c = ids[first]
        if stamps[c] != stamp:
            stamps[c] = stamp
            for slot in range(neighbours.shape[1]):
                if neighbours[c, slot] < 0:
                    break
                _cover_sky(points, ids, first, count, c, neighbours[c, slot], cones, F(0.75), F(0.15))


@kernel(fastmath=FLAGS)
def _paint_points(buf, points, ids, pixels, count, camera, light, paints):
    """Add the colour of every point to its pixel: sun, sky, light from the floor, gloss and haze."""
    lx, ly, lz = F(light[0]), F(light[1]), F(light[2])
    height, haze = F(camera[1]), F(1.0 / camera[15])
    for i in range(N):
        buf[RED + i] *= buf[REST + i]
        buf[GREEN + i] *= buf[REST + i]
        buf[BLUE + i] *= buf[REST + i]
    for p in range(N, count):
        c, i = ids[p], pixels[p]
        dx, dy, dz = buf[DX + i], buf[DY + i], buf[DZ + i]
        nx, ny, nz = points[NX + p], points[NY + p], points[NZ + p]
        free = points[SKY + p]
        sun = points[SUN + p] * max(nx * lx + ny * ly + nz * lz, ZERO)
        sky = free * (HALF + HALF * ny)
        # Near the floor a body hides the light that would come back from it.
        floor = free * (HALF - HALF * ny) * min(F(0.35) + F(0.8) * max(points[Y + p] + height, ZERO), ONE)
        hx, hy, hz = lx - dx, ly - dy, lz - dz
        shine = max(hx * nx + hy * ny + hz * nz, ZERO) / math.sqrt(max(hx * hx + hy * hy + hz * hz, TINY))
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine * shine
        gloss = paints[c, 3]
        shine = gloss * min(TWO * sun, ONE) * shine * shine
        # At a grazing angle everything mirrors the sky.
        rim = max(ONE + nx * dx + ny * dy + nz * dz, ZERO)
        rim = rim * rim
        rim = F(0.35) * gloss * sky * rim * rim
        far = points[WAY + p] * haze
        far = far * far
        fog = far / (ONE + far)
        share, clear = points[SHARE + p] * fog, points[SHARE + p] * (ONE - fog)
        red = paints[c, 0] * (F(1.22) * sun + F(0.40) * sky + F(0.20) * floor) + shine + F(0.8) * rim
        green = paints[c, 1] * (F(1.19) * sun + F(0.45) * sky + F(0.20) * floor) + shine + F(0.9) * rim
        blue = paints[c, 2] * (F(1.11) * sun + F(0.53) * sky + F(0.19) * floor) + shine + rim
        buf[RED + i] += clear * red + share * F(0.66)
        buf[GREEN + i] += clear * green + share * F(0.73)
        buf[BLUE + i] += clear * blue + share * F(0.81)


@kernel(fastmath=FLAGS)
def _lay_arena(buf, camera, arena):
    """Write which share of every pixel lies on the line around the arena, and which outside it."""
    for i in range(N):
        buf[LINE + i] = ZERO
        buf[OUTSIDE + i] = ZERO
    if arena[0] == 0.0:
        return
    round_ = arena[0] == 1.0
    cx, cz = F(arena[1] - camera[0]), F(arena[2] - camera[2])
    half_x, half_z, thick = F(arena[3]), F(arena[4]), F(arena[5])
    for i in range(N):
        dx, dz = abs(buf[GROUND_X + i] - cx), abs(buf[GROUND_Z + i] - cz)
        wx, wz = buf[WIDTH_X + i], buf[WIDTH_Z + i]
        if round_:
            way = max(math.sqrt(dx * dx + dz * dz), F(1e-6))
            beyond = way - half_x
            w = (dx * wx + dz * wz) / way
        else:
            qx, qz = dx - half_x, dz - half_z
            beyond, w = (qx, wx) if qx > qz else (qz, wz)
        # A line narrower than a pixel would come and go.
        half = max(thick, min(F(0.6) * w, F(0.3)))
        shown = min(beyond + HALF * w, half) - max(beyond - HALF * w, -half)
        buf[LINE + i] = max(shown, ZERO) / w
        buf[OUTSIDE + i] = min(max(beyond / w + HALF, ZERO), ONE)


@kernel(fastmath=FLAGS)
def _paint_background(buf, points, camera, light):
    """Write the colour of floor and sky: squares of 1 m, lines every 5 m, fine ones every 0.1 m near the eye.

    A white line surrounds the arena, and the floor outside is darker.
    """
    # Wrapping the eye's place keeps the sums small; 10 m is a common period of all patterns.
    ex, ez = F(camera[0] - 10.0 * np.floor(camera[0] / 10.0)), F(camera[2] - 10.0 * np.floor(camera[2] / 10.0))
    haze = F(1.0 / camera[15])
    sun = F(light[1])
    for i in range(N):
        x, z = buf[GROUND_X + i] + ex, buf[GROUND_Z + i] + ez
        wx, wz = buf[WIDTH_X + i], buf[WIDTH_Z + i]
        squares = _checks(x, wx) * _checks(z, wz)
        fifth = F(0.2)
        line = ONE - (ONE - _stripes(x * fifth, wx * fifth, F(0.008))) * (
            ONE - _stripes(z * fifth, wz * fifth, F(0.008))
        )
        ten = F(10.0)
        fine = ONE - (ONE - _stripes(x * ten, wx * ten, F(0.06))) * (ONE - _stripes(z * ten, wz * ten, F(0.06)))
        fine = fine * min(max(F(1.3) - F(45.0) * max(wx, wz), ZERO), ONE)
        albedo = F(0.40) + F(0.055) * squares
        albedo = albedo * (ONE - F(0.34) * line) * (ONE - F(0.13) * fine) * (ONE - F(0.30) * buf[OUTSIDE + i])
        albedo = albedo + buf[LINE + i] * (F(0.85) - albedo)
        direct = sun * points[SUN + i]
        sky = points[SKY + i]
        far = buf[GROUND_T + i] * haze
        far = far * far
        fog = far / (ONE + far)
        fog = fog if buf[DY + i] < F(-1e-6) else ONE
        up = ONE - max(buf[DY + i], ZERO)
        up = ONE - up * up * up
        clear = ONE - fog
        buf[RED + i] = clear * albedo * (F(1.22) * direct + F(0.37) * sky) + fog * (F(0.66) - F(0.42) * up)
        buf[GREEN + i] = clear * albedo * (F(1.19) * direct + F(0.42) * sky) + fog * (F(0.73) - F(0.36) * up)
        buf[BLUE + i] = clear * albedo * (F(1.11) * direct + F(0.50) * sky) + fog * (F(0.81) - F(0.20) * up)


@kernel(fastmath=FLAGS)
def _flash(buf, x0, y0, flashes):
    """Add a star and a ring of light for every flash whose square touches the tile."""
    for f in range(flashes.shape[0]):
        fx, fy, size = flashes[f, 0] - x0, flashes[f, 1] - y0, flashes[f, 3]
        reach = 2.2 * size
        if fx + reach < 0.0 or fy + reach < 0.0 or fx - reach > 8.0 or fy - reach > 8.0:
            continue
        depth, age, power = flashes[f, 2], flashes[f, 4], flashes[f, 5]
        for i in range(N):
            x, y = ((i & 7) + 0.5 - fx) / size, ((i >> 3) + 0.5 - fy) / size
            square = x * x + y * y
            if square >= 4.8 or buf[FRONT_T + i] < depth:
                continue
            window = 1.0 - square / 4.8
            window *= window
            p, q = x + y, x - y
            rays = 1.0 / (1.0 + 60.0 * x * x * y * y / (square + 0.02)) + 0.4 / (1.0 + 40.0 * p * p * q * q)
            core = 1.0 / (1.0 + 30.0 * square)
            star = core * (1.2 + 1.5 * rays)
            ring = math.sqrt(square) - 0.3 - 1.3 * age
            ring = 0.5 / (1.0 + 220.0 * ring * ring)
            glow = power * window * (star * (1.0 - age) + ring * (1.0 - age)) * (1.0 - age)
            buf[RED + i] += F(1.5 * glow)
            buf[GREEN + i] += F(1.15 * glow)
            buf[BLUE + i] += F(0.55 * glow)


@kernel(fastmath=FLAGS)
def _develop(buf, packed, x0, y0, out):
    """Write a tile's linear colours as bytes."""
    for i in range(3 * N):
        value = max(buf[RED + i], ZERO)
        # A shoulder keeps highlights from clipping; the square root stands for the display's curve.
        value = value if value < F(0.8) else F(0.8) + (value - F(0.8)) / (ONE + F(2.0) * (value - F(0.8)))
        buf[RED + i] = min(math.sqrt(value) * F(255.0) + HALF, F(255.0))
    for i in range(N):
        packed[i] = (np.int32(buf[BLUE + i]) << 16) + (np.int32(buf[GREEN + i]) << 8) + np.int32(buf[RED + i])
    high, wide = min(8, out.shape[0] - y0), min(8, out.shape[1] - x0)
    for y in range(high):
        for x in range(wide):
            colour = packed[8 * y + x]
            out[y0 + y, x0 + x, 0] = colour & 255
            out[y0 + y, x0 + x, 1] = (colour >> 8) & 255
            out[y0 + y, x0 + x, 2] = colour >> 16


@kernel(fastmath=FLAGS)
def draw_tiles(
    first, step, camera, light, floor, cones, spans, shades, paints, owners, neighbours,
    tile_offsets, tile_entries, light_offsets, light_entries, floor_offsets, floor_entries, arena, flashes, out,
):  # fmt: skip
    """Draw every ``step``-th tile of a picture, from tile ``first`` on.

    Tiles do not know each other, so any sharing out of them gives the same picture.

    Args:
        first: Number of the first tile; tiles count along rows.
        step: Distance to the next one.
        camera: Eye (3), right (3), up (3), ahead (3), focal length [px], middle of the picture x, y [px], distance at
            which haze hides half [m]. Shape (16,).
        light: Direction to the sun (3), two directions across it (3, 3), corner u, v of the grid of shadows [m], its
            cells a metre, its columns and rows, softness (tangent of the sun's apparent radius), widest blur [m].
        floor: Corner x, z of the grid of contacts [m], its cells a metre, its columns and rows, reach [m].
        cones: Middle relative to the eye (3), half axis (3), middle radius, half the difference. Shape (K, 8), float32.
        spans: First and last row of pixels that each cone may touch. Shape (K, 2), int32.
        shades: In light space relative to the eye, one end (3), the way to the other (3), first radius, difference to
            the second, one over the squared flat length. Shape (K, 9), float32.
        paints: Linear red, green, blue and gloss. Shape (K, 4), float32.
        owners: Avatar of each cone. Shape (K,), int32.
        neighbours: Cones of the same avatar that may darken each cone, -1 after the last. Shape (K, n), int32.
        tile_offsets: CSR offsets of each tile's cones; likewise cells of the grids of shadows and of contacts.
        tile_entries: The cones.
        light_offsets: See ``tile_offsets``.
        light_entries: See ``tile_entries``.
        floor_offsets: See ``tile_offsets``.
        floor_entries: See ``tile_entries``.
        arena: Kind (0 none, 1 circle, 2 rectangle), centre x and z, half the sizes along x and z, half the width of
            the line around it [m]. Shape (6,).
        flashes: Place x, y [px], distance [m], size [px], age 0..1, power. Shape (H, 6), float32.
        out: The picture. Shape (height, width, 3), uint8.
    """
    buf, points = np.zeros(SCRATCH, np.float32), np.zeros(POINT_SCRATCH, np.float32)
    ids, pixels = np.zeros(POINTS, np.int32), np.zeros(POINTS, np.int32)
    stamps, near = np.zeros(cones.shape[0] + 1, np.int32), np.empty(64, np.int32)
    columns, rows = (out.shape[1] + 7) // 8, (out.shape[0] + 7) // 8
    for tile in range(first, columns * rows, step):
        x0, y0 = 8 * (tile % columns), 8 * (tile // columns)
        _start_tile(buf, x0, y0, camera)
        listed = tile_entries[tile_offsets[tile] : tile_offsets[tile + 1]]
        for index in range(listed.shape[0]):
            c = listed[index]
            top, bottom = max(spans[c, 0] - y0, 0), min(spans[c, 1] - y0, 7)
            _meet(
                buf, 8 * top, 8 * bottom + 8, F(index), cones[c, 0], cones[c, 1], cones[c, 2],
                cones[c, 3], cones[c, 4], cones[c, 5], cones[c, 6], cones[c, 7],
            )  # fmt: skip
        _lay_ground(buf, camera)
        _lay_arena(buf, camera, arena)
        count = _gather(buf, listed, camera, owners, cones, points, ids, pixels)
        _find_sun(points, ids, count, light, light[9:14], shades, light_offsets, light_entries, stamps, near)
        _find_sky(points, ids, count, cones, neighbours, floor, F(floor[5]), floor_offsets, floor_entries, stamps, near)
        _paint_background(buf, points, camera, light)
        if count > N:
            _paint_points(buf, points, ids, pixels, count, camera, light, paints)
        if flashes.shape[0] > 0:
            _flash(buf, x0, y0, flashes)
        _develop(buf, pixels, x0, y0, out)

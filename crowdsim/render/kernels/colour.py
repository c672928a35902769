"""Compiled colours: lit points, flashes, and the bytes of a picture."""

import math

import numpy as np

import crowdsim.render.kernels.tiles as tiles
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED
from crowdsim.jit import kernel
from crowdsim.render.kernels.tiles import FLAGS, HALF, ONE, TINY, TWO, ZERO, F, N


@kernel(fastmath=FLAGS)
def paint_points(buf, lit, count, camera, light):
    """Add the colour of every point to its pixel: sun, sky, light from the floor, gloss and haze."""
    points, pixels = lit.values, lit.pixels
    lx, ly, lz = F(light.sun_x), F(light.sun_y), F(light.sun_z)
    height, haze = F(camera.eye_y), F(1.0 / camera.haze)
    sun_red, sun_green, sun_blue = F(light.sun_red), F(light.sun_green), F(light.sun_blue)
    sky_red, sky_green, sky_blue = F(light.sky_red), F(light.sky_green), F(light.sky_blue)
    low_red, low_green, low_blue = F(light.bounce_red), F(light.bounce_green), F(light.bounce_blue)
    far_red, far_green, far_blue = F(light.horizon_red), F(light.horizon_green), F(light.horizon_blue)
    thick = ZERO if light.flat > 0.0 else ONE
    for i in range(N):
        buf[tiles.RED + i] *= buf[tiles.REST + i]
        buf[tiles.GREEN + i] *= buf[tiles.REST + i]
        buf[tiles.BLUE + i] *= buf[tiles.REST + i]
    for p in range(N, count):
        i = pixels[p]
        dx, dy, dz = buf[tiles.DX + i], buf[tiles.DY + i], buf[tiles.DZ + i]
        nx, ny, nz = points[tiles.NX + p], points[tiles.NY + p], points[tiles.NZ + p]
        free = points[tiles.SKY + p]
        sun = points[tiles.SUN + p] * max(nx * lx + ny * ly + nz * lz, ZERO)
        sky = free * (HALF + HALF * ny)
        # Near the floor a body hides the light that would come back from it.
        floor = free * (HALF - HALF * ny) * min(F(0.35) + F(0.8) * max(points[tiles.Y + p] + height, ZERO), ONE)
        hx, hy, hz = lx - dx, ly - dy, lz - dz
        shine = max(hx * nx + hy * ny + hz * nz, ZERO) / math.sqrt(max(hx * hx + hy * hy + hz * hz, TINY))
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine
        shine = shine * shine * shine
        gloss = points[tiles.TINT_GLOSS + p]
        shine = gloss * min(TWO * sun, ONE) * shine * shine
        # At a grazing angle everything mirrors the sky.
        rim = max(ONE + nx * dx + ny * dy + nz * dz, ZERO)
        rim = rim * rim
        rim = F(0.35) * gloss * sky * rim * rim
        far = points[tiles.WAY + p] * haze
        far = far * far
        fog = thick * far / (ONE + far)
        share, clear = points[tiles.SHARE + p] * fog, points[tiles.SHARE + p] * (ONE - fog)
        red = points[tiles.TINT_RED + p] * (sun_red * sun + sky_red * sky + low_red * floor) + shine + F(0.8) * rim
        green = (
            points[tiles.TINT_GREEN + p] * (sun_green * sun + sky_green * sky + low_green * floor)
            + shine
            + F(0.9) * rim
        )
        blue = points[tiles.TINT_BLUE + p] * (sun_blue * sun + sky_blue * sky + low_blue * floor) + shine + rim
        buf[tiles.RED + i] += clear * red + share * far_red
        buf[tiles.GREEN + i] += clear * green + share * far_green
        buf[tiles.BLUE + i] += clear * blue + share * far_blue


@kernel(fastmath=FLAGS)
def add_flashes(buf, x0, y0, flashes):
    """Add a mark of light for every flash whose square touches the tile.

    Warm star and ring: landed; blue dot in a ring that stays: blocked; green ring that grows: evaded; grey cross:
    missed.
    """
    for f in range(flashes.shape[0]):
        fx, fy, size = flashes[f].x - x0, flashes[f].y - y0, flashes[f].size
        reach = 2.2 * size
        if fx + reach < 0.0 or fy + reach < 0.0 or fx - reach > 8.0 or fy - reach > 8.0:
            continue
        depth, age, power = flashes[f].depth, flashes[f].age, flashes[f].power
        outcome = np.int64(flashes[f].outcome)
        red, green, blue = _mark_colour(outcome)
        for i in range(N):
            x, y = ((i & 7) + 0.5 - fx) / size, ((i >> 3) + 0.5 - fy) / size
            square = x * x + y * y
            if square >= 4.8 or buf[tiles.FRONT_T + i] < depth:
                continue
            window = 1.0 - square / 4.8
            glow = power * window * window * _mark(outcome, x, y, square, age) * (1.0 - age) * (1.0 - age)
            buf[tiles.RED + i] += F(red * glow)
            buf[tiles.GREEN + i] += F(green * glow)
            buf[tiles.BLUE + i] += F(blue * glow)


@kernel(inline=True)
def _mark_colour(outcome):
    """Return red, green and blue of the mark of an outcome."""
    if outcome == LANDED:
        return 1.5, 1.15, 0.55
    if outcome == BLOCKED:
        return 0.35, 0.8, 1.9
    if outcome == EVADED:
        return 0.35, 1.5, 0.4
    return 0.9, 0.9, 0.95


@kernel(inline=True)
def _mark(outcome, x, y, square, age):
    """Return the brightness of the mark of an outcome at a point, in units of its size."""
    far, p, q = math.sqrt(square), x + y, x - y
    if outcome == LANDED:
        rays = 1.0 / (1.0 + 60.0 * x * x * y * y / (square + 0.02)) + 0.4 / (1.0 + 40.0 * p * p * q * q)
        core = 1.0 / (1.0 + 30.0 * square)
        ring = far - 0.3 - 1.3 * age
        return core * (1.2 + 1.5 * rays) + 0.5 / (1.0 + 220.0 * ring * ring)
    if outcome == BLOCKED:
        ring = far - 0.65
        return 1.2 / (1.0 + 180.0 * ring * ring) + 1.2 / (1.0 + 40.0 * square)
    if outcome == EVADED:
        ring = far - 0.4 - 0.8 * age
        return 0.9 / (1.0 + 260.0 * ring * ring)
    arm = min(abs(p), abs(q))
    return 0.7 / (1.0 + 300.0 * arm * arm) if square < 0.3 else 0.0


@kernel(fastmath=FLAGS)
def develop(buf, packed, x0, y0, out):
    """Write a tile's linear colours as bytes; with a fourth channel as colours of figures alone, and how they cover."""
    is_clear = out.shape[2] == 4
    if is_clear:
        for i in range(N):
            # Flashes shine where no figure is.
            glow = (
                max(buf[tiles.RED + i], max(buf[tiles.GREEN + i], buf[tiles.BLUE + i]))
                if buf[tiles.REST + i] > F(0.996)
                else ZERO
            )
            cover = min(max(ONE - buf[tiles.REST + i], glow), ONE)
            over = ONE / max(cover, F(1e-3))
            buf[tiles.RED + i] *= over
            buf[tiles.GREEN + i] *= over
            buf[tiles.BLUE + i] *= over
            buf[tiles.REST + i] = cover
    for i in range(3 * N):
        value = max(buf[tiles.RED + i], ZERO)
        # A shoulder keeps highlights from clipping; the square root approximates the display's curve.
        value = value if value < F(0.8) else F(0.8) + (value - F(0.8)) / (ONE + F(2.0) * (value - F(0.8)))
        buf[tiles.RED + i] = min(math.sqrt(value) * F(255.0) + HALF, F(255.0))
    for i in range(N):
        packed[i] = (
            (np.int32(buf[tiles.BLUE + i]) << 16) + (np.int32(buf[tiles.GREEN + i]) << 8) + np.int32(buf[tiles.RED + i])
        )
    high, wide = min(8, out.shape[0] - y0), min(8, out.shape[1] - x0)
    for y in range(high):
        for x in range(wide):
            colour = packed[8 * y + x]
            out[y0 + y, x0 + x, 0] = colour & 255
            out[y0 + y, x0 + x, 1] = (colour >> 8) & 255
            out[y0 + y, x0 + x, 2] = colour >> 16
            if is_clear:
                out[y0 + y, x0 + x, 3] = np.int32(buf[tiles.REST + 8 * y + x] * F(255.0) + HALF)

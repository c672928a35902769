"""Compiled colours: lit points, flashes, and the bytes of a picture."""

import math

import numpy as np

from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED
from crowdsim.jit import kernel
from crowdsim.render.kernels.columns import (
    BOUNCE_BLUE,
    BOUNCE_GREEN,
    BOUNCE_RED,
    EYE_Y,
    FLASH_AGE,
    FLASH_DEPTH,
    FLASH_OUTCOME,
    FLASH_POWER,
    FLASH_SIZE,
    FLASH_X,
    FLASH_Y,
    FLAT,
    HAZE,
    HORIZON_BLUE,
    HORIZON_GREEN,
    HORIZON_RED,
    SKY_BLUE,
    SKY_GREEN,
    SKY_RED,
    SUN_BLUE,
    SUN_GREEN,
    SUN_RED,
    SUN_X,
    SUN_Y,
    SUN_Z,
)
from crowdsim.render.kernels.tiles import (
    BLUE,
    DX,
    DY,
    DZ,
    FLAGS,
    FRONT_T,
    GREEN,
    HALF,
    NX,
    NY,
    NZ,
    ONE,
    RED,
    REST,
    SHARE,
    SKY,
    SUN,
    TINT_BLUE,
    TINT_GLOSS,
    TINT_GREEN,
    TINT_RED,
    TINY,
    TWO,
    WAY,
    ZERO,
    F,
    N,
    Y,
)


@kernel(fastmath=FLAGS)
def paint_points(buf, lit, count, camera, light):
    """Add the colour of every point to its pixel: sun, sky, light from the floor, gloss and haze."""
    points, pixels = lit.values, lit.pixels
    lx, ly, lz = F(light[SUN_X]), F(light[SUN_Y]), F(light[SUN_Z])
    height, haze = F(camera[EYE_Y]), F(1.0 / camera[HAZE])
    sun_red, sun_green, sun_blue = F(light[SUN_RED]), F(light[SUN_GREEN]), F(light[SUN_BLUE])
    sky_red, sky_green, sky_blue = F(light[SKY_RED]), F(light[SKY_GREEN]), F(light[SKY_BLUE])
    low_red, low_green, low_blue = F(light[BOUNCE_RED]), F(light[BOUNCE_GREEN]), F(light[BOUNCE_BLUE])
    far_red, far_green, far_blue = F(light[HORIZON_RED]), F(light[HORIZON_GREEN]), F(light[HORIZON_BLUE])
    thick = ZERO if light[FLAT] > 0.0 else ONE
    for i in range(N):
        buf[RED + i] *= buf[REST + i]
        buf[GREEN + i] *= buf[REST + i]
        buf[BLUE + i] *= buf[REST + i]
    for p in range(N, count):
        i = pixels[p]
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
        gloss = points[TINT_GLOSS + p]
        shine = gloss * min(TWO * sun, ONE) * shine * shine
        # At a grazing angle everything mirrors the sky.
        rim = max(ONE + nx * dx + ny * dy + nz * dz, ZERO)
        rim = rim * rim
        rim = F(0.35) * gloss * sky * rim * rim
        far = points[WAY + p] * haze
        far = far * far
        fog = thick * far / (ONE + far)
        share, clear = points[SHARE + p] * fog, points[SHARE + p] * (ONE - fog)
        red = points[TINT_RED + p] * (sun_red * sun + sky_red * sky + low_red * floor) + shine + F(0.8) * rim
        green = points[TINT_GREEN + p] * (sun_green * sun + sky_green * sky + low_green * floor) + shine + F(0.9) * rim
        blue = points[TINT_BLUE + p] * (sun_blue * sun + sky_blue * sky + low_blue * floor) + shine + rim
        buf[RED + i] += clear * red + share * far_red
        buf[GREEN + i] += clear * green + share * far_green
        buf[BLUE + i] += clear * blue + share * far_blue


@kernel(fastmath=FLAGS)
def add_flashes(buf, x0, y0, flashes):
    """Add a mark of light for every flash whose square touches the tile.

    Warm star and ring: landed; blue dot in a ring that stays: blocked; green ring that grows: evaded; grey cross:
    missed.
    """
    for f in range(flashes.shape[0]):
        fx, fy, size = flashes[f, FLASH_X] - x0, flashes[f, FLASH_Y] - y0, flashes[f, FLASH_SIZE]
        reach = 2.2 * size
        if fx + reach < 0.0 or fy + reach < 0.0 or fx - reach > 8.0 or fy - reach > 8.0:
            continue
        depth, age, power = flashes[f, FLASH_DEPTH], flashes[f, FLASH_AGE], flashes[f, FLASH_POWER]
        outcome = np.int64(flashes[f, FLASH_OUTCOME])
        red, green, blue = _mark_colour(outcome)
        for i in range(N):
            x, y = ((i & 7) + 0.5 - fx) / size, ((i >> 3) + 0.5 - fy) / size
            square = x * x + y * y
            if square >= 4.8 or buf[FRONT_T + i] < depth:
                continue
            window = 1.0 - square / 4.8
            glow = power * window * window * _mark(outcome, x, y, square, age) * (1.0 - age) * (1.0 - age)
            buf[RED + i] += F(red * glow)
            buf[GREEN + i] += F(green * glow)
            buf[BLUE + i] += F(blue * glow)


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
            glow = max(buf[RED + i], max(buf[GREEN + i], buf[BLUE + i])) if buf[REST + i] > F(0.996) else ZERO
            cover = min(max(ONE - buf[REST + i], glow), ONE)
            over = ONE / max(cover, F(1e-3))
            buf[RED + i] *= over
            buf[GREEN + i] *= over
            buf[BLUE + i] *= over
            buf[REST + i] = cover
    for i in range(3 * N):
        value = max(buf[RED + i], ZERO)
        # A shoulder keeps highlights from clipping; the square root approximates the display's curve.
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
            if is_clear:
                out[y0 + y, x0 + x, 3] = np.int32(buf[REST + 8 * y + x] * F(255.0) + HALF)

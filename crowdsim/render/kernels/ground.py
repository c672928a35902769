"""Compiled floor and sky: where rays meet the floor, its pattern, the line around an arena."""

import math

import numpy as np

from crowdsim.jit import kernel
from crowdsim.render.kernels.columns import (
    ALBEDO,
    ARENA_HALF_X,
    ARENA_HALF_Z,
    ARENA_KIND,
    ARENA_LINE,
    ARENA_X,
    ARENA_Z,
    EYE_X,
    EYE_Y,
    EYE_Z,
    FINE,
    FLAT,
    HAZE,
    HORIZON_BLUE,
    HORIZON_GREEN,
    HORIZON_RED,
    LINES,
    SHADOW,
    SKY_BLUE,
    SKY_GREEN,
    SKY_RED,
    SQUARES,
    SUN_BLUE,
    SUN_GREEN,
    SUN_RED,
    SUN_Y,
    ZENITH_BLUE,
    ZENITH_GREEN,
    ZENITH_RED,
)
from crowdsim.render.kernels.tiles import (
    BLUE,
    DX,
    DY,
    DZ,
    FLAGS,
    GREEN,
    GROUND_T,
    GROUND_X,
    GROUND_Z,
    HALF,
    LINE,
    ONE,
    OUTSIDE,
    RED,
    SKY,
    SPREAD,
    SUN,
    TWO,
    WIDTH_X,
    WIDTH_Z,
    ZERO,
    F,
    N,
)


@kernel(fastmath=FLAGS)
def lay_ground(buf, camera):
    """Write where every ray meets the floor, relative to the eye, and how wide the pixel lies there."""
    height = F(camera[EYE_Y])
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
def lay_arena(buf, camera, arena):
    """Write which share of every pixel lies on the line around the arena, and which outside it."""
    for i in range(N):
        buf[LINE + i] = ZERO
        buf[OUTSIDE + i] = ZERO
    if arena[ARENA_KIND] == 0.0:
        return
    round_ = arena[ARENA_KIND] == 1.0
    cx, cz = F(arena[ARENA_X] - camera[EYE_X]), F(arena[ARENA_Z] - camera[EYE_Z])
    half_x, half_z, thick = F(arena[ARENA_HALF_X]), F(arena[ARENA_HALF_Z]), F(arena[ARENA_LINE])
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
def paint_background(buf, points, camera, light):
    """Write the colour of floor and sky: squares of 1 m, lines every 5 m, fine ones every 0.1 m near the eye.

    A white line surrounds the arena, and the floor outside is darker. A flat background has neither pattern nor line,
    only shadows.
    """
    if light[FLAT] > 0.0:
        red, green, blue = F(light[HORIZON_RED]), F(light[HORIZON_GREEN]), F(light[HORIZON_BLUE])
        shadow = F(light[SHADOW])
        for i in range(N):
            dark = ONE - shadow * (ONE - (HALF + HALF * points[SUN + i]) * (HALF + HALF * points[SKY + i]))
            dark = dark if buf[DY + i] < F(-1e-6) else ONE
            buf[RED + i], buf[GREEN + i], buf[BLUE + i] = dark * red, dark * green, dark * blue
        return
    # Wrapping the eye's place keeps the sums small; 10 m is a common period of all patterns.
    ex, ez = (
        F(camera[EYE_X] - 10.0 * np.floor(camera[EYE_X] / 10.0)),
        F(camera[EYE_Z] - 10.0 * np.floor(camera[EYE_Z] / 10.0)),
    )
    haze = F(1.0 / camera[HAZE])
    sun = F(light[SUN_Y])
    sun_red, sun_green, sun_blue = sun * F(light[SUN_RED]), sun * F(light[SUN_GREEN]), sun * F(light[SUN_BLUE])
    # A floor sees a little less of the sky's light than bodies, which stand up into it.
    sky_red, sky_green, sky_blue = (
        F(light[SKY_RED] - 0.03),
        F(light[SKY_GREEN] - 0.03),
        F(light[SKY_BLUE] - 0.03),
    )
    bright, contrast, thick, thin = F(light[ALBEDO]), F(light[SQUARES]), F(light[LINES]), F(light[FINE])
    low_red, low_green, low_blue = F(light[HORIZON_RED]), F(light[HORIZON_GREEN]), F(light[HORIZON_BLUE])
    high_red, high_green, high_blue = (
        F(light[ZENITH_RED] - light[HORIZON_RED]),
        F(light[ZENITH_GREEN] - light[HORIZON_GREEN]),
        F(light[ZENITH_BLUE] - light[HORIZON_BLUE]),
    )
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
        albedo = bright + contrast * squares
        albedo = albedo * (ONE - thick * line) * (ONE - thin * fine) * (ONE - F(0.30) * buf[OUTSIDE + i])
        albedo = albedo + buf[LINE + i] * (F(0.85) - albedo)
        direct = points[SUN + i]
        sky = points[SKY + i]
        far = buf[GROUND_T + i] * haze
        far = far * far
        fog = far / (ONE + far)
        fog = fog if buf[DY + i] < F(-1e-6) else ONE
        up = ONE - max(buf[DY + i], ZERO)
        up = ONE - up * up * up
        clear = ONE - fog
        buf[RED + i] = clear * albedo * (sun_red * direct + sky_red * sky) + fog * (low_red + high_red * up)
        buf[GREEN + i] = clear * albedo * (sun_green * direct + sky_green * sky) + fog * (low_green + high_green * up)
        buf[BLUE + i] = clear * albedo * (sun_blue * direct + sky_blue * sky) + fog * (low_blue + high_blue * up)

"""Compiled floor and sky: where rays meet the floor, its pattern, the line around an arena."""

import math

import numpy as np

import crowdsim.render.kernels.tiles as tiles
from crowdsim.jit import kernel
from crowdsim.render.kernels.tiles import FLAGS, HALF, ONE, TWO, ZERO, F, N


@kernel(fastmath=FLAGS)
def lay_ground(buf, camera):
    """Write where every ray meets the floor, relative to the eye, and how wide the pixel lies there."""
    height = F(camera.eye_y)
    for i in range(N):
        dx, dy, dz, spread = buf[tiles.DX + i], buf[tiles.DY + i], buf[tiles.DZ + i], buf[tiles.SPREAD + i]
        down = max(-dy, F(1e-6))
        t = min(height / down, F(1e6))
        level = math.sqrt(max(dx * dx + dz * dz, F(1e-8)))
        wide = t * spread
        long = wide / down
        ax, az = abs(dx) / level, abs(dz) / level
        buf[tiles.GROUND_T + i] = t
        buf[tiles.GROUND_X + i] = t * dx
        buf[tiles.GROUND_Z + i] = t * dz
        buf[tiles.WIDTH_X + i] = max(wide * az + long * ax, F(1e-6))
        buf[tiles.WIDTH_Z + i] = max(wide * ax + long * az, F(1e-6))


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
        buf[tiles.LINE + i] = ZERO
        buf[tiles.OUTSIDE + i] = ZERO
    if arena.kind == 0.0:
        return
    round_ = arena.kind == 1.0
    cx, cz = F(arena.x - camera.eye_x), F(arena.z - camera.eye_z)
    half_x, half_z, thick = F(arena.half_x), F(arena.half_z), F(arena.line)
    for i in range(N):
        dx, dz = abs(buf[tiles.GROUND_X + i] - cx), abs(buf[tiles.GROUND_Z + i] - cz)
        wx, wz = buf[tiles.WIDTH_X + i], buf[tiles.WIDTH_Z + i]
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
        buf[tiles.LINE + i] = max(shown, ZERO) / w
        buf[tiles.OUTSIDE + i] = min(max(beyond / w + HALF, ZERO), ONE)


@kernel(fastmath=FLAGS)
def paint_background(buf, points, camera, light):
    """Write the colour of floor and sky: squares of 1 m, lines every 5 m, fine ones every 0.1 m near the eye.

    A white line surrounds the arena, and the floor outside is darker. A flat background has neither pattern nor line,
    only shadows.
    """
    if light.flat > 0.0:
        red, green, blue = F(light.horizon_red), F(light.horizon_green), F(light.horizon_blue)
        shadow = F(light.shadow)
        for i in range(N):
            dark = ONE - shadow * (ONE - (HALF + HALF * points[tiles.SUN + i]) * (HALF + HALF * points[tiles.SKY + i]))
            dark = dark if buf[tiles.DY + i] < F(-1e-6) else ONE
            buf[tiles.RED + i], buf[tiles.GREEN + i], buf[tiles.BLUE + i] = dark * red, dark * green, dark * blue
        return
    # Wrapping the eye's place keeps the sums small; 10 m is a common period of all patterns.
    ex, ez = (
        F(camera.eye_x - 10.0 * np.floor(camera.eye_x / 10.0)),
        F(camera.eye_z - 10.0 * np.floor(camera.eye_z / 10.0)),
    )
    haze = F(1.0 / camera.haze)
    sun = F(light.sun_y)
    sun_red, sun_green, sun_blue = sun * F(light.sun_red), sun * F(light.sun_green), sun * F(light.sun_blue)
    # A floor sees a little less of the sky's light than bodies, which stand up into it.
    sky_red, sky_green, sky_blue = (
        F(light.sky_red - 0.03),
        F(light.sky_green - 0.03),
        F(light.sky_blue - 0.03),
    )
    bright, contrast, thick, thin = F(light.albedo), F(light.squares), F(light.lines), F(light.fine)
    low_red, low_green, low_blue = F(light.horizon_red), F(light.horizon_green), F(light.horizon_blue)
    high_red, high_green, high_blue = (
        F(light.zenith_red - light.horizon_red),
        F(light.zenith_green - light.horizon_green),
        F(light.zenith_blue - light.horizon_blue),
    )
    for i in range(N):
        x, z = buf[tiles.GROUND_X + i] + ex, buf[tiles.GROUND_Z + i] + ez
        wx, wz = buf[tiles.WIDTH_X + i], buf[tiles.WIDTH_Z + i]
        squares = _checks(x, wx) * _checks(z, wz)
        fifth = F(0.2)
        line = ONE - (ONE - _stripes(x * fifth, wx * fifth, F(0.008))) * (
            ONE - _stripes(z * fifth, wz * fifth, F(0.008))
        )
        ten = F(10.0)
        fine = ONE - (ONE - _stripes(x * ten, wx * ten, F(0.06))) * (ONE - _stripes(z * ten, wz * ten, F(0.06)))
        fine = fine * min(max(F(1.3) - F(45.0) * max(wx, wz), ZERO), ONE)
        albedo = bright + contrast * squares
        albedo = albedo * (ONE - thick * line) * (ONE - thin * fine) * (ONE - F(0.30) * buf[tiles.OUTSIDE + i])
        albedo = albedo + buf[tiles.LINE + i] * (F(0.85) - albedo)
        direct = points[tiles.SUN + i]
        sky = points[tiles.SKY + i]
        far = buf[tiles.GROUND_T + i] * haze
        far = far * far
        fog = far / (ONE + far)
        fog = fog if buf[tiles.DY + i] < F(-1e-6) else ONE
        up = ONE - max(buf[tiles.DY + i], ZERO)
        up = ONE - up * up * up
        clear = ONE - fog
        buf[tiles.RED + i] = clear * albedo * (sun_red * direct + sky_red * sky) + fog * (low_red + high_red * up)
        buf[tiles.GREEN + i] = clear * albedo * (sun_green * direct + sky_green * sky) + fog * (
            low_green + high_green * up
        )
        buf[tiles.BLUE + i] = clear * albedo * (sun_blue * direct + sky_blue * sky) + fog * (low_blue + high_blue * up)

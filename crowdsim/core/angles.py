"""Cosine, sine and arc tangent as polynomials: cheaper than library calls, and loops over them vectorise."""

import math

from crowdsim.jit import kernel


@kernel(inline=True)
def cos_sin(angle):
    """Return cosine and sine of an angle, as exact as a library's, at half the cost.

    The remainder of a quarter turn goes into the polynomials of fdlibm. A quarter turn is subtracted in two parts, so
    that whole quarters leave no error behind.
    """
    if not abs(angle) < 1e5:
        return math.cos(angle), math.sin(angle)
    quarters = math.floor(angle * (2.0 / math.pi) + 0.5)
    v = (angle - quarters * 1.5707963267341256) - quarters * 6.077100506506192e-11
    u = v * v
    sin = 2.75573137070700676789e-06 + u * (-2.50507602534068634195e-08 + u * 1.58969099521155010221e-10)
    sin = -1.66666666666666324348e-01 + u * (8.33333333332248946124e-03 + u * (-1.98412698298579493134e-04 + u * sin))
    sin = v + v * u * sin
    cos = -2.75573143513906633035e-07 + u * (2.08757232129817482790e-09 - u * 1.13596475577881948265e-11)
    cos = 4.16666666666666019037e-02 + u * (-1.38888888888741095749e-03 + u * (2.48015872894767294178e-05 + u * cos))
    cos = 1.0 - (0.5 * u - u * u * cos)
    q = int(quarters)
    odd = q & 1 != 0
    cos, sin = (sin if odd else cos), (cos if odd else sin)
    return -cos if (q + 1) & 2 != 0 else cos, -sin if q & 2 != 0 else sin


@kernel(allocates=False)
def bearings(xs, zs, count, out):
    """Write atan2(x, z) of each position, to 2e-9: a polynomial of the smaller over the greater, which vectorises."""
    for k in range(count):
        x, z = xs[k], zs[k]
        ax, az = abs(x), abs(z)
        greater = max(ax, az)
        t = min(ax, az) / (greater if greater > 0.0 else 1.0)
        u = t * t
        angle = 0.057463975847337374 + u * (
            -0.03071783261194565 + u * (0.010680852068445015 - u * 0.0017437229102955482)
        )
        angle = -0.14261577273925508 + u * (0.10940212904732985 + u * (-0.08372095274306866 + u * angle))
        angle = t * (0.999999997551612 + u * (-0.33333282326387254 + u * (0.19998231136682537 + u * angle)))
        angle = 0.5 * math.pi - angle if ax > az else angle
        angle = math.pi - angle if z < 0.0 else angle
        out[k] = -angle if x < 0.0 else angle

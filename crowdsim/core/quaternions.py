"""Compiled arithmetic of unit quaternions (w, x, y, z) and of vectors.

Quaternions come as arrays or tuples of four and go out as tuples, so that a result may be written to any array, one of
the arguments included. The order of operations is fixed: results are the same bits wherever a function is used.
"""

import math

from crowdsim.jit import kernel


@kernel(inline=True)
def multiply(a, b):
    """Return the product of two quaternions: the rotation ``b``, then ``a``."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@kernel(inline=True)
def conjugate(q):
    """Return the inverse rotation."""
    return q[0], -q[1], -q[2], -q[3]


@kernel(inline=True)
def relative(old, new):
    """Return the rotation that leads from one quaternion to another: ``new`` times the conjugate of ``old``."""
    a, b, c, d = old
    e, f, g, h = new
    return (
        e * a + f * b + g * c + h * d,
        f * a - e * b - g * d + h * c,
        g * a - e * c - h * b + f * d,
        h * a - e * d - f * c + g * b,
    )


@kernel(inline=True)
def rotate(q, x, y, z):
    """Return a vector rotated by a quaternion."""
    tx = 2.0 * (q[2] * z - q[3] * y)
    ty = 2.0 * (q[3] * x - q[1] * z)
    tz = 2.0 * (q[1] * y - q[2] * x)
    return (
        x + q[0] * tx + q[2] * tz - q[3] * ty,
        y + q[0] * ty + q[3] * tx - q[1] * tz,
        z + q[0] * tz + q[1] * ty - q[2] * tx,
    )


@kernel(inline=True)
def unrotate(q, x, y, z):
    """Return a vector rotated by the inverse of a quaternion."""
    return rotate(conjugate(q), x, y, z)


@kernel(inline=True)
def rotate_about_y(cos, sin, q):
    """Return a quaternion followed by a rotation about +y, given by cosine and sine of half its angle."""
    return (
        cos * q[0] - sin * q[2],
        cos * q[1] + sin * q[3],
        cos * q[2] + sin * q[0],
        cos * q[3] - sin * q[1],
    )


@kernel(inline=True)
def mix(a, b, share):
    """Return the quaternion between two, on the shorter way, normalised: ``a`` at share 0, ``b`` at 1."""
    dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    other = share if dot >= 0.0 else -share
    w = a[0] * (1.0 - share) + b[0] * other
    x = a[1] * (1.0 - share) + b[1] * other
    y = a[2] * (1.0 - share) + b[2] * other
    z = a[3] * (1.0 - share) + b[3] * other
    size = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return w * size, x * size, y * size, z * size


@kernel
def mix_like(a, b, share):
    """Return the quaternion between two of like sign, normalised: ``a`` at share 0, ``b`` at 1.

    It goes the way that the signs say, even where that is the longer one: what follows two quaternions that change
    does not jump when they come to differ by more than half a rotation.
    """
    rest = 1.0 - share
    w, x, y, z = (
        a[0] * rest + b[0] * share,
        a[1] * rest + b[1] * share,
        a[2] * rest + b[2] * share,
        a[3] * rest + b[3] * share,
    )
    size = 1.0 / math.sqrt(max(w * w + x * x + y * y + z * z, 1e-12))
    return w * size, x * size, y * size, z * size


@kernel
def from_vector(x, y, z):
    """Return the quaternion of a rotation vector [rad]."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return 1.0, 0.0, 0.0, 0.0
    s = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), x * s, y * s, z * s


@kernel
def rotate_by_vector(q, x, y, z):
    """Rotate a quaternion in place by a rotation vector [rad] of the frame that the quaternion is given in."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        return
    s, c = math.sin(0.5 * angle) / angle, math.cos(0.5 * angle)
    q[0], q[1], q[2], q[3] = multiply((c, x * s, y * s, z * s), q)

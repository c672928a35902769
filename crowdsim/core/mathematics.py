"""Exponential and arc tangent of fixed bits: the same on every processor, and as fast as a library's.

They consist of additions, multiplications, divisions and comparisons of float64, which IEEE 754 defines to the last
bit; nothing is contracted into fused operations. Without branches, loops over them vectorise. Cosine and sine are in
``angles``.
"""

import math

import numpy as np

from crowdsim.jit import kernel


@kernel(inline=True)
def nearest(value):
    """Return the whole number that is nearest to a number, as a float64; of 2^51 and more, that to a few ulp.

    What is left of a number beside 1.5 * 2^52 is whole. ``math.floor`` returns an int64, which holds less.
    """
    return (value + 6755399441055744.0) - 6755399441055744.0


@kernel(inline=True)
def whole_below(value):
    """Return the greatest whole number up to a number of less than 2^51, as a float64."""
    whole = nearest(value)
    return whole - 1.0 if whole > value else whole


@kernel(inline=True)
def exp(value):
    """Return the exponential of a number, with an error of less than 1.1 ulp.

    The remainder of a multiple of log(2) goes into a polynomial. A power of two is multiplied in two steps, so that
    results below the least normal number are rounded once.
    """
    v = np.float64(value)
    v = 710.0 if v > 710.0 else v
    v = -746.0 if v < -746.0 else v
    power = nearest(v * 1.4426950408889634)
    r = (v - power * 0.6931471805598903) - power * 5.497923018708371e-14
    u = r * r
    odd = 0.16666666666666669 + u * (
        0.008333333333330065 + u * (0.00019841269863040559 + u * (2.7557268480289716e-06 + u * 2.51003758422237e-08))
    )
    even = 0.5000000000000001 + u * (
        0.041666666666624164 + u * (0.0013888888917196736 + u * (2.480152132234228e-05 + u * 2.7620075892548164e-07))
    )
    whole = np.int64(power)
    half = whole >> np.int64(1)
    result = 1.0 + (r + u * (even + r * odd))
    return result * _power_of_two(half) * _power_of_two(whole - half)


@kernel(inline=True)
def _power_of_two(exponent):
    """Return 2 to the power of an int64 from -1022 to 1023: these bits of a float64 are its exponent."""
    return np.int64((exponent + np.int64(1023)) << np.int64(52)).view(np.float64)


@kernel(inline=True)
def atan2(y, x):
    """Return the angle of a point from the x axis, with an error of less than 2 ulp; zeros have signs.

    The smaller coordinate over the greater one is at most 1. Above 0.5 the angle from the diagonal is taken, the
    tangent of which is the difference of coordinates, which is exact, over their sum.
    """
    ax, ay = abs(np.float64(x)), abs(np.float64(y))
    greater, smaller = (ay, ax) if ay > ax else (ax, ay)
    scale = 0.25 if greater > 1e300 else 1.0  # their sum overflows otherwise
    greater, smaller = greater * scale, smaller * scale
    equal = greater == smaller
    diagonal = (equal and greater > 0.0) or smaller > 0.5 * greater
    above = smaller - greater if diagonal else smaller
    below = smaller + greater if diagonal else greater
    above = 0.0 if equal else above  # of infinities and of zeros, too
    below = 1.0 if equal else below
    t = above / below
    u = t * t
    w = u * u
    even = 0.06666434610061171 + w * (0.0524002876380937 + w * (0.03805795814269889 + w * 0.009206337617942588))
    even = 0.3333333333333333 + w * (0.14285714285598292 + w * (0.09090908617404365 + w * even))
    odd = -0.05879567778296088 + w * (-0.046277152045717654 + w * -0.024992876540014267)
    odd = -0.19999999999999485 + w * (-0.11111111100846037 + w * (-0.07692294642345698 + w * odd))
    angle = t - t * u * (even + u * odd)
    eighths = 1.0 if diagonal else 0.0
    if ay > ax:
        angle, eighths = -angle, 2.0 - eighths
    if math.copysign(1.0, x) < 0.0:
        angle, eighths = -angle, 4.0 - eighths
    return math.copysign(eighths * 0.7853981633974483 + (angle + eighths * 3.061616997868383e-17), y)

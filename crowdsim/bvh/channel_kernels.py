"""Compiled rotations of BVH files: Euler channels to quaternions and back."""

import math

import numpy as np

from crowdsim.jit import kernel


@kernel
def channels_to_quaternions(motion, first, columns, axes, out):
    """Convert Euler channels [deg] to quaternions, each on the side of the sphere of the frame before.

    Joint j has the rotation channels ``columns[first[j]:first[j + 1]]`` of ``motion`` (F, C) about ``axes`` (0, 1, 2
    for x, y, z), each about the axes as the ones before it left them. ``out`` has the shape (F, J, 4).
    """
    to_half = math.pi / 360.0
    for f in range(motion.shape[0]):
        for j in range(first.shape[0] - 1):
            w, x, y, z = 1.0, 0.0, 0.0, 0.0
            for k in range(first[j], first[j + 1]):
                half = motion[f, columns[k]] * to_half
                c, s = math.cos(half), math.sin(half)
                if axes[k] == 0:
                    w, x, y, z = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s
                elif axes[k] == 1:
                    w, x, y, z = w * c - y * s, x * c - z * s, y * c + w * s, z * c + x * s
                else:
                    w, x, y, z = w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s
            if f > 0:
                dot = w * out[f - 1, j, 0] + x * out[f - 1, j, 1] + y * out[f - 1, j, 2] + z * out[f - 1, j, 3]
                if dot < 0.0:
                    w, x, y, z = -w, -x, -y, -z
            out[f, j, 0], out[f, j, 1], out[f, j, 2], out[f, j, 3] = w, x, y, z


@kernel
def quaternions_to_channels(rotations, orders, columns, previous, continued, out):
    """Write Euler channels [deg] of quaternions (F, J, 4), in each frame the triple nearest to the frame before.

    ``orders`` (J, 3) holds each joint's axes in order, all different; its channels are the three columns of ``out``
    (F, C) from ``columns[j]`` on. ``previous`` (J, 3) holds the triples before the first frame where ``continued``
    is true, and those of the last frame afterwards. With u the axis of the middle rotation and s the sign of the order,
    w + s u, w - s u and the other two components give the half sum and half difference of the outer angles.
    """
    degrees = 180.0 / math.pi
    for f in range(rotations.shape[0]):
        known = continued or f > 0
        for j in range(rotations.shape[1]):
            i0, i1, i2 = orders[j, 0], orders[j, 1], orders[j, 2]
            sign = 1.0 if (i1 - i0) % 3 == 1 else -1.0
            w = rotations[f, j, 0]
            x, y, z = rotations[f, j, 1 + i0], sign * rotations[f, j, 1 + i1], rotations[f, j, 1 + i2]
            plus, minus, total, apart = w + y, w - y, x + z, x - z
            up = math.sqrt(plus * plus + total * total)
            down = math.sqrt(minus * minus + apart * apart)
            half_sum = degrees * math.atan2(total, plus)
            half_difference = degrees * math.atan2(apart, minus)
            a0, b0, c0 = previous[j, 0], previous[j, 1], previous[j, 2]
            b = sign * (2.0 * degrees * math.atan2(up, down) - 90.0)
            if min(up, down) > 1e-7 * (up + down):
                a = half_sum + half_difference
                c = half_sum - half_difference
            else:
                # Locked: only the sum or the difference counts, so the first angle stays where it was.
                a = a0 if known else 0.0
                c = 2.0 * half_sum - a if down < up else a - 2.0 * half_difference
            if known:
                best = np.inf
                for flip in range(2):
                    ta, tb, tc = a, b, c
                    if flip == 1:
                        ta, tb, tc = a + 180.0, 180.0 - b, c + 180.0
                    ta -= 360.0 * math.floor((ta - a0) / 360.0 + 0.5)
                    tb -= 360.0 * math.floor((tb - b0) / 360.0 + 0.5)
                    tc -= 360.0 * math.floor((tc - c0) / 360.0 + 0.5)
                    far = abs(ta - a0) + abs(tb - b0) + abs(tc - c0)
                    if far < best:
                        best = far
                        previous[j, 0], previous[j, 1], previous[j, 2] = ta, tb, tc
                if best == np.inf:
                    # Not a rotation: the writer refuses it.
                    previous[j, 0], previous[j, 1], previous[j, 2] = np.nan, np.nan, np.nan
            else:
                # The usual range for the first frame.
                previous[j, 0] = a - 360.0 * math.floor(a / 360.0 + 0.5)
                previous[j, 1] = b
                previous[j, 2] = c - 360.0 * math.floor(c / 360.0 + 0.5)
            column = columns[j]
            out[f, column] = previous[j, 0]
            out[f, column + 1] = previous[j, 1]
            out[f, column + 2] = previous[j, 2]

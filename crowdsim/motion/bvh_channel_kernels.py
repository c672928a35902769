"""Compiled turns of BVH files: Euler channels to quaternions and back."""

import math

import numba as nb
import numpy as np


@nb.njit(cache=True)
def channels_to_quaternions(motion, first, columns, axes, out):
    """Turn Euler channels [deg] into quaternions, each on the side of the sphere of the frame before.

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


@nb.njit(cache=True)
def quaternions_to_channels(rotations, orders, columns, previous, continued, out):
    """Write Euler channels [deg] of quaternions (F, J, 4), in each frame the triple nearest to the frame before.

    ``orders`` (J, 3) holds each joint's axes in turn, all different; its channels are the three columns of ``out``
    (F, C) from ``columns[j]`` on. ``previous`` (J, 3) holds the triples before the first frame where ``continued``
    is true, and those of the last frame afterwards. With u the axis of the middle turn and s the sign of the order,
    w + s u, w - s u and the other two components give the half sum and half difference of the outer angles.
    """
    degrees = 180.0 / math.pi
    for j in range(rotations.shape[1]):
        i0, i1, i2 = orders[j, 0], orders[j, 1], orders[j, 2]
        sign = 1.0 if (i1 - i0) % 3 == 1 else -1.0
        a0, b0, c0 = previous[j, 0] / degrees, previous[j, 1] / degrees, previous[j, 2] / degrees
        known = continued
        for f in range(rotations.shape[0]):
            w = rotations[f, j, 0]
            x, y, z = rotations[f, j, 1 + i0], sign * rotations[f, j, 1 + i1], rotations[f, j, 1 + i2]
            length = math.sqrt(w * w + x * x + y * y + z * z)
            up = math.hypot(w + y, x + z)
            down = math.hypot(w - y, x - z)
            half_sum = math.atan2(x + z, w + y)
            half_difference = math.atan2(x - z, w - y)
            b = sign * (2.0 * math.atan2(up, down) - 0.5 * math.pi)
            if down < 1e-7 * length:
                # Locked: only the sum counts, so the first angle stays where it was.
                a = a0 if known else 0.0
                c = 2.0 * half_sum - a
            elif up < 1e-7 * length:
                a = a0 if known else 0.0
                c = a - 2.0 * half_difference
            else:
                a = half_sum + half_difference
                c = half_sum - half_difference
            if known:
                turn = 2.0 * math.pi
                best = np.inf
                besta, bestb, bestc = a, b, c
                for flip in range(2):
                    ta, tb, tc = a, b, c
                    if flip == 1:
                        ta, tb, tc = a + math.pi, math.pi - b, c + math.pi
                    ta -= turn * np.rint((ta - a0) / turn)
                    tb -= turn * np.rint((tb - b0) / turn)
                    tc -= turn * np.rint((tc - c0) / turn)
                    far = abs(ta - a0) + abs(tb - b0) + abs(tc - c0)
                    if far < best:
                        best, besta, bestb, bestc = far, ta, tb, tc
                a, b, c = besta, bestb, bestc
            else:
                # The usual range for the first frame.
                a -= 2.0 * math.pi * np.rint(a / (2.0 * math.pi))
                c -= 2.0 * math.pi * np.rint(c / (2.0 * math.pi))
            a0, b0, c0, known = a, b, c, True
            column = columns[j]
            out[f, column], out[f, column + 1], out[f, column + 2] = a * degrees, b * degrees, c * degrees
        previous[j, 0], previous[j, 1], previous[j, 2] = a0 * degrees, b0 * degrees, c0 * degrees

"""Compiled packing of rotations for glTF."""

import math

import numpy as np

from crowdsim.jit import kernel


@kernel
def pack_rotations(low, high, rotations, last, scale, out):
    """Write rotations joint by joint as x, y, z, w, unit, each on the side of the one before.

    An avatar that is absent keeps the rotation that it had.

    Args:
        low: First avatar.
        high: One past the last.
        rotations: w, x, y, z; NaN while absent. Shape (T, n, K, 4).
        last: The rotation before the first row, and then the one of the last. Shape (n, K, 4), float64.
        scale: What a one becomes: 1 for real numbers, 32767 or 127 for integers.
        out: Written. Shape (n, K, T, 4).
    """
    for n in range(low, high):
        for k in range(rotations.shape[2]):
            before = last[n, k]
            for t in range(rotations.shape[0]):
                q = rotations[t, n, k]
                w, x, y, z = float(q[0]), float(q[1]), float(q[2]), float(q[3])
                length = math.sqrt(w * w + x * x + y * y + z * z)
                if length > 0.0:
                    side = w * before[0] + x * before[1] + y * before[2] + z * before[3]
                    factor = (-1.0 if side < 0.0 else 1.0) / length
                    before[0], before[1], before[2], before[3] = factor * w, factor * x, factor * y, factor * z
                target = out[n, k, t]
                if scale == 1.0:
                    target[0], target[1], target[2], target[3] = before[1], before[2], before[3], before[0]
                else:
                    target[0] = np.int32(math.floor(scale * before[1] + 0.5))
                    target[1] = np.int32(math.floor(scale * before[2] + 0.5))
                    target[2] = np.int32(math.floor(scale * before[3] + 0.5))
                    target[3] = np.int32(math.floor(scale * before[0] + 0.5))

"""Compiled lengthening of legs and arms of posed bodies."""

import math

from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import ARM, LEG


@kernel
def stretch_limbs(first, stop, parents, segments, stretches, positions):
    """Move joints to where longer or shorter legs and arms have them, in place.

    Args:
        first: First of the T x n bodies at times, time by time.
        stop: One past the last.
        parents: Parent of each joint, -1 for the root. Shape (J,).
        segments: What each joint carries. Shape (J,).
        stretches: How long the bones of each body's trunk, legs and arms are for its size. Shape (n, 3).
        positions: Changed: positions of joints in the world [m]. Shape (T, n, J, 3).
    """
    count, joints = stretches.shape[0], parents.shape[0]
    for index in range(first, stop):
        n, places = index % count, positions[index // count, index % count]
        if (stretches[n, LEG] == 1.0 and stretches[n, ARM] == 1.0) or not math.isfinite(places[0, 0]):
            continue
        # Children before parents: each joint is moved along the bones between it and the root while these are as
        # they were.
        for j in range(joints - 1, 0, -1):
            x, y, z = 0.0, 0.0, 0.0
            at = j
            while parents[at] >= 0:
                p = parents[at]
                more = stretches[n, segments[p]] - 1.0
                if more != 0.0:
                    x += more * (places[at, 0] - places[p, 0])
                    y += more * (places[at, 1] - places[p, 1])
                    z += more * (places[at, 2] - places[p, 2])
                at = p
            places[j, 0] += x
            places[j, 1] += y
            places[j, 2] += z

"""Compiled breathing: trunks that rise and sink, about the axis from hip to hip."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.quaternions import multiply, rotate, rotate_by_vector, unrotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.splines import spline_of


class Chest(NamedTuple):
    """What a body breathes with.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        chain: Joints from the root to the head, parents first. Shape (n,).
        shares: Share of a breath by which each of them turns; that of neck and head is negative. Shape (n,).
        across: From the right hip to the left one, seen from the root, of length 1. Shape (3,).
    """

    parents: NDArray[np.int64]
    chain: NDArray[np.int64]
    shares: NDArray[np.float64]
    across: NDArray[np.float64]


@kernel
def breathe(first, stop, moments, breaths, chest, poses):
    """Turn trunks as bodies breathe, in place; heads keep their rotation.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        breaths: How far trunks are bent forward [rad], an ``Offsets``.
        chest: A ``Chest``.
        poses: Rotations are changed, a ``Posed``.
    """
    rotations, times = np.empty((chest.parents.shape[0], 4)), moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            if not math.isfinite(poses.roots[t, i, 0]):
                continue
            angle = spline_of(breaths, times[t, 0 if shared else i], moments.columns[i])
            if angle == 0.0:
                continue
            pose, ax, ay, az = poses.rotations[t, i], 0.0, 0.0, 0.0
            for at in range(chest.chain.shape[0]):
                j, p, share = chest.chain[at], chest.parents[chest.chain[at]], chest.shares[at]
                q = rotations[j]
                if p < 0:
                    q[0], q[1], q[2], q[3] = pose[j, 0], pose[j, 1], pose[j, 2], pose[j, 3]
                    ax, ay, az = rotate(q, chest.across[0], chest.across[1], chest.across[2])
                    continue
                q[0], q[1], q[2], q[3] = multiply(rotations[p], pose[j])
                if share != 0.0:
                    # Turns about one axis commute, so the rotations from before them serve.
                    turn = share * angle
                    x, y, z = unrotate(rotations[p], turn * ax, turn * ay, turn * az)
                    rotate_by_vector(pose[j], x, y, z)

"""Compiled turning of joints between root and head about one axis: heads that follow opponents, trunks that breathe."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.quaternions import multiply, rotate, rotate_by_vector, unrotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.splines import spline_of


class Turning(NamedTuple):
    """Which joints of a body turn, and about what.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        chain: Joints from the root to the head, parents first. Shape (n,).
        shares: Share of a turn that each of them does; negative against it. Shape (n,).
        axis: The axis, of length 1. Shape (3,).
        of_root: Whether the axis turns with the root; else it is that of the world.
    """

    parents: NDArray[np.int64]
    chain: NDArray[np.int64]
    shares: NDArray[np.float64]
    axis: NDArray[np.float64]
    of_root: bool


@kernel(allocates=True)
def turn_joints(first, stop, moments, angles, turning, poses):
    """Turn joints between root and head, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        angles: How far they turn [rad], an ``Offsets``.
        turning: A ``Turning``.
        poses: Rotations are changed, a ``Posed``.
    """
    rotations, times = np.empty((turning.parents.shape[0], 4)), moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            if not math.isfinite(poses.roots[t, i, 0]):
                continue
            angle = spline_of(angles, times[t, 0 if shared else i], moments.columns[i])
            if angle == 0.0:
                continue
            pose, ax, ay, az = poses.rotations[t, i], turning.axis[0], turning.axis[1], turning.axis[2]
            for at in range(turning.chain.shape[0]):
                j, p, share = turning.chain[at], turning.parents[turning.chain[at]], turning.shares[at]
                q = rotations[j]
                if p < 0:
                    q[0], q[1], q[2], q[3] = pose[j, 0], pose[j, 1], pose[j, 2], pose[j, 3]
                    if turning.of_root:
                        ax, ay, az = rotate(q, ax, ay, az)
                    continue
                q[0], q[1], q[2], q[3] = multiply(rotations[p], pose[j])
                if share != 0.0:
                    # Turns about one axis commute, so the rotations from before them serve.
                    turn = share * angle
                    x, y, z = unrotate(rotations[p], turn * ax, turn * ay, turn * az)
                    rotate_by_vector(pose[j], x, y, z)

"""Compiled gaze: necks and heads that turn towards opponents, about the vertical."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.quaternions import multiply, rotate_by_vector, unrotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.splines import spline_of


class Gaze(NamedTuple):
    """What a body looks with.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        chain: Joints from the root to the head, parents first. Shape (n,).
        shares: Share of a turn that each of them does. Shape (n,).
    """

    parents: NDArray[np.int64]
    chain: NDArray[np.int64]
    shares: NDArray[np.float64]


@kernel
def turn_heads(first, stop, moments, turns, gaze, poses):
    """Turn necks and heads towards opponents, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        turns: How far heads turn [rad], an ``Offsets``.
        gaze: A ``Gaze``.
        poses: Rotations are changed, a ``Posed``.
    """
    rotations, times = np.empty((gaze.parents.shape[0], 4)), moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            if not math.isfinite(poses.roots[t, i, 0]):
                continue
            angle = spline_of(turns, times[t, 0 if shared else i], moments.columns[i])
            if angle == 0.0:
                continue
            pose = poses.rotations[t, i]
            for at in range(gaze.chain.shape[0]):
                j, p, share = gaze.chain[at], gaze.parents[gaze.chain[at]], gaze.shares[at]
                q = rotations[j]
                if p < 0:
                    q[0], q[1], q[2], q[3] = pose[j, 0], pose[j, 1], pose[j, 2], pose[j, 3]
                    continue
                q[0], q[1], q[2], q[3] = multiply(rotations[p], pose[j])
                if share > 0.0:
                    # Turns about the vertical commute, so the rotations from before them serve.
                    x, y, z = unrotate(rotations[p], 0.0, share * angle, 0.0)
                    rotate_by_vector(pose[j], x, y, z)

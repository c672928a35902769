"""Compiled gaze: necks and heads that turn towards opponents, about the vertical."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import multiply, rotate, rotate_by_vector, unrotate
from crowdsim.jit import kernel
from crowdsim.take.kernels.splines import spline_at

MOST = math.radians(75.0)
"""Angle between chest and head about the vertical up to which heads are turned [rad]."""
_SOFT = math.radians(30.0)
"""Range over which heads ease into it [rad]."""
_FREE = math.radians(15.0)
"""Angle off the opponent that heads keep from the motion [rad]."""
_BEHIND = math.radians(120.0)
"""Range, up to straight behind, over which heads stop following: there they would have to choose a side [rad]."""


class Gaze(NamedTuple):
    """What a body looks with.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        chain: Joints from the root to the head, parents first. Shape (n,).
        shares: Share of a turn that each of them does. Shape (n,).
        chest: The joint that the head is turned against.
        head: The head's joint.
        ahead: Direction of the face in the head's frame. Shape (3,).
        chest_ahead: Direction of the chest in its frame. Shape (3,).
    """

    parents: NDArray[np.int64]
    chain: NDArray[np.int64]
    shares: NDArray[np.float64]
    chest: int
    head: int
    ahead: NDArray[np.float64]
    chest_ahead: NDArray[np.float64]


@kernel(allocates=False)
def _heading(rotation, ahead):
    """Return the heading of a direction, given in a joint's frame."""
    x, _, z = rotate(rotation, ahead[0], ahead[1], ahead[2])
    return math.atan2(x, z)


@kernel(inline=True)
def _wrapped(angle):
    """Return an angle in -pi..pi."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel(allocates=False)
def _kept(angle):
    """Return the part of an angle that lies within ``MOST``, smoothly."""
    size = abs(angle)
    if size <= MOST - _SOFT:
        return angle
    return math.copysign(MOST - _SOFT + _SOFT * math.tanh((size - MOST + _SOFT) / _SOFT), angle)


@kernel(allocates=False)
def _head_angle(gaze, rotations, direction):
    """Return by how much a head turns about the vertical [rad]."""
    x, z = direction
    size = math.sqrt(x * x + z * z)
    if size < 1e-6:
        return 0.0
    face = _heading(rotations[gaze.head], gaze.ahead)
    error = _wrapped(math.atan2(x, z) - face)
    error -= _FREE * math.tanh(error / _FREE)
    error *= minimum_jerk(min((math.pi - abs(error)) / _BEHIND, 1.0)) * min(size, 1.0)
    turned = _wrapped(face - _heading(rotations[gaze.chest], gaze.chest_ahead))
    # A head that the motion itself turns further stays as it is.
    return _kept(turned + error) - _kept(turned)


@kernel
def turn_heads(first, stop, moments, rows, gaze, poses):
    """Turn necks and heads towards opponents, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        rows: The control frames, a ``Rows``.
        gaze: A ``Gaze``.
        poses: Rotations are changed, a ``Posed``.
    """
    rotations, times = np.empty((gaze.parents.shape[0], 4)), moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            if not math.isfinite(poses.roots[t, i, 0]):
                continue
            direction = spline_at(rows.gazes, rows, times[t, 0 if shared else i], moments.columns[i])
            pose = poses.rotations[t, i]
            for at in range(gaze.chain.shape[0]):
                j, p = gaze.chain[at], gaze.parents[gaze.chain[at]]
                q = rotations[j]
                if p < 0:
                    q[0], q[1], q[2], q[3] = pose[j, 0], pose[j, 1], pose[j, 2], pose[j, 3]
                else:
                    q[0], q[1], q[2], q[3] = multiply(rotations[p], pose[j])
            angle = _head_angle(gaze, rotations, direction)
            if angle == 0.0:
                continue
            for at in range(gaze.chain.shape[0]):
                share, p = gaze.shares[at], gaze.parents[gaze.chain[at]]
                if share > 0.0 and p >= 0:
                    # Turns about the vertical commute, so the rotations from before them serve.
                    x, y, z = unrotate(rotations[p], 0.0, share * angle, 0.0)
                    rotate_by_vector(pose[gaze.chain[at]], x, y, z)

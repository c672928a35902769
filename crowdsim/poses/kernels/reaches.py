"""Compiled strikes of elbows, knees, heads and props: joints above what strikes turn until it touches."""

import math
from typing import Any, NamedTuple

from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import rotate_by_vector
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import AFTER, BEFORE


class Reaches(NamedTuple):
    """Strikes that landed, by attacker's column and time; E strikes of n avatars, C joints each.

    Attributes:
        starts: Strikes of column i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        times: When [s]. Shape (E,).
        spans: How long before and after it joints turn for it [s]. Shape (E, 2).
        joints: Joints that turn, -1 for none. Shape (E, C).
        rotations: Their rotation vectors at the strike, in the frames of their parents [rad]. Shape (E, C, 3).
    """

    starts: NDArray[Any]
    times: NDArray[Any]
    spans: NDArray[Any]
    joints: NDArray[Any]
    rotations: NDArray[Any]


@kernel
def reach_out(first, stop, moments, reaches, within, poses):
    """Turn joints so that what strikes touches, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        reaches: A ``Reaches``.
        within: Time beyond which strikes are left out [s].
        poses: Changed, a ``Posed``.
    """
    times = moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = moments.columns[i]
        for t in range(times.shape[0]):
            if not math.isfinite(poses.roots[t, i, 0]):
                continue
            time, pose = times[t, 0 if shared else i], poses.rotations[t, i]
            for strike in range(reaches.starts[n], reaches.starts[n + 1]):
                apart = time - reaches.times[strike]
                span = reaches.spans[strike, BEFORE if apart < 0.0 else AFTER]
                if abs(apart) > within or abs(apart) >= span:
                    continue
                weight = minimum_jerk(1.0 - abs(apart) / span)
                for k in range(reaches.joints.shape[1]):
                    joint = reaches.joints[strike, k]
                    if joint >= 0:
                        v = reaches.rotations[strike, k]
                        rotate_by_vector(pose[joint], weight * v[0], weight * v[1], weight * v[2])

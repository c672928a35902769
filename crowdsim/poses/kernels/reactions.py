"""Compiled hit reactions: a blow turns spine, neck and head along its way, and they spring back."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import multiply, rotate_by_vector, unrotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import HEAD, TORSO

LENGTH = 0.65
"""How long a reaction lasts [s]."""
RISE = 0.22
"""Time from a blow to its highest [s]; as smooth as it is, heads turn no more suddenly than in captured motion."""
LEAST, MOST = 0.1, 0.25
"""How far a blow should bring the head from where it was, and how far it throws it back beyond its motion at the most
[m]."""
ROUNDS = 2
"""Rounds in which blows are strengthened."""


class Blows(NamedTuple):
    """Strikes that landed on avatars of a window, by victim's column and time; E strikes of n avatars.

    Attributes:
        starts: Those on column i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        times: When [s]. Shape (E,).
        axes: Horizontal axis about which they throw back; its length is their strength. Shape (E, 3).
        parts: ``HEAD`` or ``TORSO``, which was hit. Shape (E,).
    """

    starts: NDArray[np.int64]
    times: NDArray[np.float64]
    axes: NDArray[np.float64]
    parts: NDArray[np.int64]


class Trunk(NamedTuple):
    """Joints from the root to the head of a body.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        chain: The joints, parents first. Shape (n,).
        gives: How far each gives way in a blow to head and torso [rad]. Shape (n, 2).
        gains: How far that brings the head, about, in a body of scale 1 [m]. Shape (2,).
    """

    parents: NDArray[np.int64]
    chain: NDArray[np.int64]
    gives: NDArray[np.float64]
    gains: NDArray[np.float64]


@kernel(allocates=False)
def _response(since):
    """Return the response to a blow: 1 after ``RISE``, at rest after ``LENGTH``."""
    return minimum_jerk(since / RISE) - minimum_jerk((since - RISE) / (LENGTH - RISE))


@kernel
def strengthen(blows, gains, own):
    """Return how far each blow turns its victim: further where it would bring the head less than ``LEAST``.

    A victim may be on its way towards the attacker, or springing back from blows before. Those count as strong as they
    are themselves, or, in the first of ``ROUNDS``, as if nothing had been before them: so that a blow depends on no
    others than those of ``ROUNDS`` times ``LENGTH`` before it.

    Args:
        blows: The ``Blows``.
        gains: How far each brings the head at a strength of 1 [m]. Shape (E,).
        own: How far its motion brings the head along the blow in ``RISE`` seconds [m]. Shape (E,).

    Returns:
        Their axes. Shape (E, 3).
    """
    axes, stronger = blows.axes.copy(), blows.axes.copy()
    for _ in range(ROUNDS):
        for n in range(len(blows.starts) - 1):
            for blow in range(blows.starts[n], blows.starts[n + 1]):
                x, z = blows.axes[blow, 0], blows.axes[blow, 2]
                strength = math.sqrt(x * x + z * z)
                if strength == 0.0 or gains[blow] == 0.0:
                    continue
                expected = own[blow]
                for before in range(blows.starts[n], blow):
                    since = blows.times[blow] - blows.times[before]
                    if since < LENGTH:
                        more = (_response(since + RISE) - _response(since)) * gains[before] / strength
                        expected += more * (x * axes[before, 0] + z * axes[before, 2])
                far = strength * gains[blow]
                wanted = min(max(far, LEAST - expected), max(MOST, far))
                for k in range(3):
                    stronger[blow, k] = blows.axes[blow, k] * wanted / far
        axes[:] = stronger
    return axes


@kernel(allocates=False)
def _sum_blows(blows, n, time, recent, spin):
    """Write the rotation vectors of head and torso by all blows at a time; return whether there are any."""
    active = False
    spin[:] = 0.0
    for blow in range(blows.starts[n], blows.starts[n + 1]):
        since = time - blows.times[blow]
        if 0.0 < since < min(LENGTH, recent):
            active = True
            response = _response(since)
            for k in range(3):
                spin[blows.parts[blow], k] += response * blows.axes[blow, k]
    return active


@kernel(allocates=False)
def _turn_trunk(trunk, pose, spin, rotations):
    """Turn the joints of a trunk in the world, each by its share of what head and torso turn."""
    for at in range(trunk.chain.shape[0]):
        j = trunk.chain[at]
        head, torso, p = trunk.gives[at, HEAD], trunk.gives[at, TORSO], trunk.parents[j]
        if p >= 0 and head + torso > 0.0:
            x, y, z = unrotate(
                rotations[p],
                head * spin[HEAD, 0] + torso * spin[TORSO, 0],
                head * spin[HEAD, 1] + torso * spin[TORSO, 1],
                head * spin[HEAD, 2] + torso * spin[TORSO, 2],
            )
            rotate_by_vector(pose[j], x, y, z)
        q = rotations[j]
        if p < 0:
            for k in range(4):
                q[k] = pose[j, k]
        else:
            q[0], q[1], q[2], q[3] = multiply(rotations[p], pose[j])


@kernel
def show_reactions(first, stop, moments, blows, trunk, recent, poses):
    """Add reactions to poses, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        blows: A ``Blows``.
        trunk: A ``Trunk``.
        recent: Time after which a blow is left out [s].
        poses: Rotations are changed, a ``Posed``.
    """
    rotations, spin, times = np.empty((trunk.parents.shape[0], 4)), np.empty((2, 3)), moments.times
    shared = times.shape[1] == 1
    for i in range(first, stop):
        for t in range(times.shape[0]):
            time = times[t, 0 if shared else i]
            if math.isfinite(poses.roots[t, i, 0]) and _sum_blows(blows, moments.columns[i], time, recent, spin):
                _turn_trunk(trunk, poses.rotations[t, i], spin, rotations)

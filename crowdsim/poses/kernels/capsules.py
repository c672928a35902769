"""Compiled depth of capsules in one another."""

from typing import NamedTuple

from crowdsim.core.quaternions import rotate
from crowdsim.core.segments import nearest_on_segments
from crowdsim.core.types import Array
from crowdsim.jit import kernel

NEAR = 1.9
"""Distance on the ground of the middles of bodies beyond which they do not touch [m]."""
APART = -1.0
"""Depth of capsules that are nowhere near one another [m]."""


class Capsules(NamedTuple):
    """Bodies of N avatars at T times, K capsules each; the first of each body lies in its middle.

    Attributes:
        starts: One end of each axis, NaN while absent [m]. Shape (T, N, K, 3), float32.
        ends: The other end [m]. Shape (T, N, K, 3), float32.
        radii: Radius at both ends [m]. Shape (N, K, 2).
        bounds: Radius of a sphere around each [m]. Shape (N, K).
        counts: How many capsules each body has. Shape (N,).
    """

    starts: Array
    ends: Array
    radii: Array
    bounds: Array
    counts: Array


@kernel(allocates=False)
def are_near(capsules, t, a, i, b, j, margin):
    """Return whether spheres around a capsule of one body and one of another are no further apart than a margin [m]."""
    p, q = capsules.starts[t, a, i], capsules.ends[t, a, i]
    r, s = capsules.starts[t, b, j], capsules.ends[t, b, j]
    x, y, z = p[0] + q[0] - r[0] - s[0], p[1] + q[1] - r[1] - s[1], p[2] + q[2] - r[2] - s[2]
    return x * x + y * y + z * z <= 4.0 * (capsules.bounds[a, i] + capsules.bounds[b, j] + margin) ** 2


@kernel(allocates=False)
def capsule_depth(p, q, own, r, s, other):
    """Return how deep two capsules are in one another [m], negative where they are apart, and where they are nearest.

    Args:
        p: One end of the first one's axis.
        q: The other end.
        own: Its radii at both ends [m].
        r: One end of the second one's axis.
        s: The other end.
        other: Its radii at both ends [m].

    Returns:
        The depth, and the shares of the ways along the axes.
    """
    share, part, far = nearest_on_segments(p, q, r, s)
    return own[0] + share * (own[1] - own[0]) + other[0] + part * (other[1] - other[0]) - far, share, part


@kernel(allocates=False)
def place_ends(first, stop, positions, rotations, sizes, joints, segments, offsets, columns, ends):
    """Write where ends of capsules of bodies of one kind lie.

    Args:
        first: First of the T x n bodies at times, time by time.
        stop: One past the last.
        positions: Of joints in the world [m]. Shape (T, n, J, 3).
        rotations: Likewise. Shape (T, n, J, 4).
        sizes: Size of the bones of each body's trunk, legs and arms. Shape (n, 3).
        joints: Joint that each capsule hangs on. Shape (K,).
        segments: Which of the bones it lies on. Shape (K,).
        offsets: Both ends of each in the joint's frame [m]. Shape (2, K, 3).
        columns: Column of each body. Shape (n,).
        ends: Written [m]. Shape (2, T, N, K or more, 3).
    """
    count = columns.shape[0]
    for index in range(first, stop):
        t, n = index // count, index % count
        column = columns[n]
        for k in range(joints.shape[0]):
            p, q, size = positions[t, n, joints[k]], rotations[t, n, joints[k]], sizes[n, segments[k]]
            for end in range(2):
                o = offsets[end, k]
                x, y, z = rotate(q, o[0] * size, o[1] * size, o[2] * size)
                out = ends[end, t, column, k]
                out[0], out[1], out[2] = p[0] + x, p[1] + y, p[2] + z

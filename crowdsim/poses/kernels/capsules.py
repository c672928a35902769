"""Compiled depth of capsules in one another."""

from typing import NamedTuple

import numpy as np

from crowdsim.core.quaternions import rotate
from crowdsim.core.segments import nearest_on_segments
from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.motion.kinematics_kernels import pose_joints
from crowdsim.poses.kernels.stretching import stretch_limbs

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


class CapsuleBody(NamedTuple):
    """A body of J joints and K capsules.

    Attributes:
        parents: Parent of each joint, -1 for the root. Shape (J,), int64.
        offsets: Position of each joint in its parent's frame [m]. Shape (J, 3), float32.
        bones: What each joint carries, see ``builds.joint_segments``. Shape (J,).
        joints: Joint that each capsule hangs on. Shape (K,).
        segments: Which of the bones it lies on. Shape (K,).
        ends: Both ends of each in the joint's frame [m]. Shape (2, K, 3).
        limbs: Upper, middle and end joint of each limb. Shape (4, 3).
    """

    parents: Array
    offsets: Array
    bones: Array
    joints: Array
    segments: Array
    ends: Array
    limbs: Array


@kernel
def are_near(capsules, t, a, i, b, j, margin):
    """Return whether spheres around a capsule of one body and one of another are no further apart than a margin [m]."""
    p, q = capsules.starts[t, a, i], capsules.ends[t, a, i]
    r, s = capsules.starts[t, b, j], capsules.ends[t, b, j]
    x, y, z = p[0] + q[0] - r[0] - s[0], p[1] + q[1] - r[1] - s[1], p[2] + q[2] - r[2] - s[2]
    return x * x + y * y + z * z <= 4.0 * (capsules.bounds[a, i] + capsules.bounds[b, j] + margin) ** 2


@kernel
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


@kernel
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
                o, out = offsets[end, k], ends[end, t, column, k]
                if o[0] == 0.0 and o[1] == 0.0 and o[2] == 0.0:
                    out[0], out[1], out[2] = p[0], p[1], p[2]
                    continue
                x, y, z = rotate(q, o[0] * size, o[1] * size, o[2] * size)
                out[0], out[1], out[2] = p[0] + x, p[1] + y, p[2] + z


@kernel(allocates=True)
def place_bodies(first, stop, rows, poses, body, scales, stretches, columns, ends, joints):
    """Write where ends of capsules and joints of limbs of posed bodies of one kind lie.

    It is what ``place_ends`` writes of all joints in the world, without these of all bodies at once.

    Args:
        first: First of the T x n bodies at times, time by time.
        stop: One past the last.
        rows: Rows of the poses. Shape (T,).
        poses: A ``Posed`` of n bodies at T times or more.
        body: What they are, a ``CapsuleBody``.
        scales: Size of each body. Shape (n,).
        stretches: How long the bones of its trunk, legs and arms are for its size. Shape (n, 3).
        columns: Column of each body. Shape (n,).
        ends: Written [m]. Shape (2, T, N, K or more, 3), float32.
        joints: Written: joints of limbs [m]. Shape (T, N, 4, 3, 3), float32.
    """
    count, most = columns.shape[0], body.parents.shape[0]
    origins, fixed, sizes = np.zeros((count, 3), np.float32), np.empty((0, 0, 3), np.float32), np.empty((count, 3))
    positions, rotations = np.empty((1, count, most, 3), np.float32), np.empty((1, count, most, 4), np.float32)
    for n in range(count):
        for k in range(3):
            sizes[n, k] = scales[n] * stretches[n, k]
    index = first
    while index < stop:
        t, low = index // count, index % count
        high = min(count, low + stop - index)
        index += high - low
        some = poses.rotations[rows[t], low:high]
        pose_joints(0, high - low, body.parents, body.offsets, origins, some, fixed, positions[0], rotations[0])
        for n in range(low, high):
            scale = np.float32(scales[n])
            for j in range(most):
                for k in range(3):
                    positions[0, n - low, j, k] *= scale
        stretch_limbs(0, high - low, body.parents, body.bones, stretches[low:high], positions)
        for n in range(low, high):
            root, places, out = poses.roots[rows[t], n], positions[0, n - low], joints[t, columns[n]]
            for j in range(most):
                for k in range(3):
                    places[j, k] += root[k]
            for limb in range(body.limbs.shape[0]):
                for joint in range(body.limbs.shape[1]):
                    for k in range(3):
                        out[limb, joint, k] = places[body.limbs[limb, joint], k]
        place_ends(
            0, high - low, positions, rotations, sizes[low:high], body.joints, body.segments, body.ends,
            columns[low:high], ends[:, t : t + 1],
        )  # fmt: skip

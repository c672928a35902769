"""Compiled points of posed bodies in the world, without the joints of all of them at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.jit import kernel
from crowdsim.motion.kinematics_kernels import pose_joints
from crowdsim.poses.kernels.stretching import stretch_limbs


class BodyPoints(NamedTuple):
    """Points of a body of J joints; K of them.

    Attributes:
        parents: Parent of each joint, -1 for the root. Shape (J,).
        offsets: Position of each joint in its parent's frame [m]. Shape (J, 3).
        segments: What each joint carries, see ``builds.joint_segments``. Shape (J,).
        joints: Joint that each point hangs on. Shape (K,).
        ends: Where it is in the joint's frame [m]. Shape (K, 3).
    """

    parents: NDArray[np.int64]
    offsets: NDArray[np.float32]
    segments: NDArray[np.int64]
    joints: NDArray[np.int64]
    ends: NDArray[np.float64]


@kernel(allocates=True)
def place_points(first, stop, body, poses, scales, stretches, columns, points):
    """Write where points of bodies of one kind lie.

    Args:
        first: First of the n bodies.
        stop: One past the last.
        body: Their ``BodyPoints``.
        poses: A ``Posed`` of T times.
        scales: Size of each body. Shape (n,).
        stretches: How long the bones of its trunk, legs and arms are for its size. Shape (n, 3).
        columns: Column of each body among the points. Shape (n,).
        points: Written; NaN while absent [m]. Shape (T, N, K, 3), float32.
    """
    count, joints = stop - first, body.parents.shape[0]
    origins, fixed = np.zeros((count, 3), np.float32), np.empty((0, 0, 3), np.float32)
    positions, rotations = np.empty((1, count, joints, 3), np.float32), np.empty((count, joints, 4), np.float32)
    for t in range(poses.roots.shape[0]):
        some = poses.rotations[t, first:stop]
        pose_joints(0, count, body.parents, body.offsets, origins, some, fixed, positions[0], rotations)
        for n in range(count):
            scale = np.float32(scales[first + n])
            for j in range(joints):
                for c in range(3):
                    positions[0, n, j, c] *= scale
        stretch_limbs(0, count, body.parents, body.segments, stretches[first:stop], positions)
        for n in range(count):
            root, size, out = poses.roots[t, first + n], scales[first + n], points[t, columns[first + n]]
            for k in range(body.joints.shape[0]):
                place, q, o = positions[0, n, body.joints[k]], rotations[n, body.joints[k]], body.ends[k]
                for c in range(3):
                    out[k, c] = place[c] + root[c]
                if o[0] == 0.0 and o[1] == 0.0 and o[2] == 0.0:
                    continue
                w, x, y, z = np.float64(q[0]), np.float64(q[1]), np.float64(q[2]), np.float64(q[3])
                tx, ty, tz = 2.0 * (y * o[2] - z * o[1]), 2.0 * (z * o[0] - x * o[2]), 2.0 * (x * o[1] - y * o[0])
                out[k, 0] += size * (o[0] + w * tx + (y * tz - z * ty))
                out[k, 1] += size * (o[1] + w * ty + (z * tx - x * tz))
                out[k, 2] += size * (o[2] + w * tz + (x * ty - y * tx))

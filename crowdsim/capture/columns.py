"""Columns of a file's motion by what they are: positions and rotations of each joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.bvh.file import AXIS, Bvh
from crowdsim.core.types import Array


def rotation_columns(bvh: Bvh) -> Array:
    """Return the columns of all rotation channels."""
    return _columns(bvh, "rotation")[1]


def position_columns(bvh: Bvh, joint: int) -> Array:
    """Return the columns of a joint's x, y and z positions, -1 where it has no such channel. Shape (3,)."""
    joints, columns, axes = _columns(bvh, "position")
    own = joints == joint
    result = np.full(3, -1)
    result[axes[own]] = columns[own]
    return result


def path_of(bvh: Bvh, joint: int) -> Array:
    """Return the positions of a joint against its parent, in file units. Shape (F, 3)."""
    columns = position_columns(bvh, joint)
    path = np.repeat(bvh.offsets[[joint]], bvh.frame_count, axis=0)
    path[:, columns >= 0] = bvh.motion[:, columns[columns >= 0]]
    return path


def with_path(bvh: Bvh, joint: int, path: Array) -> Bvh:
    """Return the file with other positions of a joint; axes without a channel stay as they are."""
    columns = position_columns(bvh, joint)
    motion = bvh.motion.copy()
    motion[:, columns[columns >= 0]] = path[:, columns >= 0]
    return replace(bvh, motion=motion)


def _columns(bvh: Bvh, kind: str) -> tuple[Array, Array, Array]:
    """Joint, column and axis of every channel of a kind."""
    starts = bvh.first_channels()
    found = [
        (joint, int(starts[joint]) + place, AXIS[name[0]])
        for joint, names in enumerate(bvh.channels)
        for place, name in enumerate(names)
        if name.endswith(kind)
    ]
    joints, columns, axes = np.array(found, np.int64).reshape(-1, 3).T
    return joints, columns, axes

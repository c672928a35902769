"""Features of frames, by which two frames are compared; independent of the position and heading of the body.

The cost of following frame i as if it were frame k is::

    cost(i, k) = sqrt( sum_r w_r (|p_r(i) - p_r(k)|^2 + (tau |v_r(i) - v_r(k)|)^2) / sum_r w_r )   [m]

p_r is the place of joint r in the frame's ground frame, v_r its velocity over the floor turned into that frame, both
on a body of 1.75 m; w_r are the weights of roles and tau is the weight of velocities [s]. Heights are part of p_r; x, z
and heading of the body are not, and its velocity over the floor is part of every v_r. (The paper's section 3, after Lee
et al. 2002.)
"""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.errors import MotionError
from crowdsim.graph.settings import GraphSettings
from crowdsim.motion import ground as grounds
from crowdsim.motion.body import HEIGHT, ROLES
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.kinematics import forward_kinematics

_CHUNK = 4096
"""Control frames whose joints are in memory at a time."""


def frame_features(database: MotionDatabase, settings: GraphSettings, progress: Progress | None = None) -> Array:
    """Return one row for each control frame such that the distance of two rows is the cost between the frames [m].

    Shape (F, 6 R) for R roles that count: for each its place, then for each its velocity.

    Raises:
        MotionError: No joint counts, or a frame holds a number that is not finite.
    """
    joints, weights = _weighted_joints(database, settings)
    frames, stride = database.frame_count, database.stride
    scale = HEIGHT / database.body.height * np.sqrt(weights / weights.sum())
    before, after = _neighbours(database)
    features = np.empty((frames, 2, len(joints), 3), np.float32)
    for start in range(0, frames, _CHUNK):
        rows = slice(start, min(frames, start + _CHUNK))
        middle = np.arange(rows.start, rows.stop) * stride
        earlier, positions, later = (
            _world_positions(database, playback, joints) for playback in (before[rows], middle, after[rows])
        )
        here = database.ground[middle][:, None, :]
        seconds = (after[rows] - before[rows]) / database.playback_rate
        velocities = (later - earlier) / np.maximum(seconds, 1.0 / database.playback_rate)[:, None, None]
        turn = here * [0.0, 0.0, 1.0]
        features[rows, 0] = grounds.to_local(here, positions) * scale[:, None]
        features[rows, 1] = grounds.to_local(turn, velocities) * (scale * settings.velocity_weight)[:, None]
        if progress is not None:
            progress("features", rows.stop, frames)
    flat = features.reshape(frames, -1)
    wrong = np.flatnonzero(~np.isfinite(flat).all(axis=1))
    if len(wrong):
        clip = int(np.searchsorted(database.clip_starts, wrong[0], side="right")) - 1
        raise MotionError(
            f"clip {database.clip_names[clip]!r}, control frame {wrong[0] - database.clip_starts[clip]}: "
            f"a joint's place or velocity is not finite (in {len(wrong)} frames in all)"
        )
    return flat


def _weighted_joints(database: MotionDatabase, settings: GraphSettings) -> tuple[Array, Array]:
    """Return the joints that count and their weights, in the order of ``ROLES``."""
    roles = [role for role in ROLES if role in database.body.roles and settings.joint_weights.of_role(role) > 0]
    if not roles:
        raise MotionError(
            f"no joint that counts in joint_weights has a role on this skeleton; "
            f"it has {', '.join(sorted(database.body.roles))}"
        )
    joints = np.array([database.body.roles[role] for role in roles])
    return joints, np.array([settings.joint_weights.of_role(role) for role in roles])


def _neighbours(database: MotionDatabase) -> tuple[Array, Array]:
    """Return the playback frames beside each control frame, inside its clip: central differences but at the ends."""
    middle = np.arange(database.frame_count) * database.stride
    clip = np.searchsorted(database.clip_starts, np.arange(database.frame_count), side="right") - 1
    first = database.clip_starts[clip].astype(np.int64) * database.stride
    last = database.clip_starts[clip + 1].astype(np.int64) * database.stride - 1
    return np.maximum(middle - 1, first), np.minimum(middle + 1, last)


def _world_positions(database: MotionDatabase, playback: Array, joints: Array) -> Array:
    """Return places of some joints in the clips' worlds at playback frames, in double precision [m]."""
    roots = database.root_positions[playback].astype(np.float64)
    rotations = database.rotations[playback].astype(np.float64)
    return forward_kinematics(database.skeleton, roots, rotations)[0][:, joints]

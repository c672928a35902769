"""What a model knows of stillness: how much of each action a body hardly moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.kinematics import forward_kinematics

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

STILL = 0.18
"""Mean speed of joints below which a body is still, over its height [1/s]."""


def calm_rows(policy: Policy) -> Array:
    """Return the share of the frames of each action in which the body is still. Shape (A,), float32."""
    database, graph = policy.database, policy.graph
    frames = np.arange(database.frame_count) * database.stride
    after = np.minimum(frames + 1, len(database.ground) - 1)
    joints = sorted(set(database.body.roles.values()))
    skeleton, roots, rotations = database.skeleton, database.root_positions, database.rotations
    now, then = (forward_kinematics(skeleton, roots[at], rotations[at], threads=1)[0] for at in (frames, after))
    speeds = np.linalg.norm((then - now)[:, joints], axis=-1).mean(axis=-1) * database.playback_rate
    still = np.concatenate([[0], np.cumsum(speeds < STILL * database.body.height)])
    first, lengths = np.asarray(graph.action_first, np.int64), np.asarray(graph.action_lengths, np.int64)
    return np.asarray((still[first + lengths] - still[first]) / lengths, np.float32)

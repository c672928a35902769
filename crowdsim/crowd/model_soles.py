"""What a model knows of soles and of bodies that lie, so that nobody treads on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.model_arms import part_of
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_FRAMES_AT_ONCE = 1 << 16


def sole_rows(policies: Sequence[Policy]) -> Array:
    """Return left heel and ball, right heel and ball in each frame's ground frame [m].

    Shape (L, 12), float32; (0, 12) where no policy has falls.
    """
    if all(policy.falls is None for policy in policies):
        return np.zeros((0, 12), np.float32)
    return np.concatenate([_soles_of(policy) for policy in policies])


def _soles_of(policy: Policy) -> Array:
    database, body = policy.database, policy.database.body
    rows = np.empty((len(database.ground), 12), np.float32)
    feet = [body.roles[f"{side}_foot"] for side in ("left", "right")]
    skeleton, joints = part_of(database.skeleton, feet)
    own = [joints.index(foot) for foot in feet]
    for low in range(0, len(rows), _FRAMES_AT_ONCE):
        some = slice(low, low + _FRAMES_AT_ONCE)
        positions, rotations = forward_kinematics(
            skeleton, database.root_positions[some], database.rotations[some][:, joints]
        )
        soles = positions[:, own, None] + quaternion.rotate(rotations[:, own, None].astype(float), body.sole_offsets)
        rows[some] = ground.to_local(database.ground[some, None, None], soles).reshape(-1, 12)
    return rows


def lying_capsules(policy: Policy, actions: Array) -> Array:
    """Return the capsules of a body after falls (F,), seen from their last frames: two ends and a radius [m].

    Shape (F, K, 7), float64.
    """
    database, graph, body = policy.database, policy.graph, policy.database.body
    last = np.asarray(graph.action_first)[actions].astype(int) - 1 + np.asarray(graph.action_lengths)[actions]
    after = last * database.stride
    positions, rotations = forward_kinematics(
        database.skeleton, database.root_positions[after], database.rotations[after], threads=1
    )
    joints = body.capsule_joints
    rows = np.empty((len(actions), len(joints), 7))
    for column, ends in ((0, body.capsule_starts), (3, body.capsule_ends)):
        points = positions[:, joints] + quaternion.rotate(rotations[:, joints].astype(float), ends)
        rows[..., column : column + 3] = ground.to_local(database.ground[after, None], points)
    rows[..., 6] = body.capsule_radii.max(axis=1)
    return rows

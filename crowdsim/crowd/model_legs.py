"""What a model knows of legs: where they are in the states in which actions end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.model_arms import part_of
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


def leg_rows(policy: Policy, states: int) -> tuple[Array, Array]:
    """Return knee and sole of both legs in each state, and how far from the position they are at most [m].

    Points are in the avatar's ground frame.

    Args:
        policy: The policy.
        states: How many states it has in a run, those of falls behind its own.

    Returns:
        Shapes (states, 2, 2, 3) and (states,), float32; 0 in those of falls.
    """
    database, body = policy.database, policy.database.body
    frames = np.asarray(policy.graph.state_frames, np.int64) * database.stride
    knees, feet = ([body.roles[f"{side}_{role}"] for side in ("left", "right")] for role in ("knee", "foot"))
    skeleton, joints = part_of(database.skeleton, [*knees, *feet])
    positions, rotations = forward_kinematics(
        skeleton, database.root_positions[frames], database.rotations[frames][:, joints]
    )
    own = [joints.index(foot) for foot in feet]
    soles = positions[:, own] + quaternion.rotate(rotations[:, own].astype(float), body.sole_offsets.mean(axis=1))
    points = np.stack([positions[:, [joints.index(knee) for knee in knees]], soles], axis=2)
    local = ground.to_local(database.ground[frames, None, None], points)
    legs, reaches = np.zeros((states, 2, 2, 3), np.float32), np.zeros(states, np.float32)
    legs[: len(frames)] = local
    reaches[: len(frames)] = np.hypot(local[..., 0], local[..., 2]).max(axis=(1, 2)) + 1e-5
    return legs, reaches

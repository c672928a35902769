"""A policy's motion as poses need it: rotations without the heading, places in the ground frame, soles and hinges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

Array = NDArray[Any]


@dataclass(frozen=True)
class PoseMotion:
    """P playback frames of a skeleton of J joints, ready to be posed; A actions.

    Attributes:
        skeleton: The skeleton.
        body: What it is as a body.
        stride: Playback frames in a control frame.
        rate: Playback frames a second.
        rotations: Local rotations, the root's without the heading. Shape (P, J, 4), float32.
        roots: Place of the root in the frame's ground frame [m]. Shape (P, 3), float32.
        ground: Ground transform in the clip's world. Shape (P, 3), float64.
        contacts: Whether each foot is planted. Shape (P, 2), bool.
        balls: Ball of each foot on the sole in the frame's ground frame [m]. Shape (P, 2, 3), float32.
        clip_first: First playback frame of the clip of each frame. Shape (P,).
        clip_last: Last playback frame of the clip of each frame. Shape (P,).
        origins: Playback frame that lies on the avatar when each action starts. Shape (A,).
        lengths: Length of each action [control frames]. Shape (A,).
    """

    skeleton: Skeleton
    body: Body
    stride: int
    rate: float
    rotations: Array
    roots: Array
    ground: Array
    contacts: Array
    balls: Array
    clip_first: Array
    clip_last: Array
    origins: Array
    lengths: Array


def prepare_motion(policy: Policy) -> PoseMotion:
    """Return a policy's motion ready to be posed."""
    database, graph = policy.database, policy.graph
    stride, body = database.stride, database.body
    headings = quaternion.about_y(-database.ground[:, 2]).astype(np.float32)
    rotations = np.array(database.rotations, dtype=np.float32)
    rotations[:, 0] = quaternion.multiply(headings, rotations[:, 0])
    roots = ground.to_local(database.ground, database.root_positions).astype(np.float32)
    positions, turns = forward_kinematics(database.skeleton, roots, rotations, parallel=False)
    feet = [body.roles["left_foot"], body.roles["right_foot"]]
    balls = positions[:, feet] + quaternion.rotate(turns[:, feet], body.sole_offsets[:, 1])
    starts = np.asarray(database.clip_starts, dtype=np.int64) * stride
    clip = np.searchsorted(starts, np.arange(starts[-1]), side="right") - 1
    return PoseMotion(
        skeleton=database.skeleton,
        body=body,
        stride=stride,
        rate=database.playback_rate,
        rotations=rotations,
        roots=roots,
        ground=np.asarray(database.ground, dtype=np.float64),
        contacts=np.asarray(database.contacts, dtype=bool),
        balls=balls.astype(np.float32),
        clip_first=starts[clip].astype(np.int64),
        clip_last=(starts[clip + 1] - 1).astype(np.int64),
        origins=(np.asarray(graph.action_first, dtype=np.int64) - 1) * stride,
        lengths=np.asarray(graph.action_lengths, dtype=np.int64),
    )

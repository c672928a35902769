"""What a model knows of arms, for strikes that a guard stops: where arms are, and which way strikes come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import PARTS, Body
from crowdsim.motion.kinematics import forward_kinematics

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.motion.skeleton import Skeleton
    from crowdsim.policy.policy import Policy

WAY = (0.1, 0.05)
"""How long before a strike reaches furthest the points of its way lie [s]."""

_ELBOWS = ("left_elbow", "right_elbow")
_FRAMES_AT_ONCE = 1 << 16


def arm_rows(database: MotionDatabase) -> Array:
    """Return the left and right elbow, and the left and right fist, in each frame's ground frame [m].

    Shape (P, 4, 3), float32.
    """
    roles, count = database.body.roles, len(database.ground)
    rows = np.empty((count, 4, 3), np.float32)
    rows[:, 2:] = database.fists
    skeleton, joints = part_of(database.skeleton, [roles[role] for role in _ELBOWS])
    elbows = [joints.index(roles[role]) for role in _ELBOWS]
    for low in range(0, count, _FRAMES_AT_ONCE):
        some = slice(low, low + _FRAMES_AT_ONCE)
        positions, _ = forward_kinematics(skeleton, database.root_positions[some], database.rotations[some][:, joints])
        local = ground.to_local(database.ground[some, None], positions[:, elbows].astype(float))
        rows[some, :2] = local
    return rows


def way_rows(policies: Sequence[Policy], starts: Sequence[Array]) -> Array:
    """Return where strikers are at the times ``WAY`` before strikes in actions, seen from the action's start [m].

    Args:
        policies: The policies.
        starts: For each what lies on the avatar when each of its actions starts, in the clip's world. Shape (A, 3).

    Returns:
        Shape (K, 2, 3), float32, strikes of one policy after another.
    """
    rows = []
    for policy, origins in zip(policies, starts, strict=True):
        actions = policy.actions
        owners = np.repeat(np.arange(actions.action_count), np.diff(actions.strike_offsets))
        points = _ways(policy.database)[actions.strike_ids]
        rows.append(ground.to_local(origins[owners, None], points))
    return np.concatenate(rows).astype(np.float32)


def arm_radii(body: Body) -> tuple[float, float]:
    """Return the radii of forearm and glove [m], 0 of a body that is drawn without one."""
    forearms = np.isin(body.capsule_joints, [body.roles[role] for role in _ELBOWS])
    gloves = body.capsule_parts == PARTS.index("glove")
    radii = body.capsule_radii[forearms]
    return float(np.mean(radii)) if len(radii) else 0.0, float(np.max(body.capsule_radii[gloves], initial=0.0))


def _ways(database: MotionDatabase) -> Array:
    """Return the points of the way of each strike of a database, in its clip's world [m]. Shape (S, 2, 3)."""
    body, limbs = database.body, np.asarray(database.strike_limbs, np.int64)
    strikes = np.asarray(database.strike_frames, np.int64)
    clips = np.asarray(database.clip_starts, np.int64) * database.stride
    first = clips[np.searchsorted(clips, strikes, side="right") - 1]
    ends, offsets = body.strikers["joint"][limbs], body.strikers["offset"][limbs]
    points = np.empty((len(strikes), len(WAY), 3))
    for column, before in enumerate(WAY):
        frames = np.maximum(strikes - round(before * database.playback_rate), first)
        positions, rotations = forward_kinematics(
            database.skeleton, database.root_positions[frames], database.rotations[frames]
        )
        own = np.arange(len(strikes)), ends
        points[:, column] = positions[own] + quaternion.rotate(rotations[own].astype(float), offsets)
    return points


def part_of(skeleton: Skeleton, joints: Sequence[int]) -> tuple[Skeleton, list[int]]:
    """Return the part of a skeleton from the root to some joints, and the joints of that part, ascending."""
    kept: set[int] = set()
    for end in joints:
        joint = int(end)
        while joint >= 0:
            kept.add(joint)
            joint = int(skeleton.parents[joint])
    chosen = sorted(kept)
    parents = [chosen.index(int(skeleton.parents[joint])) if skeleton.parents[joint] >= 0 else -1 for joint in chosen]
    part = replace(
        skeleton,
        names=tuple(skeleton.names[joint] for joint in chosen),
        parents=np.array(parents, np.int32),
        offsets=skeleton.offsets[chosen],
        end_parents=np.zeros(0, np.int32),
        end_offsets=np.zeros((0, 3)),
    )
    return part, chosen

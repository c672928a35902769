"""What a model knows of falls: where they lead, how bodies lie, and where soles are that could tread on these."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.model_arms import part_of
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.falls import FALL, LYING, RISE, STAGGER

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_FRAMES_AT_ONCE = 1 << 16


def fall_rows(policies: Sequence[Policy], starts: dict[str, Array]) -> dict[str, Array]:
    """Return what ``Model`` holds of the falls and staggers of all policies, by its names."""
    rows: list[tuple[int, int, int, int]] = []
    directions: list[float] = []
    axes = [np.zeros((0, 8))]
    capsules: list[Array] = []
    for p, (first, policy) in enumerate(zip(starts["action"], policies, strict=False)):
        falls = policy.falls
        if falls is None:
            continue
        for number, direction in enumerate(falls.direction.tolist()):
            own = len(rows)
            for kind, actions in ((FALL, falls.fall), (LYING, falls.lie), (RISE, falls.rise)):
                rows.append((p, kind, int(first + actions[number]), own))
                directions.append(direction)
        axes.append(np.repeat(_lying_axes(policy, falls.fall), 3, axis=0))
        capsules.append(np.repeat(_lying_capsules(policy, falls.fall), 3, axis=0))
        for action, direction in zip(falls.stagger.tolist(), falls.stagger_direction.tolist(), strict=True):
            rows.append((p, STAGGER, int(first + action), len(rows)))
            directions.append(direction)
        axes.append(np.zeros((len(falls.stagger), 8)))
        capsules.append(np.zeros((len(falls.stagger), capsules[-1].shape[1], 7)))
    return {
        "falls": np.array(rows, np.int32).reshape(-1, 4),
        "fall_directions": np.array(directions, float),
        "fall_axes": np.concatenate(axes),
        "fall_capsules": _stacked(capsules),
        "soles": _sole_rows(policies),
    }


def _lying_axes(policy: Policy, actions: Array) -> Array:
    """Return where head and feet are after falls (F,), seen from their first and their last frames. Shape (F, 8)."""
    database, graph = policy.database, policy.graph
    before = (np.asarray(graph.action_first)[actions].astype(int) - 1) * database.stride
    after = before + np.asarray(graph.action_lengths)[actions].astype(int) * database.stride
    positions, _ = forward_kinematics(
        database.skeleton, database.root_positions[after], database.rotations[after], threads=1
    )
    feet = positions[:, [database.body.roles[name] for name in ("left_foot", "right_foot")]].mean(axis=1)
    heads = ground.to_world(database.ground[after], database.heads[after].astype(float))
    ends = np.stack([heads, feet], axis=1)
    seen = [ground.to_local(database.ground[frames][:, None], ends)[..., [0, 2]] for frames in (before, after)]
    return np.stack(seen, axis=1).reshape(len(actions), 8)


def _stacked(capsules: Sequence[Array]) -> Array:
    """Return capsules of bodies (n, K, 7) as one array; where a body has fewer than others, its last one repeats."""
    most = max((rows.shape[1] for rows in capsules), default=0)
    padded = [np.pad(rows, ((0, 0), (0, most - rows.shape[1]), (0, 0)), mode="edge") for rows in capsules]
    return np.concatenate([np.zeros((0, most, 7)), *padded])


def _sole_rows(policies: Sequence[Policy]) -> Array:
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


def _lying_capsules(policy: Policy, actions: Array) -> Array:
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

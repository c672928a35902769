"""What a model knows of falls: where they lead, how bodies lie, and where soles are that could tread on these."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.model_arms import part_of
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.falls import FALL, LYING, RISE, STAGGER, STAGGER_ON

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
        own_axes, own_capsules = _lying_bodies(policy, falls.fall)
        axes.append(np.repeat(own_axes, 3, axis=0))
        capsules.append(np.repeat(own_capsules, 3, axis=0))
        before = len(rows)
        for start, last, direction in zip(
            falls.stagger.tolist(), falls.stagger_last.tolist(), falls.stagger_direction.tolist(), strict=True
        ):
            own = len(rows)
            for action in range(start, last + 1):
                rows.append((p, STAGGER if action == start else STAGGER_ON, int(first + action), own))
                directions.append(direction)
        axes.append(np.zeros((len(rows) - before, 8)))
        capsules.append(np.zeros((len(rows) - before, own_capsules.shape[1], 8)))
    return {
        "falls": np.array(rows, np.int32).reshape(-1, 4),
        "fall_directions": np.array(directions, float),
        "fall_axes": np.concatenate(axes),
        "fall_capsules": _stacked(capsules),
        "soles": _sole_rows(policies),
    }


def _lying_bodies(policy: Policy, actions: Array) -> tuple[Array, Array]:
    """Return how bodies lie after falls (F,): ``Model.fall_axes`` and ``Model.fall_capsules``. (F, 8), (F, K, 8)."""
    database, graph, body = policy.database, policy.graph, policy.database.body
    before = (np.asarray(graph.action_first)[actions].astype(int) - 1) * database.stride
    after = before + np.asarray(graph.action_lengths)[actions].astype(int) * database.stride
    positions, rotations = forward_kinematics(
        database.skeleton, database.root_positions[after], database.rotations[after], threads=1
    )
    feet = positions[:, [body.roles[name] for name in ("left_foot", "right_foot")]].mean(axis=1)
    heads = ground.to_world(database.ground[after], database.heads[after].astype(float))
    ends = np.stack([heads, feet], axis=1)
    seen = [ground.to_local(database.ground[frames][:, None], ends)[..., [0, 2]] for frames in (before, after)]
    joints, capsules = body.capsule_joints, np.empty((len(actions), len(body.capsule_joints), 8))
    for columns, offsets in ((slice(0, 3), body.capsule_starts), (slice(3, 6), body.capsule_ends)):
        points = positions[:, joints] + quaternion.rotate(rotations[:, joints].astype(float), offsets)
        capsules[..., columns] = ground.to_local(database.ground[after, None], points)
    capsules[..., 6] = body.capsule_radii.max(axis=1)
    capsules[..., 7] = capsules[..., 6] + 0.5 * np.linalg.norm(capsules[..., 3:6] - capsules[..., :3], axis=-1)
    return np.stack(seen, axis=1).reshape(len(actions), 8), capsules


def _stacked(capsules: Sequence[Array]) -> Array:
    """Return capsules of bodies (n, K, 8) as one array; where a body has fewer than others, its last one repeats."""
    most = max((rows.shape[1] for rows in capsules), default=0)
    padded = [np.pad(rows, ((0, 0), (0, most - rows.shape[1]), (0, 0)), mode="edge") for rows in capsules]
    return np.concatenate([np.zeros((0, most, 8)), *padded])


def _sole_rows(policies: Sequence[Policy]) -> Array:
    """Return left heel and ball, right heel and ball in each frame's ground frame [m].

    Shape (L, 12), float32; (0, 12) where no policy has falls.
    """
    if all(policy.falls is None for policy in policies):
        return np.zeros((0, 12), np.float32)
    return np.concatenate([_soles_of(policy) for policy in policies])


def _soles_of(policy: Policy) -> Array:
    """Return the rows of one policy's frames. Shape (P, 12), float32."""
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

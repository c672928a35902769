"""What a model knows of falls: where they lead, how bodies lie, and where soles are that could tread on these."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.records import CAPSULE, LINE
from crowdsim.crowd.kernels.records import FALL as FALLS
from crowdsim.crowd.model_arms import part_of
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.falls import CHEER, FALL, LYING, RISE, STAGGER

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_FRAMES_AT_ONCE = 1 << 16


def fall_rows(policies: Sequence[Policy], starts: dict[str, Array]) -> dict[str, Array]:
    """Return what ``Model`` holds of the falls, staggers and celebrations of all policies, by its names."""
    rows: list[tuple[float, int, int, int, int, int]] = []
    axes = [np.zeros((0, 2), LINE)]
    capsules: list[Array] = []
    for p, (first, policy) in enumerate(zip(starts["action"], policies, strict=False)):
        falls = policy.falls
        if falls is None:
            continue
        twins, motion = dict[int, int](), captured_starts(policy, falls.fall).tolist()
        for number, direction in enumerate(falls.direction.tolist()):
            own = len(rows)
            twin = twins.setdefault(motion[number], own)
            for kind, actions in ((FALL, falls.fall), (LYING, falls.lie), (RISE, falls.rise)):
                rows.append((direction, p, kind, int(first + actions[number]), own, twin))
        own_axes, own_capsules = _lying_bodies(policy, falls.fall)
        axes.append(np.repeat(own_axes, 3, axis=0))
        capsules.append(np.repeat(own_capsules, 3, axis=0))
        before, twins = len(rows), {}
        begins = captured_starts(policy, falls.stagger).tolist()
        for action, direction, frame in zip(
            falls.stagger.tolist(), falls.stagger_direction.tolist(), begins, strict=True
        ):
            own = len(rows)
            rows.append((direction, p, STAGGER, int(first + action), own, twins.setdefault(frame, own)))
        for action in falls.cheer.tolist():
            rows.append((0.0, p, CHEER, int(first + action), len(rows), len(rows)))
        axes.append(np.zeros((len(rows) - before, 2), LINE))
        capsules.append(np.zeros((len(rows) - before, own_capsules.shape[1]), CAPSULE))
    return {
        "falls": np.array(rows, FALLS),
        "fall_axes": np.concatenate(axes),
        "fall_capsules": _stacked(capsules),
        "soles": _sole_rows(policies),
    }


def captured_starts(policy: Policy, actions: Array) -> Array:
    """Return the control frame in which each action starts, of a mirror image that of what it mirrors. Shape (n,)."""
    database = policy.database
    frames = np.asarray(policy.graph.action_first)[actions].astype(int) - 1
    return np.where(frames >= database.captured_frames, frames - database.captured_frames, frames)


def _lying_bodies(policy: Policy, actions: Array) -> tuple[Array, Array]:
    """Return how bodies lie after falls (F,): ``Model.fall_axes`` and ``Model.fall_capsules``. (F, 2), (F, K)."""
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
    axes, capsules = np.empty((len(actions), 2), LINE), np.empty((len(actions), len(body.capsule_joints)), CAPSULE)
    for name, end, axis in (("x", 0, 0), ("z", 0, 1), ("to_x", 1, 0), ("to_z", 1, 1)):
        axes[name] = np.stack([ends[:, end, axis] for ends in seen], axis=1)
    joints, sides = body.capsule_joints, list[Array]()
    for names, offsets in ((("x", "y", "z"), body.capsule_starts), (("to_x", "to_y", "to_z"), body.capsule_ends)):
        points = positions[:, joints] + quaternion.rotate(rotations[:, joints].astype(float), offsets)
        sides.append(ground.to_local(database.ground[after, None], points))
        for axis, name in enumerate(names):
            capsules[name] = sides[-1][..., axis]
    capsules["radius"] = body.capsule_radii.max(axis=1)
    capsules["bound"] = capsules["radius"] + 0.5 * np.linalg.norm(sides[1] - sides[0], axis=-1)
    return axes, capsules


def _stacked(capsules: Sequence[Array]) -> Array:
    """Return capsules of bodies (n, K) as one array; where a body has fewer than others, its last one repeats."""
    most = max((rows.shape[1] for rows in capsules), default=0)
    padded = [rows[:, np.minimum(np.arange(most), rows.shape[1] - 1)] for rows in capsules]
    return np.concatenate([np.zeros((0, most), CAPSULE), *padded])


def _sole_rows(policies: Sequence[Policy]) -> Array:
    """Return heel and ball of both soles in each frame's ground frame [m].

    Shape (L, 2, 2, 3), float32; (0, 2, 2, 3) where no policy has falls.
    """
    if all(policy.falls is None for policy in policies):
        return np.zeros((0, 2, 2, 3), np.float32)
    return np.concatenate([soles_of(policy) for policy in policies])


def soles_of(policy: Policy) -> Array:
    """Return the soles of one policy's frames. Shape (P, 2, 2, 3), float32."""
    database, body = policy.database, policy.database.body
    rows = np.empty((len(database.ground), 2, 2, 3), np.float32)
    feet = [body.roles[f"{side}_foot"] for side in ("left", "right")]
    skeleton, joints = part_of(database.skeleton, feet)
    own = [joints.index(foot) for foot in feet]
    for low in range(0, len(rows), _FRAMES_AT_ONCE):
        some = slice(low, low + _FRAMES_AT_ONCE)
        positions, rotations = forward_kinematics(
            skeleton, database.root_positions[some], database.rotations[some][:, joints]
        )
        soles = positions[:, own, None] + quaternion.rotate(rotations[:, own, None].astype(float), body.sole_offsets)
        rows[some] = ground.to_local(database.ground[some, None, None], soles)
    return rows

"""Hits show: a landed strike throws head and trunk back along the blow, and they spring back, over the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.take.motion import PoseMotion

Array = NDArray[Any]

LENGTH = 0.9
"""How long a reaction lasts [s]."""
_PEAK = 0.09
_TYPICAL_SPEED = 8.0
_STRONGEST = 1.6
_JOINTS = (("spine", 0.06, 0.14), ("chest", 0.06, 0.1), ("neck", 0.14, 0.05), ("head", 0.2, 0.07))
"""Joints that give way, and by how much in a blow of typical speed to the head and to the torso [rad]."""


@dataclass(frozen=True)
class Blows:
    """Strikes that landed on avatars of a window; E strikes.

    Attributes:
        columns: Column of each victim. Shape (E,).
        times: When [s]. Shape (E,).
        ways: Which way the fist went, level, unit length. Shape (E, 3).
        speeds: How fast [m/s]. Shape (E,).
        on_head: Whether the head was hit. Shape (E,).
    """

    columns: Array
    times: Array
    ways: Array
    speeds: Array
    on_head: Array


def _response(since: Array) -> Array:
    """A spring's answer to a blow, 1 at its highest, swinging through once, at rest when it ends."""
    s = np.clip(since / _PEAK, 0.0, None)
    spring = (
        s * s * np.exp(2.0 - 2.0 * s) - 0.12 * np.sin(np.clip((since - 2.5 * _PEAK) / (4.0 * _PEAK), 0, 1) * np.pi) ** 2
    )
    end = np.clip((LENGTH - since) / (0.4 * LENGTH), 0.0, 1.0)
    return np.asarray(np.where((since > 0.0) & (since < LENGTH), spring * end * end * (3.0 - 2.0 * end), 0.0))


def show_blows(motion: PoseMotion, blows: Blows, times: Array, roots: Array, rotations: Array) -> None:
    """Lay reactions over poses, in place.

    Args:
        motion: The policy's motion.
        blows: Strikes that landed.
        times: Shape (T,) [s].
        roots: Places of the roots. Shape (T, n, 3).
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    count, joints = rotations.shape[1:3]
    first = np.searchsorted(times, blows.times, side="right")
    stop = np.searchsorted(times, blows.times + LENGTH, side="left")
    spans = np.maximum(stop - first, 0)
    which = np.repeat(np.arange(len(spans)), spans)
    if not len(which):
        return
    rows = np.arange(spans.sum()) - np.repeat(np.cumsum(spans) - spans, spans) + np.repeat(first, spans)
    poses, inverse = np.unique(rows * count + blows.columns[which], return_inverse=True)
    strength = np.minimum(blows.speeds[which] / _TYPICAL_SPEED, _STRONGEST) * _response(
        times[rows] - blows.times[which]
    )
    # Thrown back along the blow: the turn about the level axis to its left.
    axes = np.cross([0.0, 1.0, 0.0], blows.ways[which]) * strength[:, None]
    flat = rotations.reshape(-1, joints, 4)
    there = np.isfinite(roots.reshape(-1, 3)[poses, 0])
    local = flat[poses]
    roles = motion.body.roles
    for role, head, torso in _JOINTS:
        joint = roles[role]
        if role == "chest" and joint == roles["spine"]:
            continue
        amounts = np.where(blows.on_head[which], head, torso)
        spin = np.zeros((len(poses), 3))
        np.add.at(spin, inverse, axes * amounts[:, None])
        _, turns = forward_kinematics(motion.skeleton, np.zeros((len(local), 3), np.float32), local, parallel=False)
        before = turns[:, int(motion.skeleton.parents[joint])].astype(float)
        turn = quaternion.from_rotation_vector(spin)
        inside = quaternion.multiply(quaternion.conjugate(before), quaternion.multiply(turn, before))
        local[there, joint] = quaternion.multiply(inside, local[:, joint])[there]
    flat[poses] = local

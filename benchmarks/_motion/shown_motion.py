"""Motion as it is shown: joints of a run at the playback rate, its decisions, and the capture behind it.

Sizes of avatars are divided out, so that shown motion and capture are on one scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground, quaternion
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.poses.kernels.records import Moments
from crowdsim.poses.sampler import PoseSampler

PARTS = {
    "legs": ("hip", "knee", "foot", "ball"),
    "trunk": ("pelvis", "spine", "chest"),
    "arms": ("shoulder", "elbow", "hand", "fist"),
    "head": ("neck", "head"),
}
"""Parts of the body by the last word of a point's name."""
_BLOCK = 30
"""Avatars that are posed at once."""


@dataclass(frozen=True)
class Shown:
    """Joints of n avatars over T frames, P points of which R are joints; and of K frames of capture.

    Attributes:
        names: Names of the points: R joints by their roles, then fists and balls of the feet.
        joints: How many are joints, R.
        rate: Frames a second.
        positions: Of the points in the world, at size 1 [m]. Shape (n, T, P, 3), float32.
        rotations: Of the joints in the world. Shape (n, T, R, 4), float32.
        local: Of the joints in their parents. Shape (n, T, R, 4), float32.
        headings: Shape (n, T) [rad].
        frames: Frame of capture behind each frame. Shape (n, T).
        captured: The capture likewise: positions (K, P, 3), rotations (K, R, 4), local (K, R, 4), headings (K,).
        clips: Clip of each frame of capture, one number for a clip and its mirror image. Shape (K,).
        pieces: Where clips of the capture begin and end. Shape (C, 2).
        owners: Avatar of each decision, in order. Shape (D,).
        times: Frame of each decision. Shape (D,).
        left: Frame of capture that it leaves. Shape (D,).
        entered: Frame of capture that it goes on from. Shape (D,).
        strikes: Attacker, hand and frame of each strike that lands. Shape (S, 3).
        blows: Victim and frame of each. Shape (S, 2).
    """

    names: tuple[str, ...]
    joints: int
    rate: float
    positions: Array
    rotations: Array
    local: Array
    headings: Array
    frames: Array
    captured: tuple[Array, Array, Array, Array]
    clips: Array
    pieces: Array
    owners: Array
    times: Array
    left: Array
    entered: Array
    strikes: Array
    blows: Array

    def part(self, name: str) -> list[int]:
        """Return the points of a part of the body."""
        return [k for k, point in enumerate(self.names) if point.split("_")[-1] in PARTS[name]]


def _points(database: MotionDatabase, positions: Array, rotations: Array) -> Array:
    """Positions of joints with roles, fists and balls, of a body of size 1; of positions (..., J, 3)."""
    body = database.body
    roles = _roles(database)
    kept = [positions[..., body.roles[name], :] for name in roles]
    for k, side in enumerate(("left", "right")):
        for name, offset in (("hand", body.fist_offsets[k]), ("foot", body.sole_offsets[k, 1])):
            joint = body.roles[f"{side}_{name}"]
            kept.append(positions[..., joint, :] + quaternion.rotate(rotations[..., joint, :], offset))
    return np.stack(kept, axis=-2).astype(np.float32)


def _roles(database: MotionDatabase) -> list[str]:
    """Roles in order of their joints, each joint once."""
    roles = database.body.roles
    first = {joint: name for name, joint in sorted(roles.items(), reverse=True)}
    return [first[joint] for joint in sorted(first)]


def read_shown(sampler: PoseSampler) -> Shown:
    """Pose a run of one policy, whose avatars are there all the time."""
    take, database = sampler.take, sampler.policies[0].database
    rate, count = float(database.playback_rate), take.avatar_count
    roles = _roles(database)
    kept = [database.body.roles[name] for name in roles]
    frames = take.output_frames(rate)
    parts: list[tuple[Array, Array, Array, Array]] = []
    for first in range(0, count, _BLOCK):
        poses = sampler.sample(0, frames, rate, np.arange(first, min(first + _BLOCK, count)))[0]
        positions, rotations = poses.joints()
        positions = positions / poses.scales[:, None, None].astype(np.float32)
        parts.append(
            (
                _points(database, positions, rotations).swapaxes(0, 1),
                rotations[:, :, kept].swapaxes(0, 1),
                poses.rotations[:, :, kept].swapaxes(0, 1),
                poses.ground[..., 2].T,
            )
        )
    shown = [np.concatenate([part[k] for part in parts]) for k in range(4)]
    world, turned = forward_kinematics(database.skeleton, database.root_positions, database.rotations, threads=1)
    headings = np.asarray(database.ground[:, 2])
    local = np.array(database.rotations)
    starts = np.asarray(database.clip_starts) * database.stride
    clip = np.searchsorted(starts, np.arange(starts[-1]), side="right") - 1
    names = [name.removesuffix("~mirror") for name in database.clip_names]
    unique = sorted(set(names))
    window = sampler.window(0, np.arange(count), np.array([0.0, take.seconds]))
    rows = window.rows
    owner, row = np.nonzero((rows.fresh & rows.present)[1:].T & rows.present[:-1].T)
    row = row + 1
    ends = rows.origins + rows.lengths.astype(np.int64) * database.stride
    times = (rows.first + row - rows.phase[row, owner] / rows.speeds[owner]) / rows.rate
    events = take.events
    landed = np.flatnonzero(np.asarray(events.landed))
    when = np.round(np.asarray(events.frame, float)[landed] / take.control_rate * rate).astype(np.int64)
    return Shown(
        names=(*roles, "left_fist", "left_ball", "right_fist", "right_ball"),
        joints=len(roles),
        rate=rate,
        positions=shown[0],
        rotations=shown[1],
        local=shown[2],
        headings=shown[3],
        frames=window.playback(Moments(np.arange(count), (np.arange(frames) / rate)[:, None])).frames.T,
        captured=(_points(database, world, turned), turned[:, kept], local[:, kept], headings),
        clips=np.array([unique.index(name) for name in names])[clip],
        pieces=np.stack([starts[:-1], starts[1:]], axis=1),
        owners=owner,
        times=np.round(times * rate).astype(np.int64),
        left=ends[row - 1, owner],
        entered=rows.origins[row, owner],
        strikes=np.stack([np.asarray(events.attacker)[landed], np.asarray(events.hand)[landed], when], axis=1),
        blows=np.stack([np.asarray(events.victim)[landed], when], axis=1),
    )


def seen(positions: Array, headings: Array) -> Array:
    """Return positions (n, T, P, 3) about their middle frame, in the direction of headings (n,)."""
    origin = np.zeros((len(positions), 3))
    middle = positions[:, positions.shape[1] // 2].mean(axis=1)
    origin[:, 0], origin[:, 1], origin[:, 2] = middle[:, 0], middle[:, 2], headings
    return np.asarray(ground.to_local(origin[:, None, None], positions.astype(float)))

"""A policy's motion as poses need it: rotations without heading, positions in the ground frame, soles and hinges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.contacts import plant_spans
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.limbs import flexion, hinge_axis
from crowdsim.motion.skeleton import Skeleton
from crowdsim.take.gait import Gait, measure_gait

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy
    from crowdsim.policy.rewards import TargetBody


_FREE, _MORE = np.deg2rad(130.0), np.deg2rad(8.0)
"""Flexion that blends may always give, and what they may give beyond that or the capture's own [rad]."""
_SETTLES = 2
"""Frames at the ends of a foot plant in which the foot still comes to rest, or begins to lift."""
_SIDES = ("left", "right")
_SAMPLE = 4096


class Frames(NamedTuple):
    """Playback frames for compiled code; P frames, J joints.

    Attributes:
        rotations: Local rotations, the root's without the heading, continuous in sign in a clip. Shape (P, J, 4),
            float32.
        roots: Position of the root in the frame's ground frame [m]. Shape (P, 3), float32.
        ground: Ground transform in the clip's world. Shape (P, 3), float64.
        contacts: Whether each foot is planted. Shape (P, 2), bool.
        holds: Point of each foot about which it rotates while it is planted, in the frame's ground frame [m].
            Shape (P, 2, 3), float32.
        feet: Turn of each foot in the frame's ground frame. Shape (P, 2, 4), float32.
        tracks: That point and the turn of each foot in the clip's world, and the turn of its toes on it, if there are
            any. Shape (P, 2, 11), float32.
        plants: First and last frame over which each foot stays planted as in this one, or is in the air as in this
            one. Shape (P, 2, 2), int32.
        bounds: First and last playback frame of the clip of each frame. Shape (P, 2).
        stride: Playback frames in a control frame.
        rate: Playback frames a second.
    """

    rotations: Array
    roots: Array
    ground: Array
    contacts: Array
    holds: Array
    feet: Array
    tracks: Array
    plants: Array
    bounds: Array
    stride: int
    rate: float


class Limbs(NamedTuple):
    """Two limbs of a body for compiled code, left and right.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        offsets: Position of each joint in its parent's frame [m]. Shape (J, 3).
        chain: Joints from the root to the ends, parents first.
        joints: Upper, middle and end joint. Shape (2, 3).
        hinges: Axis of flexion in the upper joint's frame. Shape (2, 3).
        points: What is moved: heel and ball of each foot, or the fist twice, in the end joint's frame [m]. Shape
            (2, 2, 3).
        bends: Lower and upper joint of the spine that lean for arms. Shape (2,).
        toes: A joint that hangs on each end joint and turns with the toes, -1 where there is none. Shape (2,).
        holds: Point of each end joint that stays where it is while it holds on to something, in its frame [m]: where
            the toes begin, the ball of the foot where there are none. Shape (2, 3).
    """

    parents: Array
    offsets: Array
    chain: Array
    joints: Array
    hinges: Array
    points: Array
    bends: Array
    toes: Array
    holds: Array


class Hinges(NamedTuple):
    """Elbows and knees for compiled code, where nothing moves between them and the joints they hang on and carry.

    Attributes:
        joints: The joints. Shape (n,).
        bones: The bone before and the bone after each, in its parent's frame and in its own [m]. Shape (n, 2, 3).
        limits: Flexion up to which a blend leaves them alone, and the most that it may give [rad]. Shape (n, 2).
    """

    joints: Array
    bones: Array
    limits: Array


@dataclass(frozen=True)
class PoseMotion:
    """P playback frames of a skeleton of J joints, ready to be posed; A actions.

    Attributes:
        skeleton: The skeleton.
        body: What it is as a body.
        target: The body of scripted targets that it strikes.
        frames: The frames.
        legs: The legs.
        arms: The arms.
        hinges: Elbows and knees.
        gait: How it steps.
        fists: Position of the left and right fist in the frame's ground frame [m]. Shape (P, 2, 3), float32.
        trunks: Centre of the head, upper and lower end of the trunk in the frame's ground frame [m]. Shape (P, 3, 3),
            float32.
        strikes: Playback frames at which strikes reach furthest, ascending. Shape (S,).
        origins: Playback frame that lies on the avatar when each action starts. Shape (A,).
        lengths: Length of each action [control frames]. Shape (A,).
        shifts: Where the ground transform of that frame lies then, as seen from the avatar's. Shape (A, 3).
    """

    skeleton: Skeleton
    body: Body
    target: TargetBody
    frames: Frames
    legs: Limbs
    arms: Limbs
    hinges: Hinges
    gait: Gait
    fists: Array
    trunks: Array
    strikes: Array
    origins: Array
    lengths: Array
    shifts: Array


def prepare_motion(policy: Policy) -> PoseMotion:
    """Return a policy's motion ready to be posed."""
    database, graph = policy.database, policy.graph
    skeleton, body, stride = database.skeleton, database.body, database.stride
    starts = np.asarray(database.clip_starts, dtype=np.int64) * stride
    headings = quaternion.about_y(-database.ground[:, 2]).astype(np.float32)
    rotations = np.array(database.rotations, dtype=np.float32)
    rotations[:, 0] = quaternion.multiply(headings, rotations[:, 0])
    _align_signs(rotations, starts)
    positions, world_rotations = forward_kinematics(skeleton, database.root_positions, database.rotations, threads=1)
    some = slice(None, None, max(1, len(positions) // _SAMPLE))
    sample = positions[some], world_rotations[some]
    bends = np.array([body.roles["spine"], body.roles["chest"]])
    legs = _limbs(skeleton, body, ("hip", "knee", "foot"), body.sole_offsets, bends, sample)
    feet = legs.joints[:, 2]
    holds = positions[:, feet] + quaternion.rotate(world_rotations[:, feet], legs.holds)
    contacts = np.array(database.contacts, dtype=bool)
    clip = np.searchsorted(starts, np.arange(starts[-1]), side="right") - 1
    frames = Frames(
        rotations=rotations,
        roots=ground.to_local(database.ground, database.root_positions).astype(np.float32),
        ground=np.array(database.ground, dtype=np.float64),
        contacts=contacts,
        holds=ground.to_local(database.ground[:, None], holds).astype(np.float32),
        feet=quaternion.multiply(headings[:, None], world_rotations[:, feet]).astype(np.float32),
        tracks=_tracks(holds, world_rotations[:, feet], rotations, legs.toes),
        plants=_at_rest(contacts, starts),
        bounds=np.stack([starts[clip], starts[clip + 1] - 1], axis=1),
        stride=stride,
        rate=float(database.playback_rate),
    )
    fists = np.repeat(body.fist_offsets[:, None], 2, axis=1)
    return PoseMotion(
        skeleton=skeleton,
        body=body,
        target=policy.body,
        frames=frames,
        legs=legs,
        arms=_limbs(skeleton, body, ("shoulder", "elbow", "hand"), fists, bends, sample),
        hinges=_hinges(skeleton, body, positions),
        gait=measure_gait(contacts, holds, starts, float(database.playback_rate)),
        fists=np.asarray(database.fists),
        trunks=np.stack([database.heads, database.necks, database.pelvises], axis=1),
        strikes=np.asarray(database.strike_frames, dtype=np.int64),
        origins=(np.asarray(graph.action_first, dtype=np.int64) - 1) * stride,
        lengths=np.asarray(graph.action_lengths, dtype=np.int64),
        shifts=np.asarray(policy.actions.shifts, dtype=np.float64),
    )


def _tracks(holds: Array, world_rotations: Array, rotations: Array, toes: Array) -> Array:
    """Return what each foot does in its clip's world, side by side."""
    tracks = np.zeros((len(holds), 2, 11), np.float32)
    tracks[..., :3], tracks[..., 3:7], tracks[..., 7] = holds, world_rotations, 1.0
    there = toes >= 0
    tracks[:, there, 7:] = rotations[:, toes[there]]
    return tracks


def _at_rest(contacts: Array, starts: Array) -> Array:
    """Return the frames over which each foot stays planted, without those in which it comes to rest or lifts off."""
    spans, frames = plant_spans(contacts, starts), np.arange(len(contacts))[:, None]
    first, last = np.minimum(spans[..., 0] + _SETTLES, frames), np.maximum(spans[..., 1] - _SETTLES, frames)
    rest = np.stack([first, last], axis=-1)
    return np.where(contacts[..., None], rest, plant_spans(~contacts, starts)).astype(np.int32)


def chain_of(skeleton: Skeleton, joints: Sequence[int]) -> Array:
    """Return joints and all that they hang on, parents first."""
    found: set[int] = set()
    for joint in joints:
        at = int(joint)
        while at >= 0 and at not in found:
            found.add(at)
            at = int(skeleton.parents[at])
    return np.array(sorted(found), np.int64)


def _limbs(
    skeleton: Skeleton,
    body: Body,
    names: tuple[str, str, str],
    points: Array,
    bends: Array,
    sample: tuple[Array, Array],
) -> Limbs:
    """Two limbs; ``sample`` holds positions and rotations of all joints in some poses."""
    joints = np.array([[body.roles[f"{side}_{name}"] for name in names] for side in _SIDES], np.int64)
    positions, rotations = sample
    hinges = [
        hinge_axis(positions[:, upper], positions[:, middle], positions[:, end], rotations[:, upper])
        for upper, middle, end in joints
    ]
    toes = [body.roles.get(f"{side}_toe", -1) if names[2] == "foot" else -1 for side in _SIDES]
    # Toes may hang on a joint between them and the foot; then the ball holds.
    toes = [
        toe if toe >= 0 and skeleton.parents[toe] == end else -1 for toe, end in zip(toes, joints[:, 2], strict=True)
    ]
    holds = [skeleton.offsets[toe] if toe >= 0 else points[side, 1] for side, toe in enumerate(toes)]
    return Limbs(
        parents=np.asarray(skeleton.parents, dtype=np.int64),
        offsets=np.asarray(skeleton.offsets, dtype=np.float64),
        chain=chain_of(skeleton, [*joints[:, 2], *bends]),
        joints=joints,
        hinges=np.stack(hinges),
        points=np.asarray(points, dtype=np.float64),
        bends=bends.astype(np.int64),
        toes=np.array(toes, np.int64),
        holds=np.array(holds, np.float64),
    )


def _hinges(skeleton: Skeleton, body: Body, positions: Array) -> Hinges:
    """Elbows and knees with limits that all of the capture keeps."""
    joints, bones, limits = [], [], []
    for side in _SIDES:
        for names in (("shoulder", "elbow", "hand"), ("hip", "knee", "foot")):
            upper, middle, end = (body.roles[f"{side}_{name}"] for name in names)
            if skeleton.parents[middle] != upper or skeleton.parents[end] != middle:
                continue
            bend = flexion(positions[:, upper], positions[:, middle], positions[:, end])
            joints.append(middle)
            bones.append([skeleton.offsets[middle], skeleton.offsets[end]])
            limits.append(max(float(np.percentile(bend, 99.9)), _FREE))
    free = np.array(limits)
    return Hinges(
        np.array(joints, np.int64),
        np.array(bones, np.float64).reshape(-1, 2, 3),
        np.stack([free, free + _MORE], axis=1),
    )


def _align_signs(rotations: Array, starts: Array) -> None:
    """Give the rotations of a joint in all clips the sign that lies nearest to its first clip's, in place."""
    first = rotations[starts[0] : starts[1]].sum(axis=0)
    for start, stop in pairwise(starts[1:]):
        dots = np.sum(rotations[start:stop].sum(axis=0) * first, axis=-1)
        rotations[start:stop] *= np.where(dots < 0.0, -1.0, 1.0)[None, :, None].astype(np.float32)

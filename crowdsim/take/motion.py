"""A policy's motion as poses need it: rotations without the heading, places in the ground frame, soles and hinges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import ground, quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.contacts import runs
from crowdsim.motion.ik import flexion, hinge_axis
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

Array = NDArray[Any]

SKATING = 0.03
"""Speed down to which planted feet that skate in the capture are calmed [m/s]; slower ones tremble as they did."""
_SETTLE = (0.3, 0.55)
"""Half of the time over which a planted foot comes to rest in its mean place, evenly and fading [s]."""
_FREE, _MORE = np.deg2rad(130.0), np.deg2rad(8.0)
"""Flexion that blends may always give, and what they may give beyond that or the capture's own [rad]."""
_SIDES = ("left", "right")
_SAMPLE = 4096


class Frames(NamedTuple):
    """Playback frames for compiled code; P frames, J joints.

    Attributes:
        rotations: Local rotations, the root's without the heading, continuous in sign in a clip. Shape (P, J, 4),
            float32.
        roots: Place of the root in the frame's ground frame [m]. Shape (P, 3), float32.
        ground: Ground transform in the clip's world. Shape (P, 3), float64.
        contacts: Whether each foot is planted. Shape (P, 2), bool.
        balls: Ball of each foot on the sole in the frame's ground frame, planted ones calmed [m]. Shape (P, 2, 3),
            float32.
        bounds: First and last playback frame of the clip of each frame. Shape (P, 2).
        stride: Playback frames in a control frame.
        rate: Playback frames a second.
    """

    rotations: Array
    roots: Array
    ground: Array
    contacts: Array
    balls: Array
    bounds: Array
    stride: int
    rate: float


class Limbs(NamedTuple):
    """Two limbs of a body for compiled code, left and right.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        offsets: Place of each joint in its parent's frame [m]. Shape (J, 3).
        chain: Joints from the root to the ends, parents first.
        joints: Upper, middle and end joint. Shape (2, 3).
        hinges: Axis of flexion in the upper joint's frame. Shape (2, 3).
        points: What is moved: heel and ball of each foot, or the fist twice, in the end joint's frame [m]. Shape
            (2, 2, 3).
        bends: Lower and upper joint of the spine that lean for arms. Shape (2,).
    """

    parents: Array
    offsets: Array
    chain: Array
    joints: Array
    hinges: Array
    points: Array
    bends: Array


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
        frames: The frames.
        legs: The legs.
        arms: The arms.
        hinges: Elbows and knees.
        fists: Place of the left and right fist in the frame's ground frame [m]. Shape (P, 2, 3), float32.
        heads: Centre of the head in the frame's ground frame [m]. Shape (P, 3), float32.
        strikes: Playback frames at which strikes reach furthest, ascending. Shape (S,).
        origins: Playback frame that lies on the avatar when each action starts. Shape (A,).
        lengths: Length of each action [control frames]. Shape (A,).
    """

    skeleton: Skeleton
    body: Body
    frames: Frames
    legs: Limbs
    arms: Limbs
    hinges: Hinges
    fists: Array
    heads: Array
    strikes: Array
    origins: Array
    lengths: Array


def prepare_motion(policy: Policy) -> PoseMotion:
    """Return a policy's motion ready to be posed."""
    database, graph = policy.database, policy.graph
    skeleton, body, stride = database.skeleton, database.body, database.stride
    starts = np.asarray(database.clip_starts, dtype=np.int64) * stride
    headings = quaternion.about_y(-database.ground[:, 2]).astype(np.float32)
    rotations = np.array(database.rotations, dtype=np.float32)
    rotations[:, 0] = quaternion.multiply(headings, rotations[:, 0])
    _align_signs(rotations, starts)
    positions, turns = forward_kinematics(skeleton, database.root_positions, database.rotations, parallel=False)
    feet = [body.roles["left_foot"], body.roles["right_foot"]]
    balls = positions[:, feet] + quaternion.rotate(turns[:, feet], body.sole_offsets[:, 1])
    contacts = np.array(database.contacts, dtype=bool)
    balls[..., [0, 2]] += _calming(balls[..., [0, 2]], contacts, starts, database.playback_rate)
    clip = np.searchsorted(starts, np.arange(starts[-1]), side="right") - 1
    frames = Frames(
        rotations=rotations,
        roots=ground.to_local(database.ground, database.root_positions).astype(np.float32),
        ground=np.array(database.ground, dtype=np.float64),
        contacts=contacts,
        balls=ground.to_local(database.ground[:, None], balls).astype(np.float32),
        bounds=np.stack([starts[clip], starts[clip + 1] - 1], axis=1),
        stride=stride,
        rate=float(database.playback_rate),
    )
    some = slice(None, None, max(1, len(positions) // _SAMPLE))
    sample = positions[some], turns[some]
    bends = np.array([body.roles["spine"], body.roles["chest"]])
    fists = np.repeat(body.fist_offsets[:, None], 2, axis=1)
    return PoseMotion(
        skeleton=skeleton,
        body=body,
        frames=frames,
        legs=_limbs(skeleton, body, ("hip", "knee", "foot"), body.sole_offsets, bends, sample),
        arms=_limbs(skeleton, body, ("shoulder", "elbow", "hand"), fists, bends, sample),
        hinges=_hinges(skeleton, body, positions),
        fists=np.asarray(database.fists),
        heads=np.asarray(database.heads),
        strikes=np.asarray(database.strike_frames, dtype=np.int64),
        origins=(np.asarray(graph.action_first, dtype=np.int64) - 1) * stride,
        lengths=np.asarray(graph.action_lengths, dtype=np.int64),
    )


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
    """Two limbs; ``sample`` holds places and turns of all joints in some poses."""
    joints = np.array([[body.roles[f"{side}_{name}"] for name in names] for side in _SIDES], np.int64)
    places, turns = sample
    hinges = [
        hinge_axis(places[:, upper], places[:, middle], places[:, end], turns[:, upper])
        for upper, middle, end in joints
    ]
    return Limbs(
        parents=np.asarray(skeleton.parents, dtype=np.int64),
        offsets=np.asarray(skeleton.offsets, dtype=np.float64),
        chain=chain_of(skeleton, [*joints[:, 2], *bends]),
        joints=joints,
        hinges=np.stack(hinges),
        points=np.asarray(points, dtype=np.float64),
        bends=bends.astype(np.int64),
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


def _calming(balls: Array, contacts: Array, starts: Array, rate: float) -> Array:
    """How far planted feet go towards the mean place of their contact, eased from one to the next. Shape (P, 2, 2)."""
    ways = np.zeros_like(balls)
    flat, wide = (max(1, round(seconds * rate)) for seconds in _SETTLE)
    ticks = np.abs(np.arange(-wide, wide + 1))
    share = np.clip((ticks - flat) / max(1, wide - flat), 0.0, 1.0)
    kernel = 1.0 - share * share * (3.0 - 2.0 * share)
    for start, stop in pairwise(starts):
        for foot in range(2):
            spans = runs(contacts[start:stop, foot]) + start
            for low, high in spans:
                path = balls[low:high, foot]
                weight = np.convolve(np.ones(len(path)), kernel)[wide : wide + len(path)]
                mean = np.stack([np.convolve(column, kernel)[wide : wide + len(path)] for column in path.T], axis=1)
                speed = float(np.median(np.linalg.norm(np.diff(path, axis=0), axis=1))) * rate if len(path) > 1 else 0.0
                stillness = max(0.0, 1.0 - SKATING / max(speed, 1e-9))
                ways[low:high, foot] = stillness * (mean / weight[:, None] - path)
            edges = [start, *spans.ravel().tolist(), stop]
            for low, high in zip(edges[::2], edges[1::2], strict=True):
                before = ways[low - 1, foot] if low > start else np.zeros(2)
                after = ways[high, foot] if high < stop else np.zeros(2)
                s = (np.arange(low, high) - low + 1.0)[:, None] / (high - low + 1.0)
                ways[low:high, foot] = before + s * s * s * (10.0 - 15.0 * s + 6.0 * s * s) * (after - before)
    return ways

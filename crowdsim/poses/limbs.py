"""The limbs of a body as poses need them: chains of joints, axes of flexion, what the ends hold or strike with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import Body
from crowdsim.motion.limbs import flexion, hinge_axis
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.builds import joint_segments
from crowdsim.poses.kernels.turning import Turning

_FREE, _MORE = np.deg2rad(130.0), np.deg2rad(8.0)
"""Flexion that blends may always give, and what they may give beyond that or the capture's own [rad]."""
_SIDES = ("left", "right")


class Limbs(NamedTuple):
    """Two limbs of a body for compiled code, left and right.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        offsets: Position of each joint in its parent's frame [m]. Shape (J, 3).
        segments: What each joint carries, see ``builds.joint_segments``. Shape (J,).
        chain: Joints from the root to the ends, parents first. Shape (n,).
        sides: Limb that each of these belongs to, -1 of those above both. Shape (n,).
        joints: Upper, middle and end joint. Shape (2, 3).
        hinges: Axis of flexion in the upper joint's frame. Shape (2, 3).
        points: What is moved: heel and ball of each foot, or the fist twice, in the end joint's frame [m]. Shape
            (2, 2, 3).
        bends: Lower and upper joint of the spine that lean for arms, none for legs. Shape (2,) or (0,).
        toes: A joint that hangs on each end joint and turns with the toes, -1 where there is none. Shape (2,).
        holds: Point of each end joint that stays where it is while it holds on to something, in its frame [m]: where
            the toes begin, the ball of the foot where there are none. Shape (2, 3).
    """

    parents: Array
    offsets: Array
    segments: Array
    chain: Array
    sides: Array
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


def chain_of(skeleton: Skeleton, joints: Sequence[int]) -> Array:
    """Return joints and all that they hang on, parents first."""
    found: set[int] = set()
    for joint in joints:
        at = int(joint)
        while at >= 0 and at not in found:
            found.add(at)
            at = int(skeleton.parents[at])
    return np.array(sorted(found), np.int64)


def limbs_among(limbs: Limbs, joints: Array) -> Limbs:
    """Return limbs for a skeleton of some joints (n,), ascending, all that they hang on among them.

    Joints that are not there are -1.
    """

    def places(values: Array) -> Array:
        return np.where(np.isin(values, joints), np.searchsorted(joints, values), -1)

    there = np.isin(limbs.chain, joints)
    return limbs._replace(
        parents=places(limbs.parents[joints]),
        offsets=limbs.offsets[joints],
        segments=limbs.segments[joints],
        chain=places(limbs.chain[there]),
        sides=limbs.sides[there],
        joints=places(limbs.joints),
        bends=places(limbs.bends),
        toes=places(limbs.toes),
    )


def turning_of(
    skeleton: Skeleton, body: Body, shares: Mapping[str, float], axis: Array, of_root: bool = False
) -> Turning:
    """Return which joints between root and head turn about an axis, by shares of their roles, which add up."""
    chain = chain_of(skeleton, [body.roles["head"]])
    each = np.zeros(len(chain))
    for role, part in shares.items():
        each[chain == body.roles[role]] += part
    return Turning(np.asarray(skeleton.parents, dtype=np.int64), chain, each, axis, of_root)


def measure_limbs(
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
    chain = chain_of(skeleton, [*joints[:, 2], *bends])
    sides = np.full(len(chain), -1)
    for side, (upper, _, end) in enumerate(joints):
        sides[np.isin(chain, chain_of(skeleton, [end])) & ~np.isin(chain, chain_of(skeleton, [upper])[:-1])] = side
    return Limbs(
        parents=np.asarray(skeleton.parents, dtype=np.int64),
        offsets=np.asarray(skeleton.offsets, dtype=np.float64),
        segments=joint_segments(skeleton, body),
        chain=chain,
        sides=sides,
        joints=joints,
        hinges=np.stack(hinges),
        points=np.asarray(points, dtype=np.float64),
        bends=bends.astype(np.int64),
        toes=np.array(toes, np.int64),
        holds=np.array(holds, np.float64),
    )


def measure_hinges(skeleton: Skeleton, body: Body, positions: Array) -> Hinges:
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

"""The capsules of posed bodies, side by side for compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.body import PARTS, Body
from crowdsim.poses.builds import capsule_segments
from crowdsim.poses.kernels.capsules import CapsuleBody, Capsules, place_ends
from crowdsim.poses.motion import PoseMotion

_SWELLING = [PARTS.index(part) for part in ("skin", "shirt", "trunks")]


class PosedBodies(NamedTuple):
    """Bodies of one kind; n avatars at T times, J joints.

    Attributes:
        body: What their skeleton is as a body.
        columns: Column of each among all avatars. Shape (n,).
        scales: Size of each. Shape (n,).
        girths: How thick its trunk and limbs are for their length. Shape (n,).
        stretches: How long the bones of its trunk, legs and arms are for its size. Shape (n, 3).
        positions: Of joints in the world [m]. Shape (T, n, J, 3).
        rotations: Of joints in the world. Shape (T, n, J, 4).
    """

    body: Body
    columns: Array
    scales: Array
    girths: Array
    stretches: Array
    positions: Array
    rotations: Array


def swelling_capsules(parts: Array) -> Array:
    """Return which capsules of these parts (K,) are thicker the greater the girth: not head, gloves and shoes."""
    return np.isin(parts, _SWELLING)


def trunk_capsules(body: Body) -> Array:
    """Return which capsules lie along a body's trunk, from the pelvis up; the one across its shoulders is the last."""
    return np.flatnonzero(body.capsule_parts == PARTS.index("shirt"))


def capsule_order(body: Body) -> Array:
    """Return the order of a body's capsules in which one of the pelvis, in the middle of the body, is the first."""
    return np.argsort(body.capsule_joints != body.roles["pelvis"], kind="stable")


def capsule_body(motion: PoseMotion) -> CapsuleBody:
    """Return the joints and capsules of the bodies of a motion, these in ``capsule_order``."""
    body, skeleton = motion.body, motion.skeleton
    order = capsule_order(body)
    return CapsuleBody(
        np.asarray(skeleton.parents, dtype=np.int64),
        np.ascontiguousarray(skeleton.offsets, dtype=np.float32),
        motion.segments,
        body.capsule_joints[order],
        capsule_segments(body)[order],
        np.stack([body.capsule_starts[order], body.capsule_ends[order]]).astype(float),
        np.concatenate([motion.arms.joints, motion.legs.joints]),
    )


def size_capsules(bodies: Sequence[PosedBodies], count: int) -> tuple[Array, Array, Array]:
    """Return radii, bounds and counts of ``Capsules`` of avatars in ``count`` columns, however they are posed."""
    most = max((len(posed.body.capsule_joints) for posed in bodies), default=0)
    radii, bounds, counts = np.zeros((count, most, 2)), np.zeros((count, most)), np.zeros(count, np.int64)
    for posed in bodies:
        body, columns, scales = posed.body, posed.columns, posed.scales
        order = capsule_order(body)
        own, segments = np.arange(len(order)), capsule_segments(body)[order]
        swells = swelling_capsules(body.capsule_parts)[order]
        widths = np.where(swells, posed.girths[:, None], 1.0) * scales[:, None]
        radii[columns[:, None], own] = body.capsule_radii[order] * widths[..., None]
        halves = 0.5 * np.linalg.norm(body.capsule_ends - body.capsule_starts, axis=1)[order]
        halves = halves * np.asarray(scales)[:, None] * posed.stretches[:, segments].astype(scales.dtype)
        bounds[columns[:, None], own] = (halves + body.capsule_radii.max(axis=1)[order] * widths) * 1.001
        counts[columns] = len(order)
    return radii, bounds, counts


def place_capsules(
    bodies: Sequence[PosedBodies],
    times: int,
    count: int,
    threads: int = 1,
    sizes: tuple[Array, Array, Array] | None = None,
) -> Capsules:
    """Return the capsules of avatars at ``times`` times in ``count`` columns, those of each in ``capsule_order``.

    ``sizes`` are what ``size_capsules`` returns of them, where that is known.
    """
    radii, bounds, counts = size_capsules(bodies, count) if sizes is None else sizes
    most = bounds.shape[1]
    whole = sum(len(posed.columns) for posed in bodies if len(posed.body.capsule_joints) == most) == count
    shape = 2, times, count, most, 3
    ends = np.empty(shape, np.float32) if whole else np.full(shape, np.nan, np.float32)
    for posed in bodies:
        body, columns = posed.body, posed.columns
        lengths = np.asarray(posed.scales, dtype=float)[:, None] * posed.stretches
        order = capsule_order(body)
        joints, segments = body.capsule_joints[order], capsule_segments(body)[order]
        offsets = np.stack([body.capsule_starts[order], body.capsule_ends[order]]).astype(float)
        share(len(columns) * times, place_ends, posed.positions, posed.rotations, lengths, joints, segments, offsets,
              columns, ends, threads=threads)  # fmt: skip
    return Capsules(ends[0], ends[1], radii, bounds, counts)

"""Figures: the capsules of a body, on the joints of its skeleton."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crowdsim.body.palette import EYES
from crowdsim.core.types import Array
from crowdsim.motion.body import PARTS, Body
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.builds import capsule_segments
from crowdsim.poses.facing import face_direction
from crowdsim.poses.kernels.columns import TRUNK

_WAIST = 0.05
"""How far trunks reach up from the pelvis, as a share of the body's height."""


class Figure(Protocol):
    """Capsules on the joints of a skeleton; ``crowdsim.motion.body.Body`` is one."""

    @property
    def capsule_joints(self) -> Array:
        """Joint that each capsule rides on. Shape (K,), int32."""

    @property
    def capsule_starts(self) -> Array:
        """One end in that joint's frame [m]. Shape (K, 3)."""

    @property
    def capsule_ends(self) -> Array:
        """The other end [m]. Shape (K, 3)."""

    @property
    def capsule_radii(self) -> Array:
        """Radius at both ends [m]. Shape (K, 2)."""

    @property
    def capsule_parts(self) -> Array:
        """Index into ``crowdsim.motion.body.PARTS`` of each, or ``palette.EYES``. Shape (K,), uint8."""


@dataclass(frozen=True)
class BoneFigure:
    """Capsules along every bone of a skeleton; the attributes are those of ``Figure``."""

    capsule_joints: Array
    capsule_starts: Array
    capsule_ends: Array
    capsule_radii: Array
    capsule_parts: Array


def bone_capsules(skeleton: Skeleton) -> BoneFigure:
    """Return a capsule along every bone and end site of any skeleton, thicker towards the root.

    A joint's weight is the length of all bones beyond it; thickness follows a root of it, so that a trunk is thick
    and fingers are thin whatever the animal. Bones of no length show as spheres.
    """
    count = skeleton.joint_count
    starts = [int(parent) for parent in skeleton.parents[1:]] + [int(parent) for parent in skeleton.end_parents]
    offsets = np.concatenate([np.asarray(skeleton.offsets[1:], float), np.asarray(skeleton.end_offsets, float)])
    lengths = np.linalg.norm(offsets, axis=1) if len(offsets) else np.zeros(0)
    beyond = np.zeros(count)
    for end, parent in enumerate(skeleton.end_parents):
        beyond[parent] += lengths[count - 1 + end]
    for joint in range(count - 1, 0, -1):
        beyond[skeleton.parents[joint]] += beyond[joint] + lengths[joint - 1]
    size = max(float(beyond[0]), 1e-9)
    rest = skeleton.rest_positions()
    extent = max(
        float(np.linalg.norm(rest.max(axis=0) - rest.min(axis=0))), 0.5 * float(lengths.max(initial=0.0)), 1e-3
    )

    def radius(weight: float, length: float) -> float:
        thick = 0.055 * extent * (weight / size) ** 0.4
        return float(np.clip(thick, 0.006 * extent, max(0.45 * length, 0.008 * extent)))

    radii = []
    for index, (start, length) in enumerate(zip(starts, lengths, strict=True)):
        after = beyond[index + 1] if index < count - 1 else 0.0
        near = min(beyond[start], after + length)
        radii.append((radius(near, float(length)), radius(max(after, 0.2 * near), float(length))))
    if not starts:
        starts, offsets, radii = [0], np.zeros((1, 3)), [(0.05, 0.05)]
    return BoneFigure(
        capsule_joints=np.array(starts, np.int32),
        capsule_starts=np.zeros((len(starts), 3)),
        capsule_ends=offsets,
        capsule_radii=np.array(radii, float).reshape(-1, 2),
        capsule_parts=np.full(len(starts), PARTS.index("shirt"), np.uint8),
    )


def dress(figure: Figure) -> Figure:
    """Return a body with trunks to the waist, a headguard in its team's colour, and eyes and a nose where it looks.

    Any other figure comes back as it is.
    """
    if not isinstance(figure, Body):
        return figure
    up, ahead = _unit(figure.head_offset), face_direction(figure)
    joint, centre, radius = figure.roles["head"], figure.head_offset, figure.head_radius
    left = np.cross(up, ahead)
    guard = centre + radius * (0.12 * up - 0.24 * ahead)
    nose = centre + radius * (0.92 * ahead - 0.06 * up)
    # One dark band is seen from further away than two eyes.
    eye = centre + radius * (0.79 * ahead + 0.24 * up)
    across = 0.44 * radius * left
    added = [
        (joint, guard, guard, 1.06 * radius, PARTS.index("glove")),
        (joint, nose, nose + radius * (0.16 * ahead - 0.16 * up), 0.17 * radius, PARTS.index("head")),
        (joint, eye + across, eye - across, 0.19 * radius, EYES),
    ]
    for k in np.flatnonzero(figure.capsule_parts == PARTS.index("shirt")):
        start, way = figure.capsule_starts[k], figure.capsule_ends[k] - figure.capsule_starts[k]
        if figure.capsule_joints[k] == figure.roles["pelvis"] and np.linalg.norm(start) < 0.01:
            # The lower end of the torso would look out of the trunks.
            waist = start + way * min(1.0, _WAIST * figure.height / max(float(np.linalg.norm(way)), 1e-6))
            added.append(
                (figure.roles["pelvis"], start, waist, 1.03 * float(figure.capsule_radii[k, 0]), PARTS.index("trunks"))
            )
    joints, starts, ends, radii, parts = zip(*added, strict=True)
    return BoneFigure(
        capsule_joints=np.append(figure.capsule_joints, joints).astype(np.int32),
        capsule_starts=np.concatenate([figure.capsule_starts, starts]),
        capsule_ends=np.concatenate([figure.capsule_ends, ends]),
        capsule_radii=np.concatenate([figure.capsule_radii, np.repeat(radii, 2).reshape(-1, 2)]),
        capsule_parts=np.append(figure.capsule_parts, parts).astype(np.uint8),
    )


def figure_segments(figure: Figure) -> Array:
    """Return which bones the capsules of a figure lie on once it is dressed, see ``builds.capsule_segments``."""
    found = np.full(len(dress(figure).capsule_joints), TRUNK, np.int64)
    if isinstance(figure, Body):
        found[: len(figure.capsule_joints)] = capsule_segments(figure)
    return found


def _unit(v: Array) -> Array:
    length = float(np.linalg.norm(v))
    return v / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])

"""What stands on the ground: figures of capsules on skeletons, placed by poses and painted by team and avatar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion.body import PARTS
from crowdsim.motion.skeleton import Skeleton
from crowdsim.render.palette import avatar_paints
from crowdsim.render.raycast import Capsules
from crowdsim.render.view_kernels import place_capsules

Array = NDArray[Any]


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
        """Index into ``crowdsim.motion.body.PARTS`` of each. Shape (K,), uint8."""


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

    A joint's weight is the length of all bones beyond it; thickness follows its square root, so that a trunk is thick
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
    size = max(float(beyond[0]), 1e-6)

    def radius(weight: float, length: float) -> float:
        return float(np.clip(0.03 * size**0.5 * weight**0.5 * 0.35, 0.0025 * size, max(0.35 * length, 0.004 * size)))

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


@dataclass(frozen=True)
class Cast:
    """Everything about the avatars that does not change from frame to frame.

    Attributes:
        figures: Figures, one a kind of body.
        members: Avatars of each figure, ascending. Length of ``figures``, each (n,), int32.
        scales: Size of each avatar. Shape (N,).
        paints: Paint of every capsule, in the order of ``place``. Shape (K, 4), float32.
        owners: Avatar of every capsule. Shape (K,), int32.
    """

    figures: tuple[Figure, ...]
    members: tuple[Array, ...]
    scales: Array
    paints: Array
    owners: Array

    def place(self, poses: Sequence[tuple[Array, Array]]) -> Capsules:
        """Return the capsules of one frame.

        Args:
            poses: World positions (n, J, 3) and rotations (n, J, 4) of the members of each figure.
        """
        places = np.empty((len(self.owners), 8), np.float32)
        row = 0
        for figure, avatars, (positions, rotations) in zip(self.figures, self.members, poses, strict=True):
            rows = len(avatars) * len(figure.capsule_joints)
            place_capsules(
                np.ascontiguousarray(positions),
                np.ascontiguousarray(rotations),
                self.scales[avatars],
                figure.capsule_joints,
                figure.capsule_starts,
                figure.capsule_ends,
                figure.capsule_radii,
                places[row : row + rows],
            )
            row += rows
        return Capsules(places, self.paints, self.owners)


def build_cast(
    figures: Sequence[Figure], avatar_figures: Array, teams: Sequence[int] | Array, scales: Array | None = None
) -> Cast:
    """Dress avatars: which figure each has, and which colours.

    Args:
        figures: Kinds of bodies.
        avatar_figures: Index of each avatar's figure. Shape (N,).
        teams: Team of each avatar. Shape (N,).
        scales: Size of each avatar, 1 by default. Shape (N,).
    """
    avatar_figures = np.asarray(avatar_figures)
    by_part = avatar_paints(teams)
    members, paints, owners = [], [], []
    for index, figure in enumerate(figures):
        avatars = np.flatnonzero(avatar_figures == index).astype(np.int32)
        members.append(avatars)
        paints.append(by_part[avatars][:, figure.capsule_parts].reshape(-1, 4))
        owners.append(np.repeat(avatars, len(figure.capsule_joints)))
    return Cast(
        figures=tuple(figures),
        members=tuple(members),
        scales=np.ones(len(avatar_figures)) if scales is None else np.asarray(scales, float),
        paints=np.ascontiguousarray(np.concatenate(paints), dtype=np.float32),
        owners=np.concatenate(owners).astype(np.int32),
    )

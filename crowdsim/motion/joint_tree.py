"""A skeleton as a tree of limbs: chains, mirrored pairs, and which of their joints bend."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.joint_names import plain_names, split_name
from crowdsim.motion.skeleton import Skeleton

_ALIKE = 0.12
"""Share of a limb's longest bone by which the bones of its counterpart may differ."""
_STRAIGHT = np.deg2rad(2.0)
"""A joint that never bends further than this is no elbow and no knee."""
_FIXED, _ROTATES = np.deg2rad(0.1), np.deg2rad(5.0)
"""Rotation against its parent below which a joint carries none, if another joint rotates by more than the second."""
_PARTED = 0.4
"""A joint that only twists lies this share of a limb's longest bone or more from both its neighbours."""


class JointTree:
    """A skeleton with what the search for roles asks for again and again.

    Attributes:
        skeleton: The skeleton, any unit.
        poses: Joint positions of some poses, the rest pose where there are none. Shape (n, J, 3).
        parents: Parent of each joint.
        children: Children of each joint.
        lengths: Length of the bone from each joint's parent; 0 at the root. Shape (J,).
        depth: Way from the root to each joint along the bones. Shape (J,).
        names: Side and words of each joint's name, without a prefix that all have.
        fixed: Which joints keep their rotation against their parents while others rotate. Shape (J,), bool.
    """

    def __init__(self, skeleton: Skeleton, poses: Array | None, rotations: Array | None = None) -> None:
        self.skeleton = skeleton
        self.poses = skeleton.rest_positions()[None] if poses is None or len(poses) == 0 else np.asarray(poses, float)
        self.parents = [int(parent) for parent in skeleton.parents]
        self.lengths = np.linalg.norm(skeleton.offsets, axis=1)
        self.lengths[0] = 0.0
        self.children: list[list[int]] = [[] for _ in self.parents]
        self.depth = np.zeros(len(self.parents))
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                self.children[parent].append(joint)
                self.depth[joint] = self.depth[parent] + self.lengths[joint]
        self.names = [split_name(name) for name in plain_names(skeleton.names)]
        self.fixed = _fixed(skeleton, rotations)
        self._reach = self.depth.copy()
        self._size = np.ones(len(self.parents), int)
        for joint in range(len(self.parents) - 1, 0, -1):
            parent = self.parents[joint]
            self._reach[parent] = max(self._reach[parent], self._reach[joint])
            self._size[parent] += self._size[joint]

    def words(self, joint: int) -> frozenset[str]:
        """Words of a joint's name."""
        return self.names[joint][1]

    def named(self, words: frozenset[str], side: int | None, unless: frozenset[str]) -> list[int]:
        """Joints of a side, None for the middle, whose names hold one of some words and none of others."""
        return [
            joint
            for joint, (its_side, its_words) in enumerate(self.names)
            if its_side == side and its_words & words and not its_words & unless
        ]

    def path(self, joint: int) -> list[int]:
        """Joints from the root to ``joint``, both included."""
        chain = [joint]
        while self.parents[chain[-1]] >= 0:
            chain.append(self.parents[chain[-1]])
        return chain[::-1]

    def below(self, joint: int) -> list[int]:
        """All joints that hang on ``joint``, itself first, nearest first."""
        found = [joint]
        for at in found:
            found.extend(self.children[at])
        return found

    def common(self, joints: list[int]) -> int:
        """The last joint that is on the paths from the root to all of the joints."""
        shared = [at[0] for at in zip(*map(self.path, joints), strict=False) if len(set(at)) == 1]
        return shared[-1]

    def main_chain(self, joint: int) -> list[int]:
        """The chain from ``joint`` to the leaf that lies furthest along the bones."""
        chain = [joint]
        while self.children[chain[-1]]:
            chain.append(max(self.children[chain[-1]], key=lambda at: (self._reach[at], self._size[at], -at)))
        return chain

    def is_nub(self, joint: int) -> bool:
        """Whether a joint only marks where the bone before it ends: a leaf without an end site of its own."""
        if self.children[joint] or not np.any(self.skeleton.end_offsets):
            return False
        ends = self.skeleton.end_offsets[self.skeleton.end_parents == joint]
        scale = max(float(self.lengths[joint]), 1e-9)
        return bool(len(ends) == 0 or np.linalg.norm(ends, axis=1).max() < 1e-3 * scale)

    def bend(self, before: int, joint: int, after: int) -> float:
        """The furthest that the path before - joint - after departs from a straight line [rad]."""
        into, out = self.poses[:, joint] - self.poses[:, before], self.poses[:, after] - self.poses[:, joint]
        cross = np.linalg.norm(np.cross(into, out), axis=-1)
        return float(np.arctan2(cross, np.sum(into * out, axis=-1)).max())

    def limb(self, joint: int) -> list[int]:
        """The main chain without joints that part a bone in two: those on which it never bends, far from both ends."""
        chain = self.main_chain(joint)
        long = _PARTED * float(self.lengths[chain].max())
        kept = [chain[0]]
        for index in range(1, len(chain) - 1):
            at, after = chain[index], chain[index + 1]
            parts = self.depth[at] - self.depth[kept[-1]] > long and self.lengths[after] > long
            if not parts or self.bend(kept[-1], at, after) > _STRAIGHT:
                kept.append(at)
        kept.extend(chain[-1:] if len(chain) > 1 else [])
        # Where hardly anything bends (a single T-pose) straightness has no meaning.
        return kept if len(kept) >= 4 or len(kept) == len(chain) else chain

    def mirrored_pairs(self) -> list[tuple[int, int]]:
        """Pairs of brothers whose chains begin with three bones of the same lengths, longest chains first."""
        pairs = []
        for brothers in self.children:
            chains = {joint: self.main_chain(joint) for joint in brothers} if len(brothers) > 1 else {}
            for index, a in enumerate(brothers[:-1]):
                for b in brothers[index + 1 :]:
                    count = min(len(chains[a]), len(chains[b]), 4)
                    if count < 3:
                        continue
                    ours, theirs = self.lengths[chains[a][:count]], self.lengths[chains[b][:count]]
                    scale = max(float(ours.max()), 1e-9)
                    if np.abs(ours - theirs).max() < _ALIKE * scale and scale > 1e-6 * max(self._reach[0], 1e-9):
                        pairs.append((float(ours.sum()), a, b))
        pairs.sort(key=lambda pair: -pair[0])
        return [(a, b) for _, a, b in pairs]

    def path_length(self, start: int, end: int) -> float:
        """Length of the bones between two joints, through their nearest common ancestor."""
        return float(self.depth[start] + self.depth[end] - 2.0 * self.depth[self.common([start, end])])


def _fixed(skeleton: Skeleton, rotations: Array | None) -> Array:
    """Return which joints never rotate against their parents in some poses (n, J, 4) in which others do. Shape (J,)."""
    if rotations is None or len(rotations) < 2:
        return np.zeros(skeleton.joint_count, bool)
    local = quaternion.multiply(quaternion.conjugate(rotations[:, skeleton.parents]), rotations)
    local[:, skeleton.parents < 0] = rotations[:, skeleton.parents < 0]
    dots = np.abs(np.sum(local * local[:1], axis=-1)).min(axis=0)
    angles = 2.0 * np.arccos(np.clip(dots, 0.0, 1.0))
    return np.asarray((angles < _FIXED) & (angles.max() > _ROTATES))

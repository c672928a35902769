"""Several people who hang on one root."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.capture.columns import with_joints
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Skeleton

_LEAST_JOINTS = 10
"""A body has at least so many joints."""


class People:
    """Bodies that are branches of one tree: each of them has arms, legs and a head."""

    name = "people"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Look for a joint with several whole bodies below it."""
        skeleton = reading.raw.skeleton
        if skeleton.joint_count < 2 * _LEAST_JOINTS:
            return None
        tree = JointTree(skeleton, None)
        at = 0
        while True:
            branches = [tree.below(child) for child in tree.children[at]]
            bodies = [sorted(branch) for branch in branches if _is_body(reading, branch)]
            if len(bodies) != 1:
                break
            at = bodies[0][0]
        if len(bodies) < 2:
            return None
        names = ", ".join(repr(skeleton.names[body[0]]) for body in bodies)
        first = sorted({*tree.path(at), *bodies[0]})
        return Diagnosis(
            self.name,
            f"{len(bodies)} people hang on one root: {names}",
            0.97,
            "repair",
            "the first one is read; give each a ROOT of its own to use all",
            lambda: replace(reading, bvh=with_joints(reading.bvh, np.array(first))),
        )


def _is_body(reading: Reading, branch: list[int]) -> bool:
    """Whether the joints of a branch, its first one before all others, are a human body."""
    if len(branch) < _LEAST_JOINTS:
        return False
    joints = sorted(branch)
    skeleton = reading.raw.skeleton
    place = {joint: index for index, joint in enumerate(joints)}
    parents = [place.get(int(skeleton.parents[joint]), -1) for joint in joints]
    ends = np.isin(skeleton.end_parents, joints)
    part = Skeleton(
        names=tuple(skeleton.names[joint] for joint in joints),
        parents=np.array(parents, np.int32),
        offsets=skeleton.offsets[joints],
        end_parents=np.array([place[int(joint)] for joint in skeleton.end_parents[ends]], np.int32),
        end_offsets=skeleton.end_offsets[ends],
    )
    return bool(find_roles(part, reading.poses[:, joints]))

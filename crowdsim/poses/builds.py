"""Builds: which bones are longer in avatars with longer legs or arms, and what rides on these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton
from crowdsim.poses.kernels.columns import ARM, LEG, TRUNK

_UPPER = {"hip": LEG, "shoulder": ARM}
_MIDDLE = {"knee": LEG, "elbow": ARM}
_ENDS = ("foot", "hand")
_SIDES = ("left", "right")


def joint_segments(skeleton: Skeleton, body: Body) -> Array:
    """Return the segment that hangs on each joint, whose bones its offsets to its children are. Shape (J,), int64.

    It is ``LEG`` from a hip down to the foot, ``ARM`` from a shoulder down to the hand, and ``TRUNK`` everywhere else:
    feet and hands are as large as the body, however long its legs and arms.
    """
    starts = {body.roles[f"{side}_{role}"]: segment for side in _SIDES for role, segment in _UPPER.items()}
    ends = {body.roles[f"{side}_{role}"] for side in _SIDES for role in _ENDS}
    segments = np.full(skeleton.joint_count, TRUNK, np.int64)
    for joint, parent in enumerate(skeleton.parents):
        if joint not in ends:
            segments[joint] = starts.get(joint, segments[parent] if parent >= 0 else TRUNK)
    return segments


def capsule_segments(body: Body) -> Array:
    """Return the segment of each capsule of a body. Shape (K,), int64."""
    segments = {
        body.roles[f"{side}_{role}"]: segment for side in _SIDES for role, segment in (_UPPER | _MIDDLE).items()
    }
    return np.array([segments.get(int(joint), TRUNK) for joint in body.capsule_joints], np.int64)


def build_skeleton(skeleton: Skeleton, segments: Array, sizes: Array) -> Skeleton:
    """Return the skeleton of an avatar.

    Args:
        skeleton: The skeleton of its motion.
        segments: What each joint carries. Shape (J,).
        sizes: Size of the bones of its trunk, legs and arms. Shape (3,).
    """
    parents = np.asarray(skeleton.parents)
    return replace(
        skeleton,
        offsets=skeleton.offsets * np.where(parents >= 0, sizes[segments[parents]], sizes[TRUNK])[:, None],
        end_offsets=skeleton.end_offsets * sizes[segments[np.asarray(skeleton.end_parents)]][:, None],
    )

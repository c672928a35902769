"""Elbows that fold backward in a file, as no body's do, and the same motion with them corrected to fold forward.

Some conversions of capture lose the sense in which an elbow flexes: the upper arm is where it was, and the forearm,
which should come forward, goes back. In the rest pose, where no joint is rotated, arms point sideways or down, and an
elbow that folds brings the hand forward, or up where palms look ahead, but never back and down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from crowdsim.capture.evidence import SIDES, unit
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import rests_like_a_body
from crowdsim.motion.skeleton import Clip, Skeleton

_BENT = np.sin(np.deg2rad(20.0))
"""Sine of the flexion from which on the axis of an elbow can be measured."""
_LEAST = 0.3
"""Time that it has to be bent [s]."""
_ONE_AXIS = 0.9
"""Length of the mean of unit axes above which they are one."""
_BACKWARD = 0.5
"""How plainly a forearm has to go back and down, 1 wholly."""


def backward_elbows(clip: Clip, roles: Mapping[str, int]) -> tuple[str, ...]:
    """Return the roles of elbows that fold backward throughout a clip: "left_elbow", "right_elbow", both or none.

    Args:
        clip: The clip, y up; all its numbers finite.
        roles: Its joints by role. Nothing is changed where the rest pose is no pose of a body.
    """
    if not clip.frame_count or not roles or not rests_like_a_body(clip.skeleton, roles):
        return ()
    rest = clip.skeleton.rest_positions()
    # Some files rotate the world and not the rest pose: the body itself shows which direction is up.
    hips = [rest[roles[f"{side}_hip"]] for side in SIDES]
    up = unit(rest[roles["head"]] - 0.5 * (hips[0] + hips[1]))
    forward = unit(np.cross(hips[0] - hips[1], up))
    positions, world_rotations = clip_kinematics(clip)
    found = []
    for side in SIDES:
        shoulder, elbow, hand = (roles[f"{side}_{role}"] for role in ("shoulder", "elbow", "hand"))
        upper, lower = (unit(positions[:, b] - positions[:, a]) for a, b in ((shoulder, elbow), (elbow, hand)))
        axes = np.cross(upper, lower)
        bent = np.linalg.norm(axes, axis=1) > _BENT
        if np.count_nonzero(bent) < _LEAST * clip.fps:
            continue
        back = quaternion.conjugate(world_rotations[bent, clip.skeleton.parents[elbow]])
        axis = unit(quaternion.rotate(back, axes[bent])).mean(axis=0)
        along = _along(clip.skeleton, shoulder, elbow)
        # Forward and up, as far as they are square to the arm.
        ahead = forward + up
        ahead = unit(ahead - np.dot(ahead, along) * along)
        if np.linalg.norm(axis) > _ONE_AXIS and np.dot(unit(np.cross(axis, along)), ahead) < -_BACKWARD:
            found.append(f"{side}_elbow")
    return tuple(found)


def fold_forward(clip: Clip, roles: Mapping[str, int], elbows: Sequence[str]) -> Clip:
    """Return the clip with the elbows of some roles flexed in the opposite sense by as much; forearms keep twist."""
    rotations = np.array(clip.rotations)
    for role in elbows:
        along = _along(clip.skeleton, roles[role.replace("elbow", "shoulder")], roles[role])
        # Rotation by 180 degrees about the upper arm, before and after: twist about it stays, flexion changes its sign.
        vector = rotations[:, roles[role], 1:]
        rotations[:, roles[role], 1:] = 2.0 * (vector @ along)[:, None] * along - vector
    return replace(clip, rotations=rotations)


def _along(skeleton: Skeleton, start: int, end: int) -> Array:
    """Direction between two joints in the rest pose."""
    rest = skeleton.rest_positions()
    return unit(rest[end] - rest[start])

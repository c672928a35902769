"""The human body of a clip: its roles, and the pose in which it is measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import Body, build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Clip, Skeleton

_SAMPLES = 64
"""Poses looked at to find roles, axes and a standing pose."""


def sample_poses(clip: Clip) -> tuple[Array, Array]:
    """Return positions (n, J, 3) and rotations (n, J, 4) in the world of a few frames, spread over the clip.

    Frames in which a number is not finite are left out, so that n may be 0.
    """
    frames = np.flatnonzero(finite_frames(clip))
    if len(frames) > _SAMPLES:
        frames = frames[np.linspace(0, len(frames) - 1, _SAMPLES).astype(int)]
    moved = None if clip.translations is None else clip.translations[frames]
    return forward_kinematics(clip.skeleton, clip.root_positions[frames], clip.rotations[frames], moved)


def finite_frames(clip: Clip) -> Array:
    """Return in which frames every number is finite. Shape (F,), bool."""
    finite = np.isfinite(clip.root_positions).all(axis=1) & np.isfinite(clip.rotations).all(axis=(1, 2))
    if clip.translations is not None:
        finite &= np.isfinite(clip.translations).all(axis=(1, 2))
    return np.asarray(finite)


def measure_body(clip: Clip, roles: Mapping[str, int] | None = None) -> Body:
    """Measure the body of a clip in metres, y up, in its rest pose where that is a body's, else as it stands best.

    Args:
        clip: The clip.
        roles: Joints by role, found when None.

    Raises:
        MotionError: The skeleton is no human body.
    """
    if roles is None:
        roles = find_roles(clip.skeleton, sample_poses(clip)[0])
    if not roles or rests_like_a_body(clip.skeleton, roles):
        return build_body(clip.skeleton, roles)
    positions, rotations = sample_poses(clip)
    if len(positions) == 0:
        return build_body(clip.skeleton, roles)
    feet = 0.5 * (positions[:, roles["left_foot"], 1] + positions[:, roles["right_foot"], 1])
    frame = int(np.argmax(positions[:, roles["head"], 1] - feet))
    return build_body(clip.skeleton, roles, (positions[frame], rotations[frame]))


def rests_like_a_body(skeleton: Skeleton, roles: Mapping[str, int]) -> bool:
    """Return whether legs and trunk run opposite ways in the rest pose, and feet stand off from the shanks."""
    rest = skeleton.rest_positions()

    def way(start: str, end: str) -> Array:
        vector = rest[roles[end]] - rest[roles[start]]
        return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))

    for side in ("left", "right"):
        if np.dot(way("spine", "head"), way(f"{side}_hip", f"{side}_foot")) > -0.8:
            return False
        if (
            f"{side}_toe" in roles
            and np.dot(way(f"{side}_knee", f"{side}_foot"), way(f"{side}_foot", f"{side}_toe")) > 0.9
        ):
            return False
    return True


def human_roles(skeleton: Skeleton, poses: Array) -> dict[str, int]:
    """Return the roles of joints of what moves like a human; empty where it is no human body.

    Args:
        skeleton: The skeleton, in any unit and orientation.
        poses: Joint positions of some poses of its motion in the same unit. Shape (n, J, 3).
    """
    roles = find_roles(skeleton, poses)
    return roles if roles and _is_upright(skeleton, roles, poses) else {}


def _is_upright(skeleton: Skeleton, roles: Mapping[str, int], poses: Array) -> bool:
    """Whether the trunk goes on where the legs end, as in anyone who stands, and does not lie across them."""
    aligned = []
    groups = [poses] if len(poses) else []
    if rests_like_a_body(skeleton, roles) or not groups:
        groups.append(skeleton.rest_positions()[None])
    for group in groups:
        hips = 0.5 * (group[:, roles["left_hip"]] + group[:, roles["right_hip"]])
        feet = 0.5 * (group[:, roles["left_foot"]] + group[:, roles["right_foot"]])
        shoulders = 0.5 * (group[:, roles["left_shoulder"]] + group[:, roles["right_shoulder"]])
        legs, trunk = hips - feet, shoulders - hips
        scale = np.linalg.norm(legs, axis=-1) * np.linalg.norm(trunk, axis=-1)
        aligned.append(float(np.median(np.sum(legs * trunk, axis=-1) / np.maximum(scale, 1e-12))))
    return max(aligned) > 0.6

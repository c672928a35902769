"""The human body of a clip: its roles, the pose in which it is measured, and where its motion begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.motion.body import HEIGHT, Body, build_body
from crowdsim.motion.kinematics import clip_kinematics, forward_kinematics
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Clip, Skeleton
from crowdsim.motion.tracks import build_tracks

_SAMPLES = 64
"""Poses looked at to find roles, axes and a standing pose."""
IMPLAUSIBLE_SPEED = 15.0
"""Speed of a fist relative to the pelvis that no body of ``HEIGHT`` reaches [m/s]: a jump out of a calibration pose."""
_LEAD_IN, _SETTLE = 0.2, 0.04
"""Time after a calibration pose in which jumps still belong to it, and time cut off after the last of them [s]."""
_LEVEL, _OBLIQUE, _STRAIGHT = 0.9, 0.45, 0.93
"""Least sideways part of the arms in a T-pose and in an A-pose, and least stretch of arms in either, as shares."""
_STILL = 0.15
"""Fist speed relative to the pelvis under which an A-pose is held and no part of a movement, for ``HEIGHT`` [m/s]."""
_LOOK_AHEAD = 2.0
"""Time posed at first to find the end of a calibration pose [s]; longer while it goes on."""


@dataclass(frozen=True)
class MeasuredClip:
    """A clip with the body that moves in it.

    Attributes:
        clip: The motion as it was recorded, in metres, y up; every number is finite.
        body: The body on its skeleton, with the joint of each role.
        lead_in: Frames at the start that are a calibration pose and the jump out of it.
    """

    clip: Clip
    body: Body
    lead_in: int = 0


def measure_clips(clips: Sequence[Clip]) -> list[MeasuredClip]:
    """Measure clips of one skeleton: the body of the first is that of all.

    Raises:
        MotionError: A clip is not finite, or its skeleton is no human body.
    """
    measured: list[MeasuredClip] = []
    for clip in clips:
        body = measured[0].body if measured else measure_body(clip)
        bad = np.flatnonzero(~finite_frames(clip))
        if len(bad):
            raise MotionError(f"clip {clip.name!r} is not finite in frame {bad[0]}, and in {len(bad)} frames in all")
        measured.append(MeasuredClip(clip, body, lead_in(clip, body)))
    return measured


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
    """Measure the body of a clip in metres, y up, in its rest pose if that is a body's, else in its most upright pose.

    Args:
        clip: The clip.
        roles: Joints by role, found when None.

    Raises:
        MotionError: The skeleton is no human body.
    """
    if roles is None:
        roles = find_roles(clip.skeleton, *sample_poses(clip))
    if not roles or rests_like_a_body(clip.skeleton, roles):
        return build_body(clip.skeleton, roles)
    positions, rotations = sample_poses(clip)
    if len(positions) == 0:
        return build_body(clip.skeleton, roles)
    feet = 0.5 * (positions[:, roles["left_foot"], 1] + positions[:, roles["right_foot"], 1])
    frame = int(np.argmax(positions[:, roles["head"], 1] - feet))
    return build_body(clip.skeleton, roles, (positions[frame], rotations[frame]))


def rests_like_a_body(skeleton: Skeleton, roles: Mapping[str, int]) -> bool:
    """Return whether the rest pose has legs and trunk in opposite directions, and feet at an angle to the shanks."""
    rest = skeleton.rest_positions()

    def direction(start: str, end: str) -> Array:
        vector = rest[roles[end]] - rest[roles[start]]
        return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))

    for side in ("left", "right"):
        if np.dot(direction("spine", "head"), direction(f"{side}_hip", f"{side}_foot")) > -0.8:
            return False
        if (
            f"{side}_toe" in roles
            and np.dot(direction(f"{side}_knee", f"{side}_foot"), direction(f"{side}_foot", f"{side}_toe")) > 0.9
        ):
            return False
    return True


def human_roles(skeleton: Skeleton, poses: Array, rotations: Array | None = None) -> dict[str, int]:
    """Return the roles of joints of what moves like a human; empty where it is no human body.

    Args:
        skeleton: The skeleton, in any unit and orientation.
        poses: Joint positions of some poses of its motion in the same unit. Shape (n, J, 3).
        rotations: Rotations of the joints in the world in these poses. Shape (n, J, 4).
    """
    roles = find_roles(skeleton, poses, rotations)
    return roles if roles and _is_upright(skeleton, roles, poses) else {}


def _is_upright(skeleton: Skeleton, roles: Mapping[str, int], poses: Array) -> bool:
    """Whether the trunk goes on where the legs end, as in any upright body, and is not at an angle to them."""
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


def lead_in(clip: Clip, body: Body) -> int:
    """Return how many frames at the start are a calibration pose and the jump out of it; 0 where there is none.

    A T-pose has both arms straight and level to the sides, an A-pose has them straight, lower, symmetric and still;
    exporters put one in front of the capture, and some blend from it for a few frames. A clip that is nothing but a
    calibration pose is left whole.
    """
    count = clip.frame_count
    if count < 2:
        return 0
    window = max(2, round(_LEAD_IN * clip.fps))
    look = round(_LOOK_AHEAD * clip.fps) + window
    while True:
        part = clip.sliced(0, min(look, count))
        held, _, _, steps = _calibration(part, body)
        end = int(np.argmin(held)) if not held.all() else part.frame_count
        if end + window < part.frame_count or part.frame_count == count:
            break
        look *= 2
    if end == count:
        return 0
    jumps = np.flatnonzero(steps[: end + window] * clip.fps > IMPLAUSIBLE_SPEED * body.height / HEIGHT)
    if len(jumps):
        end = max(end, int(jumps[-1]) + 1)
    return min(end + round(_SETTLE * clip.fps), count - 1) if end else 0


def tee_poses(clip: Clip, body: Body) -> tuple[Array, Array]:
    """Return in which frames a body is in a T-pose, and in which its fists keep still. Shape (F,) each, bool."""
    _, slow, tee, _ = _calibration(clip, body)
    return tee, slow


def _calibration(clip: Clip, body: Body) -> tuple[Array, Array, Array, Array]:
    """Frames (F,) in a calibration pose, with slow fists, and in a T-pose; steps (F - 1,) of the faster fist [m]."""
    positions, rotations = clip_kinematics(clip)
    tracks = build_tracks(body, positions, rotations)
    relative = tracks.fists - tracks.pelvises[:, None]
    steps = np.linalg.norm(np.diff(relative, axis=0), axis=-1).max(axis=1, initial=0.0)
    elbows = positions[:, [body.roles["left_elbow"], body.roles["right_elbow"]]]
    lengths = np.linalg.norm(elbows - tracks.shoulders, axis=-1) + np.linalg.norm(tracks.fists - elbows, axis=-1)
    across = tracks.shoulders[:, 0] - tracks.shoulders[:, 1]
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    arms = (tracks.fists - tracks.shoulders) / np.maximum(lengths, 1e-9)[..., None]
    sideways = np.sum(arms * across[:, None] * np.array([1.0, -1.0])[:, None], axis=-1)
    straight = (np.linalg.norm(arms, axis=-1) > _STRAIGHT).all(axis=1)
    ahead = np.cross(across, [0.0, 1.0, 0.0])
    level = np.abs(np.sum(arms * ahead[:, None], axis=-1)).max(axis=1) < 0.3
    even = np.abs(arms[:, 0, 1] - arms[:, 1, 1]) < 0.1
    slow = np.concatenate([steps, steps[-1:]])[: len(straight)] * clip.fps < _STILL * body.height / HEIGHT
    tee = straight & (sideways > _LEVEL).all(axis=1)
    return tee | (straight & level & even & slow & (sideways > _OBLIQUE).all(axis=1)), slow, tee, steps

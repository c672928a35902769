"""What capture needs before it is motion: lead-in T-poses cut off, the floor at zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import HEIGHT, Body
from crowdsim.motion.contacts import find_floor
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.tracks import build_tracks

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
        held, steps = _calibration(part, body)
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


def _calibration(clip: Clip, body: Body) -> tuple[Array, Array]:
    """Frames (F,) in a calibration pose, and the longer way (F - 1,) of the two fists in each step [m]."""
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
    return tee | (straight & level & even & slow & (sideways > _OBLIQUE).all(axis=1)), steps


def on_floor(clip: Clip, body: Body) -> tuple[Clip, float]:
    """Return the clip moved so that its planted soles stand at y = 0, and how high the floor lay before [m]."""
    positions, rotations = clip_kinematics(clip)
    floor = find_floor(build_tracks(body, positions, rotations), clip.fps)
    lift = np.array([0.0, -floor, 0.0])
    moved = clip.translations
    if moved is not None:
        moved = moved.copy()
        moved[:, 0] += lift
    return replace(clip, root_positions=clip.root_positions + lift, translations=moved), floor

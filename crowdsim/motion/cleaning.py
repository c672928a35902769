"""What capture needs before it is motion: lead-in T-poses cut off, the floor at zero."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion.body import HEIGHT, Body
from crowdsim.motion.contacts import find_floor
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.tracks import build_tracks

Array = NDArray[Any]

IMPLAUSIBLE_SPEED = 15.0
"""Speed of a fist relative to the pelvis that no body of ``HEIGHT`` reaches [m/s]: a jump out of a calibration pose."""
_LEAD_IN, _SETTLE = 0.2, 0.04
"""Time after a calibration pose in which jumps still belong to it, and time cut off after the last of them [s]."""


def lead_in(clip: Clip, body: Body) -> int:
    """Return how many frames at the start are a calibration pose and the jump out of it; 0 where there is none.

    A T-pose has both arms straight and level to the sides; exporters put it in front of the capture, and some blend
    from it for a few frames. A clip that is nothing but a T-pose is left whole.
    """
    positions, rotations = clip_kinematics(clip)
    tracks = build_tracks(body, positions, rotations)
    arms = tracks.fists - tracks.shoulders
    across = tracks.shoulders[:, 0] - tracks.shoulders[:, 1]
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    lengths = np.linalg.norm(arms, axis=-1)
    sideways = np.sum(arms * across[:, None] * np.array([1.0, -1.0])[:, None], axis=-1)
    tee = ((sideways > 0.9 * lengths) & (lengths > 0.3 * body.height)).all(axis=1)
    end = int(np.argmin(tee)) if not tee.all() else 0
    steps = np.linalg.norm(np.diff(tracks.fists - tracks.pelvises[:, None], axis=0), axis=-1).max(axis=1, initial=0.0)
    window = steps[: end + max(2, round(_LEAD_IN * clip.fps))] * clip.fps
    jumps = np.flatnonzero(window > IMPLAUSIBLE_SPEED * body.height / HEIGHT)
    if len(jumps):
        end = max(end, int(jumps[-1]) + 1)
    if end == 0:
        return 0
    return min(end + round(_SETTLE * clip.fps), clip.frame_count - 1)


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

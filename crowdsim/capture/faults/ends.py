"""Frames at the start and the end of a file that are no motion: other poses, frozen ones, calibration at the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import lead_in
from crowdsim.motion.skeleton import Clip

_NEAR = 0.5
"""Time from an end within which a jump separates a pose from the motion [s]."""
_JUMP = 0.25
"""Shift of a hand or a foot against the pelvis in one frame that is one, for a body of ``HEIGHT`` [m] ..."""
_FASTEST = 22.0
"""... and its speed [m/s]."""
_FROZEN = 0.3
"""Time for which a file has to hold one frame at an end for that to be no motion [s]."""


class Ends:
    """Frames before the motion begins or after it has ended."""

    name = "ends"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Look at both ends of the clip; a calibration pose at its start is cut off anyway."""
        body, clip = reading.body, reading.clip
        if body is None or not reading.finite or clip.frame_count < 4:
            return None
        backward = _reversed(clip)
        starts = {"a pose before a jump": _jump(clip, reading), "a frozen pose": _frozen(reading.bvh.motion, clip.fps)}
        ends = {
            "a pose after a jump": _jump(backward, reading),
            "a frozen pose": _frozen(reading.bvh.motion[::-1], clip.fps),
            "a calibration pose": lead_in(backward, body),
        }
        first, last = max(starts.values()), max(ends.values())
        if first <= lead_in(clip, body):
            first = 0
        if (not first and not last) or first + last > clip.frame_count - 2:
            return None
        parts = []
        if first:
            parts.append(f"{_count(first)} at the start are {max(starts, key=lambda name: starts[name])}")
        if last:
            parts.append(f"{_count(last)} at the end are {max(ends, key=lambda name: ends[name])}")
        lost = np.zeros(clip.frame_count, bool) if reading.lost is None else reading.lost.copy()
        lost[:first] = True
        lost[clip.frame_count - last :] = True
        return Diagnosis(
            self.name, " and ".join(parts), 0.95, "leave_out", "they are left out", lambda: replace(reading, lost=lost)
        )


def _count(frames: int) -> str:
    return "1 frame" if frames == 1 else f"{frames} frames"


def _jump(clip: Clip, reading: Reading) -> int:
    """Frames before the last jump of a hand or a foot near the start."""
    assert reading.body is not None
    part = clip.sliced(0, min(clip.frame_count, round(_NEAR * clip.fps) + 2))
    size = reading.body.height / HEIGHT
    positions = clip_kinematics(part)[0]
    roles = reading.roles
    limbs = [roles[f"{side}_{end}"] for side in ("left", "right") for end in ("hand", "foot")]
    relative = positions[:, limbs] - positions[:, [roles["pelvis"]]]
    steps = np.linalg.norm(np.diff(relative, axis=0), axis=-1).max(axis=1)
    jumps = np.flatnonzero(steps > size * max(_JUMP, _FASTEST / clip.fps))
    return int(jumps[-1]) + 1 if len(jumps) and len(jumps) < len(steps) // 4 + 1 else 0


def _frozen(motion: Array, fps: float) -> int:
    """Frames of rows that all equal the first one, but for the last of them; 0 where they are few."""
    moved = (motion != motion[0]).any(axis=1)
    if not moved.any():
        return 0
    held = int(np.argmax(moved)) - 1
    return held if held >= _FROZEN * fps else 0


def _reversed(clip: Clip) -> Clip:
    moved = clip.translations
    return replace(
        clip,
        root_positions=clip.root_positions[::-1],
        rotations=np.ascontiguousarray(quaternion.continuous(clip.rotations[::-1])),
        translations=None if moved is None else np.ascontiguousarray(moved[::-1]),
    )

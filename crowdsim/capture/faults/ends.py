"""Frames that are no motion: other poses and frozen ones at the ends of a file, and calibration poses in between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT, Body
from crowdsim.motion.contacts import runs
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import lead_in, tee_poses
from crowdsim.motion.skeleton import Clip

_NEAR = 0.5
"""Time from an end within which a jump separates a pose from the motion [s]."""
_JUMP = 0.25
"""Shift of a hand or a foot against the pelvis in one frame that is one, for a body of ``HEIGHT`` [m] ..."""
_FASTEST = 22.0
"""... and its speed [m/s]."""
_FROZEN = 0.3
"""Time for which a file has to hold one frame at an end for that to be no motion [s]."""
_HOLDS, _WAY = 0.5, 0.3
"""Time for which a T-pose in the middle is held, at the least, and that of the ways to it and back [s]."""
_BLEND, _LATE, _MORE = 1.0, 0.75, 1.4
"""Longest time of a blend from a calibration pose [s], a share of its way, and how much longer the whole takes."""
_TURNS, _LEAVES = np.deg2rad([8.0, 60.0])
"""How far joints turn in a blend to count, and the joint of an arm that turns most, at the least [rad]."""
_JOINTS, _APART = 4, 0.12
"""How many joints that are no arms turn in it, at the least, and how far the shares of their ways that they have gone
are from that of all, in the median and at most: in a blend they go in step, which no body does."""


class Ends:
    """Frames before the motion begins or after it has ended, and calibration poses in between."""

    name = "ends"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Look at both ends of the clip, and for T-poses; a calibration pose at its start is cut off anyway."""
        body, clip = reading.body, reading.clip
        if body is None or not reading.finite or clip.frame_count < 4:
            return None
        backward = _reversed(clip)
        starts = {
            "a pose before a jump": _jump(clip, reading),
            "a frozen pose": _frozen(reading.bvh.motion, clip.fps),
            "a blend from a calibration pose": _blended(clip, reading),
        }
        ends = {
            "a pose after a jump": _jump(backward, reading),
            "a frozen pose": _frozen(reading.bvh.motion[::-1], clip.fps),
            "a calibration pose": lead_in(backward, body),
            "a blend to a calibration pose": _blended(backward, reading),
        }
        first, last = max(starts.values()), max(ends.values())
        if first <= lead_in(clip, body):
            first = 0
        held = _held(clip, body, first, last)
        if not (first or last or held) or first + last > clip.frame_count - 2:
            return None
        parts = []
        if first:
            parts.append(f"{_count(first)} at the start are {max(starts, key=lambda name: starts[name])}")
        if last:
            parts.append(f"{_count(last)} at the end are {max(ends, key=lambda name: ends[name])}")
        if held:
            frames = ", ".join(f"{a} to {b - 1}" for a, b in held)
            parts.append(f"frames {frames} are a calibration pose")
        lost = np.zeros(clip.frame_count, bool) if reading.lost is None else reading.lost.copy()
        for start, stop in held:
            lost[start:stop] = True
        lost[:first] = True
        lost[clip.frame_count - last :] = True
        return Diagnosis(
            self.name, " and ".join(parts), 0.95, "leave_out", "they are left out", lambda: replace(reading, lost=lost)
        )


def _held(clip: Clip, body: Body, first: int, last: int) -> list[tuple[int, int]]:
    """First frame, and the one behind the last, of calibration poses between the ends, with ways to them and back."""
    begun = max(first, lead_in(clip, body))
    way, stop = round(_WAY * clip.fps), clip.frame_count - last
    tee, slow = tee_poses(clip, body)
    least = _HOLDS * clip.fps
    spans = [(a, b) for a, b in runs(tee) if b - a >= least and begun < a and b < stop and slow[a:b].mean() > 0.5]
    return [(max(a - way, begun), min(b + way, stop)) for a, b in spans]


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


def _blended(clip: Clip, reading: Reading) -> int:
    """Frames at the start in which all joints turn from a calibration pose to the motion in step; 0 without such."""
    assert reading.body is not None
    held = lead_in(clip, reading.body)
    if not held:
        return 0
    rotations = clip.rotations[: held + round(_BLEND * clip.fps)]
    turned = 2.0 * np.arccos(np.minimum(np.abs(np.einsum("fjc,jc->fj", rotations, rotations[0])), 1.0))
    arms = [joint for role, joint in reading.roles.items() if role.endswith(("shoulder", "elbow", "hand"))]
    others = ~np.isin(np.arange(turned.shape[1]), arms)
    for end in range(len(turned) - 1, held, -1):
        turn = turned[end] > _TURNS
        shares = turned[:end] / np.maximum(turned[end], 1e-9)
        middle = np.median(shares[:, turn], axis=1) if turn.any() else np.zeros(end)
        apart = np.abs(shares[:, turn & others] - middle[:, None])
        leaves = turned[end, arms].max() > _LEAVES and apart.shape[1] >= _JOINTS
        if leaves and np.median(apart, axis=1).max() < _APART:
            # The motion may go on slowly behind it.
            begun = int(np.argmax(middle > 0.0)) - 1
            late = int(np.argmax(middle > _LATE)) - 1 if middle.max() > _LATE else end
            return min(begun + 1 + round(_MORE * (late - begun)), clip.frame_count)
    return 0


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

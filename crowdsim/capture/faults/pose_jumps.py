"""Poses that do not go on from the frame before: clips that were joined or cut, and frames that hold another pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.capture.turning import AROUND, pose_jumps

_SHORTEST = 1.0
"""What lies between two jumps for less than this time is no motion of its own [s]."""
_MOST = 0.02
"""Share of all frames with jumps above which nothing is certain about the motion."""
_SHOWN = 4


class PoseJumps:
    """Frames in which the whole pose is suddenly another one, wherever the root is."""

    name = "pose_jumps"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Find frames before which many joints turn at once as in no frame around."""
        clip = reading.clip
        if reading.body is None or not reading.finite or clip.frame_count < 2 * AROUND + 2:
            return None
        jumps = np.setdiff1d(reading.in_motion(pose_jumps(reading)), reading.cuts)
        if not len(jumps):
            return None
        if len(jumps) > max(4, _MOST * clip.frame_count):
            return Diagnosis(self.name, f"the pose jumps {len(jumps)} times", 0.95, "refuse")
        short = np.flatnonzero(np.diff(jumps) < _SHORTEST * clip.fps)
        lost = [(int(jumps[i]), int(jumps[i + 1])) for i in short]
        cuts = [int(frame) for frame in jumps if frame not in np.ravel(lost)]
        parts, remedies = [], []
        if lost:
            spans = ", ".join(f"{a} to {b - 1}" if b - a > 1 else str(a) for a, b in lost[:_SHOWN])
            parts.append(f"the pose is another one in frames {spans}{' ...' * (len(lost) > _SHOWN)}")
            remedies.append("they are left out")
        if cuts:
            shown = ", ".join(map(str, cuts[:_SHOWN])) + " ..." * (len(cuts) > _SHOWN)
            parts.append(f"the pose jumps before frame {shown}")
            remedies.append("the clip is divided there")
        what, remedy = "; ".join(parts), ", ".join(remedies)
        return Diagnosis(self.name, what, 0.95, "leave_out", remedy, lambda: _divided(reading, lost, cuts))


def _divided(reading: Reading, spans: list[tuple[int, int]], cuts: list[int]) -> Reading:
    lost = np.zeros(reading.clip.frame_count, bool) if reading.lost is None else reading.lost.copy()
    for start, stop in spans:
        lost[start:stop] = True
    return replace(reading, lost=lost if lost.any() else None, cuts=tuple(sorted({*reading.cuts, *cuts})))

"""A root that jumps: steps of the origin, and frames in which tracking was lost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.capture.turning import AROUND, steps_around
from crowdsim.core.types import Array
from crowdsim.motion.body import HEIGHT

_LEAST, _ACCELERATION = 0.08, 100.0
"""A root that departs from its course by so much in one frame [m], for a body of ``HEIGHT``, at any rate and by this
acceleration [m/s^2], has jumped."""
_END = 3
"""Frames before the first jump, or from the last one on, that are a loss of their own."""
_LONGEST_LOSS = 1.0
"""A jump that is undone within this time is a loss of the frames between [s]."""
_UNDONE = 0.3
"""Share of a jump that may remain where it is undone."""
_TURN = np.deg2rad(6.0)
"""Joints that rotate by less across a jump than this, in the mean, go on: only the origin has moved."""
_MOST = 0.02
"""Share of all frames with jumps above which nothing is certain about the path."""
_SHOWN = 4


@dataclass(frozen=True)
class _Jumps:
    """Jumps of a root, sorted out.

    Attributes:
        lost: First and last frame of each loss of tracking.
        steps: Frames before which the origin moves, and by how much in file units: [(frame, (3,))].
        cuts: Frames that begin elsewhere in another pose.
    """

    lost: list[tuple[int, int]]
    steps: list[tuple[int, Array]]
    cuts: list[int]


class RootJumps:
    """Frames in which the root is elsewhere, and steps after which it stays there."""

    name = "root_jumps"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Find frames in which the root departs from its course faster than a body can."""
        body, clip = reading.body, reading.clip
        if body is None or not reading.finite or clip.frame_count < 2 * AROUND + 2:
            return None
        size = body.height / HEIGHT
        path = reading.path * ((reading.scale or 1.0) / size)
        moves = np.diff(path, axis=0)
        excess = np.linalg.norm(moves - _course(moves), axis=1)
        jumps = reading.in_motion(np.flatnonzero(excess > max(_LEAST, _ACCELERATION / clip.fps**2)) + 1)
        if not len(jumps):
            return None
        excess = excess[jumps - 1]
        far = float(excess.max()) * size
        if len(jumps) > max(4, _MOST * clip.frame_count):
            return Diagnosis(
                self.name, f"the root jumps {len(jumps)} times, by {far:.2f} m at the most in one frame", 0.95, "refuse"
            )
        sorted_out = _sort_out(reading, jumps, path)
        parts = []
        if sorted_out.lost:
            spans = ", ".join(f"{a} to {b}" if b > a else str(a) for a, b in sorted_out.lost[:_SHOWN])
            more = " ..." if len(sorted_out.lost) > _SHOWN else ""
            parts.append(f"the root is elsewhere, by {far:.2f} m, in frames {spans}{more}")
        for frames, words in (([f for f, _ in sorted_out.steps], "steps"), (sorted_out.cuts, "jumps to another pose")):
            if frames:
                shown = ", ".join(map(str, frames[:_SHOWN])) + (" ..." if len(frames) > _SHOWN else "")
                parts.append(f"the root {words}, by {far:.2f} m at the most, before frame {shown}")
        remedies = (
            ["frames are left out"] * bool(sorted_out.lost)
            + ["steps are taken out"] * bool(sorted_out.steps)
            + ["the clip is divided there"] * bool(sorted_out.cuts)
        )
        return Diagnosis(
            self.name,
            "; ".join(parts),
            0.99 if far > 0.3 else 0.93,
            "repair" if sorted_out.steps and not sorted_out.lost else "leave_out",
            ", ".join(remedies),
            lambda: _repaired(reading, sorted_out),
        )


def _course(moves: Array) -> Array:
    """The median of the moves around each one, itself left out. Shape (F - 1, 3)."""
    return np.asarray(np.median(moves[steps_around(len(moves))], axis=1))


def _sort_out(reading: Reading, jumps: Array, path: Array) -> _Jumps:
    """Tell losses from steps and cuts; frames are those that jumps lead to."""
    clip = reading.clip
    result = _Jumps([], [], [])
    moves = np.diff(reading.path, axis=0)
    excess = moves - _course(moves)
    index = 0
    while index < len(jumps):
        at = int(jumps[index])
        away = path[at] - path[at - 1]
        back = None
        for later in range(index + 1, len(jumps)):
            until = int(jumps[later])
            if until - at > _LONGEST_LOSS * clip.fps:
                break
            course = (path[at - 1] - path[max(at - 4, 0)]) / max(min(at - 1, 3), 1)
            gap = path[until] - path[at - 1] - course * (until - at + 1)
            if np.linalg.norm(gap) < max(_UNDONE * float(np.linalg.norm(away)), 0.05):
                back = later
        if back is not None:
            result.lost.append((at, int(jumps[back]) - 1))
            index = back + 1
            continue
        index += 1
        if at <= _END:
            result.lost.append((0, at - 1))
        elif at >= clip.frame_count - _END:
            result.lost.append((at, clip.frame_count - 1))
        elif _goes_on(clip.rotations, at):
            result.steps.append((at, excess[at - 1]))
        else:
            result.cuts.append(at)
    return result


def _goes_on(rotations: Array, frame: int) -> bool:
    """Whether a frame's pose is close to that of the frame before."""
    dots = np.abs(np.einsum("jc,jc->j", rotations[frame], rotations[frame - 1]))
    return float(np.mean(2.0 * np.arccos(np.clip(dots, 0.0, 1.0)))) < _TURN


def _repaired(reading: Reading, jumps: _Jumps) -> Reading:
    path = reading.path
    for frame, step in jumps.steps:
        path[frame:] -= step
    lost = np.zeros(len(path), bool) if reading.lost is None else reading.lost.copy()
    for first, last in jumps.lost:
        lost[first : last + 1] = True
    return replace(
        reading.with_path(path), lost=lost if lost.any() else None, cuts=tuple(sorted({*reading.cuts, *jumps.cuts}))
    )

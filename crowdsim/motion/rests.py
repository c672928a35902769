"""Rests in motion alone: spans in which a body stands at ease between two guards, both hands hanging.

Between the guards it may also walk off at ease, once, and stand again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.contacts import runs
from crowdsim.motion.tracks import Tracks, speeds

HANG = 0.06
"""Height of the higher fist over the pelvis, over the standing height, under which both hands hang."""
LEAST = 1.0
"""Shortest time at ease [s]."""
STILL = 0.3
"""Speed of the pelvis up to which a body stands, at ``HEIGHT`` [m/s]."""
GUARD = 0.8
"""Share of the usual height of the lower fist over the pelvis, above which a body is in its guard."""
LEADS = 1.2
"""Time in the guard before a rest in which it can be entered, and after it in which it can be left [s]."""
_SHORT = 1.5
"""Motion between a rest and the end of a clip that is shorter than this belongs to the rest [s]."""
_LONGEST = 4.0
"""Longest time from the guard to hanging hands, and back [s]."""
WALK = 1.5
"""Least way of a body that walks off, at ``HEIGHT`` [m]."""
_PAUSE, _LONGEST_WALK = 0.4, 8.0
"""Least time at ease before a body walks off, and longest time in which it does [s]."""
_SMOOTH, _STEADY = 0.05, 0.3
"""Widths of the smoothing of heights and of the pelvis's path [s]."""
_MOVING = 0.10
"""Speed at which hands sink or rise that leave the guard, or come back to it, for a body of ``HEIGHT`` [m/s]."""

FIRST, START, DOWN, UP, STOP, LAST = range(6)
"""Columns of ``RestSpans.frames``."""


@dataclass(frozen=True)
class RestSpans:
    """Rests of a motion by time, K of them.

    Attributes:
        frames: First and last frame of the guard before, first and last frame at ease, first and last frame of the
            guard after it. Shape (K, 6), int32.
        walks: First and last frame at ease before a body walks off to where it stands from ``DOWN`` to ``UP``; ``DOWN``
            twice where it does not. Shape (K, 2), int32.
    """

    frames: Array
    walks: Array

    @property
    def walked(self) -> Array:
        """Which rests have a walk. Shape (K,), bool."""
        result: Array = self.walks[:, 1] < self.frames[:, DOWN]
        return result

    def chosen(self, which: Array) -> RestSpans:
        """Return some of the rests."""
        return RestSpans(self.frames[which], self.walks[which])

    def mask(self, frames: int) -> Array:
        """Return which frames belong to rests, guards included. Shape (frames,), bool."""
        flags = np.zeros(frames, bool)
        for row in self.frames:
            flags[row[FIRST] : row[LAST] + 1] = True
        return flags


def no_rests() -> RestSpans:
    """Return the spans of motion without rests."""
    return RestSpans(np.zeros((0, 6), np.int32), np.zeros((0, 2), np.int32))


def rests_on_the_spot(frames: Array) -> RestSpans:
    """Return rests without walks. Shape (K, 6)."""
    return RestSpans(frames, np.repeat(frames[:, DOWN : DOWN + 1], 2, axis=1))


def find_rests(tracks: Tracks, fallen: Array, height: float, fps: float) -> RestSpans:
    """Find rests from guard to guard.

    A body whose hands already hang when the motion begins, or still do when it ends, or that walks with hanging hands
    before it has stood at ease, does not rest.

    Args:
        tracks: Paths of the body's points over its floor.
        fallen: Which frames belong to falls and staggers. Shape (F,), bool.
        height: Standing height of the body [m].
        fps: Frames a second.
    """
    from scipy.ndimage import gaussian_filter1d

    count = len(tracks.pelvises)
    if count < 3:
        return no_rests()
    over = tracks.fists[..., 1] - tracks.pelvises[:, None, 1]
    over = gaussian_filter1d(over, _SMOOTH * fps, axis=0, mode="nearest")
    hang = (over.max(axis=1) < HANG * height) & ~fallen
    low = over.min(axis=1)
    usual = low[~hang & ~fallen]
    if not hang.any() or not len(usual):
        return no_rests()
    guard = (low > GUARD * float(np.median(usual))) & ~fallen
    path = gaussian_filter1d(tracks.pelvises[:, [0, 2]], _STEADY * fps, axis=0, mode="nearest")
    still = hang & (speeds(path, fps) * HEIGHT / height < STILL)
    rise = np.gradient(low) * fps * HEIGHT / height
    rows: list[list[int]] = []
    walks: list[list[int]] = []
    stands = [(int(first), int(last) - 1) for first, last in runs(still)]
    for number, (down, up) in enumerate(stands):
        walk, around = [down, down], down
        if number and _walks_off(path * HEIGHT / height, hang, stands[number - 1], down, fps):
            walk, around = list(stands[number - 1]), stands[number - 1][0]
        row = _around(around, down, up, guard, fallen, rise, fps)
        if row is not None and rows and around < down and rows[-1][UP] == walk[1]:
            del rows[-1], walks[-1]
        if up - down + 1 >= LEAST * fps and row is not None and (not rows or row[START] > rows[-1][STOP]):
            rows.append(row)
            walks.append(walk)
    return RestSpans(_with_leads(rows, fallen, fps), np.array(walks, np.int32).reshape(-1, 2))


def _walks_off(path: Array, hang: Array, before: tuple[int, int], down: int, fps: float) -> bool:
    """Return whether a body that stood at ease walks from there with hanging hands to where it stands from ``down``."""
    first, last = before
    way = float(np.hypot(*(path[down] - path[last])))
    paused = last - first + 1 >= _PAUSE * fps
    return paused and way >= WALK and down - last <= _LONGEST_WALK * fps and bool(hang[last:down].all())


def _around(begin: int, down: int, up: int, guard: Array, fallen: Array, rise: Array, fps: float) -> list[int] | None:
    """Return a row of ``RestSpans`` about a time at ease from ``begin`` on, without its leads; None for no guard."""
    before, after = np.flatnonzero(guard[:begin]), np.flatnonzero(guard[up + 1 :])
    if not len(before) or not len(after):
        return None
    start, stop = int(before[-1]), up + 1 + int(after[0])
    if begin - start > _LONGEST * fps or stop - up > _LONGEST * fps or fallen[start : stop + 1].any():
        return None
    while start > 0 and rise[start] < -_MOVING and not fallen[start - 1]:
        start -= 1
    while stop < len(guard) - 1 and rise[stop] > _MOVING and not fallen[stop + 1]:
        stop += 1
    return [start, start, down, up, stop, stop]


def _with_leads(rows: list[list[int]], fallen: Array, fps: float) -> Array:
    """Return rows of rests with the guards before and after them, of which no two meet. Shape (K, 6), int32."""
    lead, short, count = round(LEADS * fps), round(_SHORT * fps), len(fallen)
    edges = np.concatenate([[-1], np.flatnonzero(fallen), [count]])
    for number, row in enumerate(rows):
        edge = int(edges[np.searchsorted(edges, row[START]) - 1]) + 1
        if number:
            edge = max(edge, rows[number - 1][LAST] + 1)
        row[FIRST] = max(row[START] - lead, edge)
        if row[FIRST] - edge < short:
            row[FIRST] = edge
        edge = int(edges[np.searchsorted(edges, row[STOP], side="right")]) - 1
        last = min(row[STOP] + lead, edge)
        if number + 1 < len(rows):
            last = min(last, (row[STOP] + rows[number + 1][START]) // 2)
        row[LAST] = edge if edge - last < short and number + 1 == len(rows) else last
    return np.array(rows, np.int32).reshape(-1, 6)


def in_control_frames(found: RestSpans, last: int, stride: int) -> RestSpans:
    """Return rests whose ends are control frames up to ``last``, of which no two meet.

    Args:
        found: Rests in playback frames.
        last: The last control frame.
        stride: Playback frames in a control frame.
    """
    frames = np.minimum(found.frames, last * stride)
    rounded = frames // stride
    for column in (FIRST, DOWN, STOP):
        rounded[:, column] = np.minimum(-(-frames[:, column] // stride), last)
    good = np.all(np.diff(rounded, axis=1) >= 0, axis=1) & (rounded[:, UP] > rounded[:, DOWN] + 1)
    walks = np.minimum(np.column_stack([-(-found.walks[:, 0] // stride), found.walks[:, 1] // stride]), last)
    walks[~found.walked] = rounded[~found.walked, DOWN : DOWN + 1]
    return RestSpans(rounded.astype(np.int32), walks.astype(np.int32)).chosen(good)


def joined_rests(spans: list[RestSpans], starts: Array, mirrored: bool) -> RestSpans:
    """Return the rests of all clips in frames of a database.

    Args:
        spans: Those of each captured clip, in its control frames.
        starts: First control frame of each clip, mirror images included. Shape (C + 1,).
        mirrored: Whether mirror images of all clips follow.
    """
    frames, walks = [no_rests().frames], [no_rests().walks]
    for image in range(1 + mirrored):
        for index, one in enumerate(spans):
            start = np.int32(starts[image * len(spans) + index])
            frames.append(one.frames + start)
            walks.append(one.walks + start)
    return RestSpans(np.concatenate(frames), np.concatenate(walks))

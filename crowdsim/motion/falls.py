"""Falls, staggers and celebrations in motion alone: spans that no fight is made of.

A body is *down* while its trunk is low and slow. The fall before that begins where the pelvis began to sink from the
height at which the body stands, and getting up ends where it is there again. A body *staggers* where its trunk is
thrown one way while it is swept that way, until feet catch it; lunges, slips and retreats lean or travel, not both, and
a body that runs travels further. It *celebrates* while it holds a fist up over its head.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.contacts import runs
from crowdsim.motion.tracks import Tracks

LOW = 0.21
"""Height of pelvis and neck, over the standing height, under which the trunk lies."""
SLOW = 0.45
"""Speed of pelvis and neck under which the body lies still, for a body of ``HEIGHT`` [m/s]."""
STANDS = 0.955
"""Share of the height at which the pelvis is carried while the body stands, above which it does so."""
LEAST_DOWN = 0.3
"""Shortest time for which a body lies [s]."""
_SINKING = 0.10
"""Speed at which a pelvis sinks or rises that falls, or gets up, for a body of ``HEIGHT`` [m/s]."""
_UPRIGHT = 0.35
"""Height of the pelvis, over the standing height, above which a body may stand."""
_LONGEST = 6.0
"""Longest time from standing to lying, and from lying to standing [s]."""
_SMOOTH = 0.03
"""Width of the smoothing of paths [s]."""
THROWN = 0.147
"""How far the neck is off where it is carried over the pelvis, over the standing height, when a body staggers."""
CARRIED = 0.07, 0.6
"""How far the pelvis goes the same way around that, at the least and at the most, over the standing height: a body that
slips a strike stays where it is, one that runs goes further."""
SWEPT = 0.45
"""How fast the trunk moves the same way then, in standing heights a second."""
_LEAST_THROWN = 0.13
"""Shortest time for which it is thrown so far [s]."""
_SWEEPS, _CATCHES = 0.22, 0.45
"""Longest time for which it is swept before it is thrown so far, and until feet have caught it after that [s]."""
_GIVES = 0.08
"""How fast the trunk moves the same way all the while, in standing heights a second."""
_CAUGHT = 0.22
"""Time after that which belongs to a stagger: feet that follow [s]."""
OVER = 0.04
"""Height of a fist over the middle of the head, over the standing height, above which it is held up."""
_LEAST_UP, _BETWEEN, _LONGEST_UP = 0.7, 0.3, 1.2
"""Shortest time for which a fist is held up in a celebration, longest between two of these, and longest in which it is
raised, or lowered [s]."""
_RAISING = 0.12
"""Speed at which it rises and sinks then, for a body of ``HEIGHT`` [m/s]."""
BESIDE = 1.2
"""Time before and after a fall or stagger that belongs to it [s]: fights are learned from other motion."""
_SHORT = 1.5
"""Motion between that and the end of a clip that is shorter than this belongs to it too [s]."""


@dataclass(frozen=True)
class FallSpans:
    """Falls and staggers of a motion by time: n falls, k staggers.

    Attributes:
        starts: Last frame in which the body stands before each fall. Shape (n,), int32.
        downs: First frame in which it lies. Shape (n,), int32.
        rises: Last frame in which it lies. Shape (n,), int32.
        stops: First frame in which it stands again. Shape (n,), int32.
        directions: Heading of the trunk's way from start to down in the world [rad]. Shape (n,), float32.
        staggers: First and last frame of each stagger. Shape (k, 2), int32.
        stagger_directions: Heading of the trunk's way likewise [rad]. Shape (k,), float32.
        cheers: First and last frame of each celebration. Shape (c, 2), int32.
    """

    starts: Array
    downs: Array
    rises: Array
    stops: Array
    directions: Array
    staggers: Array
    stagger_directions: Array
    cheers: Array

    @property
    def spans(self) -> Array:
        """First and last frame of each fall, stagger and celebration, ascending. Shape (n + k + c, 2), int32."""
        spans = np.concatenate([np.stack([self.starts, self.stops], axis=1), self.staggers, self.cheers])
        result: Array = spans[np.argsort(spans[:, 0], kind="stable")]
        return result

    @property
    def any(self) -> bool:
        """Whether there is a fall."""
        return len(self.starts) > 0

    def mask(self, frames: int) -> Array:
        """Return which frames belong to a fall or stagger. Shape (frames,), bool."""
        flags = np.zeros(frames, bool)
        for first, last in self.spans:
            flags[first : last + 1] = True
        return flags

    def beside(self, clip_starts: Array, fps: float) -> Array:
        """Return which frames lie in falls and staggers, and before and after them.

        Args:
            clip_starts: First frame of each clip, and the number of frames F.
            fps: Frames a second.

        Returns:
            Shape (F,), bool.
        """
        lead, short = round(BESIDE * fps), round(_SHORT * fps)
        flags = np.zeros(int(clip_starts[-1]), bool)
        for first, last in self.spans.astype(int):
            clip = int(np.searchsorted(clip_starts, first, side="right")) - 1
            begin, end = int(clip_starts[clip]), int(clip_starts[clip + 1])
            start, stop = first - lead, last + 1 + lead
            flags[begin if start - begin < short else start : end if end - stop < short else stop] = True
        return flags


def no_falls() -> FallSpans:
    """Return the spans of motion without falls."""
    none, bearings = np.zeros(0, np.int32), np.zeros(0, np.float32)
    pairs = np.zeros((0, 2), np.int32)
    return FallSpans(none, none, none, none, bearings, pairs, bearings, pairs)


def find_falls(tracks: Tracks, height: float, fps: float) -> FallSpans:
    """Find falls from standing to standing, and staggers.

    A body that already lies when the motion begins, or still does when it ends, does not fall.

    Args:
        tracks: Paths of the body's points over its floor.
        height: Standing height of the body [m].
        fps: Frames a second.
    """
    if len(tracks.pelvises) < 3:
        return no_falls()
    pelvis, neck = _smoothed(tracks.pelvises, fps), _smoothed(tracks.necks, fps)
    rows = _falls(pelvis, neck, height, fps)
    starts, downs, rises, stops = np.array(rows, np.int32).reshape(-1, 4).T
    trunk = 0.5 * (pelvis + neck)
    thrown = _staggers(pelvis, neck, tracks.stances, height, fps, np.stack([starts, stops], axis=1))
    return FallSpans(
        starts,
        downs,
        rises,
        stops,
        _bearings(trunk, starts, downs),
        thrown,
        _bearings(trunk, thrown[:, 0], thrown[:, 1]),
        _cheers(tracks, height, fps, np.concatenate([np.stack([starts, stops], axis=1), thrown])),
    )


def _falls(pelvis: Array, neck: Array, height: float, fps: float) -> list[tuple[int, int, int, int]]:
    """Return for each fall the last frame of standing, the first and last of lying, and the first of standing."""
    low = np.maximum(pelvis[:, 1], neck[:, 1]) < LOW * height
    upright = pelvis[:, 1] > _UPRIGHT * height
    if not low.any() or not upright.any():
        return []
    rise = np.gradient(pelvis[:, 1]) * fps * HEIGHT / height
    speed = np.maximum(*(np.linalg.norm(np.gradient(path, axis=0), axis=1) for path in (pelvis, neck)))
    still = low & (speed * fps * HEIGHT / height < SLOW)
    stands = pelvis[:, 1] > STANDS * float(np.median(pelvis[upright, 1]))
    rows = []
    for first, last in _lying(still, low, round(LEAST_DOWN * fps)):
        before, after = np.flatnonzero(stands[:first]), np.flatnonzero(stands[last + 1 :])
        if not len(before) or not len(after):
            continue
        start, stop = int(before[-1]), last + 1 + int(after[0])
        if first - start > _LONGEST * fps or stop - last > _LONGEST * fps:
            continue
        while start > 0 and rise[start] < -_SINKING:
            start -= 1
        while stop < len(pelvis) - 1 and rise[stop] > _SINKING:
            stop += 1
        rows.append((start, first, last, stop))
    return rows


def _bearings(trunk: Array, starts: Array, ends: Array) -> Array:
    """Return the heading of a trunk's way (F, 3) between frames. Shape (n,)."""
    way = trunk[ends] - trunk[starts]
    return np.arctan2(way[:, 0], way[:, 2]).astype(np.float32)


def _smoothed(path: Array, fps: float) -> Array:
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(path, _SMOOTH * fps, axis=0, mode="nearest"))


def _lying(still: Array, low: Array, least: int) -> list[tuple[int, int]]:
    """Return the first and last frame in which a body lies still, for each time that it is low."""
    found = []
    for start, stop in runs(low):
        inside = start + np.flatnonzero(still[start:stop])
        if len(inside) and inside[-1] - inside[0] + 1 >= least:
            found.append((int(inside[0]), int(inside[-1])))
    return found


def _staggers(pelvis: Array, neck: Array, stances: Array, height: float, fps: float, falls: Array) -> Array:
    """Return the first and last frame of each stagger outside falls (n, 2). Shape (k, 2), int32."""
    turn = stances * [0.0, 0.0, 1.0]
    down = np.zeros(len(pelvis), bool)
    for first, last in falls:
        down[first : last + 1] = True
    if down.all():
        return np.zeros((0, 2), np.int32)
    lean = ground.to_local(turn, neck - pelvis)[:, [0, 2]]
    lean -= np.median(lean[~down], axis=0)
    speed = ground.to_local(turn, np.gradient(0.6 * pelvis + 0.4 * neck, axis=0) * fps)[:, [0, 2]]
    far = np.linalg.norm(lean, axis=1)
    rows: list[tuple[int, int]] = []
    for first, last in runs((far > THROWN * height) & ~down):
        if last - first < _LEAST_THROWN * fps:
            continue
        peak = first + int(np.argmax(far[first:last]))
        way = lean[peak] / far[peak]
        start, caught = _while_swept(speed @ way / height, first, last - 1, fps)
        gone = ground.to_local(turn[peak], pelvis[caught] - pelvis[start])[[0, 2]] @ way / height
        if not CARRIED[0] < gone < CARRIED[1] or (speed[start:last] @ way).max() < SWEPT * height:
            continue
        stop = min(caught + round(_CAUGHT * fps), len(pelvis) - 1)
        if rows and start <= rows[-1][1] + _CATCHES * fps:
            start = rows.pop()[0]
        if not down[start : stop + 1].any():
            rows.append((start, stop))
    return np.array(rows, np.int32).reshape(-1, 2)


def _while_swept(pace: Array, first: int, last: int, fps: float) -> tuple[int, int]:
    """Return the last frame before a body is swept away, and the first in which it has been caught.

    Args:
        pace: Speed of the trunk the way that it is thrown, in standing heights a second. Shape (F,).
        first: First frame in which it is thrown.
        last: Last one.
        fps: Frames a second.
    """
    start, caught = first, last
    while start > max(first - _SWEEPS * fps, 0) and pace[start - 1] > _GIVES:
        start -= 1
    while caught < min(last + _CATCHES * fps, len(pace) - 1) and pace[caught + 1] > _GIVES:
        caught += 1
    return start, caught


def _cheers(tracks: Tracks, height: float, fps: float, others: Array) -> Array:
    """Return the first and last frame of each celebration outside falls and staggers (n, 2). Shape (c, 2), int32."""
    from scipy.ndimage import binary_closing

    fists, heads = (_smoothed(points[..., 1], fps) for points in (tracks.fists, tracks.heads))
    top = fists.max(axis=1)
    rise = np.gradient(top) * fps * HEIGHT / height
    least, most = round(_LEAST_UP * fps), round(_LONGEST_UP * fps)
    rows: list[tuple[int, int]] = []
    up = binary_closing(np.pad(top > heads + OVER * height, most), np.ones(round(_BETWEEN * fps)))[most:-most]
    for first, last in runs(up):
        if last - first < least:
            continue
        start, stop = int(first), int(last) - 1
        while start > max(first - most, 0) and rise[start] > _RAISING:
            start -= 1
        while stop < min(last + most, len(top)) - 1 and rise[stop] < -_RAISING:
            stop += 1
        if not any(start <= end and stop >= begin for begin, end in others):
            rows.append((start, stop))
    return np.array(rows, np.int32).reshape(-1, 2)

"""Falls and staggers in motion alone: spans in which a body is not in control of its balance.

A body is *down* while its trunk is low and slow. The fall before that begins where the pelvis began to sink from the
height at which the body stands, and getting up ends where it is there again. A body *staggers* where its trunk is
thrown one way while it is swept that way, until feet catch it; lunges, slips and retreats lean or travel, not both, and
a body that runs travels further.
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
THROWN = 0.15
"""How far the neck is off where it is carried over the pelvis, over the standing height, when a body staggers."""
CARRIED = 0.17, 0.55
"""How far the pelvis goes the same way around that, at the least and at the most, over the standing height: a body that
slips a strike stays where it is, one that runs goes further."""
SWEPT = 0.46
"""How fast the trunk moves the same way then, in standing heights a second."""
_CATCHES = 0.45
"""Time before and after, over which the pelvis goes there [s]."""
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
    """

    starts: Array
    downs: Array
    rises: Array
    stops: Array
    directions: Array
    staggers: Array
    stagger_directions: Array

    @property
    def spans(self) -> Array:
        """First and last frame of each fall and stagger, ascending. Shape (n + k, 2), int32."""
        spans = np.concatenate([np.stack([self.starts, self.stops], axis=1), self.staggers])
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
    return FallSpans(none, none, none, none, bearings, np.zeros((0, 2), np.int32), bearings)


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
    around = round(_CATCHES * fps)
    frames = np.arange(len(pelvis))
    low, high = np.maximum(frames - around, 0), np.minimum(frames + around, len(pelvis) - 1)
    way = ground.to_local(turn, pelvis[high] - pelvis[low])[:, [0, 2]]
    far = np.linalg.norm(lean, axis=1)
    along, swept = (np.sum(one * lean, axis=1) / np.maximum(far, 1e-9) / height for one in (way, speed))
    thrown = (far > THROWN * height) & ~down
    carried = (along > CARRIED[0]) & (along < CARRIED[1]) & (swept > SWEPT)
    rows: list[tuple[int, int]] = []
    for first, last in runs(thrown):
        if not carried[first:last].any():
            continue
        start, stop = max(first - around, 0), min(last - 1 + 2 * around, len(pelvis) - 1)
        if rows and start <= rows[-1][1]:
            start = rows.pop()[0]
        if not down[start : stop + 1].any():
            rows.append((int(start), int(stop)))
    return np.array(rows, np.int32).reshape(-1, 2)

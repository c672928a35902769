"""Where a crowd is over a whole take, and smooth paths through that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share

if TYPE_CHECKING:
    from crowdsim.render.source import PoseSource

_STEP = 0.25
"""Time between the moments at which a camera samples the crowd [s]."""
_WINDOW = 2.5
"""Time before and after a moment that its envelope covers [s]."""

_MANY, _STRAY = 50, 2.0
"""From how many avatars on cameras leave strays out, and how far a stray is from the middle: so many times as far as
nineteen of twenty avatars are."""
_THING = 0.15
"""Height of targets above their middle [m]."""


@dataclass(frozen=True)
class Crowd:
    """Where the crowd is at every ``step``-th frame, and the targets that it fights.

    Attributes:
        step: Frames between moments.
        fps: Frames a second.
        avatars: Number of avatars N.
        grounds: Ground transforms of N avatars and G things at each moment; NaN for those absent and for strays, who
            have left a large crowd. Shape (M, N + G, 3).
        heights: How high they reach [m]. Shape (N + G,).
        facing: Heading in which the camera ``auto`` looks [rad].
    """

    step: int
    fps: float
    avatars: int
    grounds: Array
    heights: Array
    facing: float

    @property
    def present(self) -> Array:
        """Numbers of the avatars that are there at some moment. Shape (n,)."""
        return np.flatnonzero(np.isfinite(self.grounds[:, : self.avatars, 0]).any(axis=0))


def watch(source: PoseSource) -> Crowd:
    """Look where the crowd is throughout a take."""
    step = max(1, round(_STEP * source.fps))
    frames = np.arange(0, max(source.frame_count, 1) - 1 + step, step).clip(max=max(source.frame_count - 1, 0))
    block = max(1, 400_000 // max(len(source.avatar_teams), 1))
    grounds = np.empty((len(frames), len(source.avatar_teams), 3), np.float32)

    def look(low: int, high: int) -> None:
        for first in range(low * block, high * block, block):
            grounds[first : first + block] = source.ground(frames[first : first + block])
            _drop_strays(grounds[first : first + block])

    share(-(-len(frames) // block), look, least=1)
    heights = np.asarray(source.avatar_heights, float)
    facing = _find_facing(grounds)
    things = np.stack([np.asarray(source.markers(int(frame)), float) for frame in frames])
    if things.shape[1]:
        ground = np.concatenate([things[..., [0, 2]], np.zeros((*things.shape[:2], 1))], axis=-1)
        grounds = np.concatenate([grounds, ground.astype(np.float32)], axis=1)
        heights = np.append(heights, things[..., 1].max(axis=0) + _THING)
    return Crowd(step, source.fps, len(source.avatar_teams), grounds, heights, facing)


def _drop_strays(grounds: Array) -> None:
    """Write NaN over the positions (M, N, 3) of avatars that are far away from a large crowd at a moment.

    Otherwise a single stray avatar would make all others small. Of a few avatars none is a stray.
    """
    if grounds.shape[1] < _MANY:
        return
    for moment in grounds:
        here = np.isfinite(moment[:, 0])
        if np.count_nonzero(here) < _MANY:
            continue
        middle = np.median(moment[here, :2], axis=0)
        away = np.linalg.norm(moment[:, :2] - middle, axis=1)
        moment[away > _STRAY * np.percentile(away[here], 95)] = np.nan


def _find_facing(grounds: Array) -> float:
    """Heading in which to look so that the crowd lies along the width of the picture."""
    if grounds.shape[1] == 1:
        heading = grounds[np.isfinite(grounds[:, 0, 2]), 0, 2]
        return float(math.atan2(np.sin(heading).sum(), np.cos(heading).sum()) + math.pi)
    flat = grounds[..., :2].reshape(-1, 2)
    flat = flat[np.isfinite(flat[:, 0])]
    if len(flat) < 2:
        return math.pi
    x, z = (flat - flat.mean(axis=0, dtype=float)).T
    product = np.empty(len(x))
    # Sums, not matrix products, whose rounding may depend on the threads of the library behind them.
    xx, xz, zz = (float(np.sum(np.multiply(a, b, out=product))) for a, b in ((x, x), (x, z), (z, z)))
    angle = 0.5 * math.atan2(2.0 * xz, xx - zz)
    if math.hypot(2.0 * xz, xx - zz) < 0.15 * (xx + zz):
        return math.pi
    # The crowd lies along (cos, sin) of the angle in x and z; of the two sides, look from the one nearer to +z.
    facing = math.atan2(-math.sin(angle), math.cos(angle))
    return facing + math.pi if math.cos(facing) > 0.0 else facing


def filled(grounds: Array) -> Array:
    """Places (M, n, k), those of absent avatars by where they were last or will be first, else the middle of all."""
    filled = grounds.copy()
    present = np.isfinite(grounds[..., 0])
    middle = grounds[present].mean(axis=0) if present.any() else np.zeros(grounds.shape[-1])
    moments = np.arange(len(grounds))
    for avatar in np.flatnonzero(~present.all(axis=0)):
        here = moments[present[:, avatar]]
        if len(here):
            nearest_moment = here[np.maximum(np.searchsorted(here, moments, side="right") - 1, 0)]
            filled[:, avatar] = grounds[nearest_moment, avatar]
        else:
            filled[:, avatar] = middle
    return filled


def envelope(values: Array, crowd: Crowd, window: float = _WINDOW) -> Array:
    """Smooth upper envelope of values over moments (M, k), each over a window to either side [s]."""
    half = max(1, round(window * crowd.fps / crowd.step))
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    return hann(windows.max(axis=-1), half)


def smooth(values: Array, crowd: Crowd) -> Array:
    """Values over moments (M, ...), smoothed like the envelope."""
    half = max(1, round(_WINDOW * crowd.fps / crowd.step))
    return hann(values.reshape(len(values), -1), half).reshape(values.shape)


def hann(values: Array, half: int) -> Array:
    """Mean of values (M, k) over ``half`` moments to either side under a raised cosine; ends repeat."""
    kernel = 1.0 + np.cos(np.linspace(-math.pi, math.pi, 2 * half + 3)[1:-1])
    kernel /= kernel.sum()
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=1)


def between(values: Array, at: float) -> Array:
    """Catmull-Rom between moments (M, ...), held at the ends."""
    i = min(max(math.floor(at), 0), len(values) - 1)
    t = at - i
    p = [values[min(max(i + k, 0), len(values) - 1)] for k in (-1, 0, 1, 2)]
    return np.asarray(
        p[1]
        + 0.5 * t * (p[2] - p[0] + t * (2 * p[0] - 5 * p[1] + 4 * p[2] - p[3] + t * (3 * (p[1] - p[2]) + p[3] - p[0])))
    )

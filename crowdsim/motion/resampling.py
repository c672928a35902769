"""From any frame rate to another, by cubic interpolation on the sphere of rotations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.skeleton import Clip


def resample(clip: Clip, fps: float) -> Clip:
    """Return the clip at another rate, from its first frame to the last whole frame of the new rate.

    Positions follow Catmull-Rom splines and rotations their counterpart made of great arcs (Barry and Goldman's
    pyramid), so that both have a continuous velocity and a rotation at constant speed stays exactly that. Where a new
    frame falls on an old one it is that frame.

    Args:
        clip: The clip.
        fps: The new rate [1/s].

    Raises:
        ValueError: The rate is not positive and finite, or the clip is empty.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps is {fps}, expected a positive number")
    if clip.frame_count < 1:
        raise ValueError(f"clip {clip.name!r} has no frames")
    if fps == clip.fps:
        return clip
    count = int(np.floor((clip.frame_count - 1) * fps / clip.fps + 1e-6)) + 1
    times = np.arange(count) * (clip.fps / fps)
    at = np.minimum(np.floor(times + 1e-6).astype(np.int64), clip.frame_count - 1)
    t = np.clip(times - at, 0.0, 1.0)
    t[t < 1e-6] = 0.0
    rotations = quaternion.continuous(clip.rotations)
    moved = clip.translations
    return replace(
        clip,
        fps=float(fps),
        root_positions=_spline(clip.root_positions, at, t, _lerp),
        rotations=_spline(rotations, at, t, quaternion.slerp),
        translations=None if moved is None else _spline(moved, at, t, _lerp),
    )


def _lerp(a: Array, b: Array, t: Array) -> Array:
    return a + (b - a) * t[..., None]


def _spline(values: Array, at: Array, t: Array, mix: Any) -> Array:
    """Interpolate between frames ``at`` and ``at + 1`` by ``t``; ``mix(a, b, t)`` may go beyond 0..1."""
    if not t.any():
        return values[at]
    last = len(values) - 1
    t = t.reshape(t.shape + (1,) * (values.ndim - 2))
    before, here = values[np.maximum(at - 1, 0)], values[at]
    there, after = values[np.minimum(at + 1, last)], values[np.minimum(at + 2, last)]
    edge = (at == 0).reshape(t.shape)
    before = np.where(edge[..., None], mix(here, there, -np.ones_like(t)), before)
    edge = (at + 2 > last).reshape(t.shape)
    after = np.where(edge[..., None], mix(here, there, 2.0 * np.ones_like(t)), after)
    a, b, c = mix(before, here, t + 1.0), mix(here, there, t), mix(there, after, t - 1.0)
    return np.asarray(mix(mix(a, b, (t + 1.0) / 2.0), mix(b, c, t / 2.0), t))

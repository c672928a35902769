"""Ground transforms of clips that go into a motion database: where feet are, and where bodies face."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.analysis import ClipAnalysis
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.fall_spans import settle_ground
from crowdsim.motion.falls import FallSpans
from crowdsim.motion.rests import RestSpans
from crowdsim.motion.tracks import speeds

_STANCE_SPEED, _TRAVEL_SPEED = 0.6, 1.1
"""Speeds of the pelvis up to which feet are a stance and from which on they are a gait's, at ``HEIGHT`` [m/s]."""
_STRIDE = 0.2
"""Width of the smoothing of the pelvis's path over the steps of a stride [s]."""


def clip_grounds(clips: list[ClipAnalysis], spans: list[FallSpans], rests: list[RestSpans], stride: int) -> list[Array]:
    """Return each clip's ground transforms: its stances, with headings in the mean direction of bodies over all clips.

    Feet that pass one another say nothing about where a body faces: the faster it travels, the more hips and shoulders
    do.

    Args:
        clips: The clips.
        spans: Falls of each, which do not count for the mean.
        rests: Rests of each, which do not count either.
        stride: Playback frames in a control frame.
    """
    if not clips:
        return []
    away = [ground.wrap(clip.tracks.ground[:, 2] - clip.tracks.stances[:, 2]) for clip in clips]
    travel = [_travelling(clip) for clip in clips]
    weights = 1.0 - np.concatenate(travel) + 1e-6
    weights[np.repeat(np.concatenate(_masks(spans, clips, stride)), stride)] = 0.0
    counts = np.repeat(~np.concatenate(_masks(rests, clips, stride)), stride)
    mean = float(np.angle(np.sum(weights[counts] * np.exp(1j * np.concatenate(away)[counts]))))
    aligned: list[Array] = []
    for clip, gap, share, own in zip(clips, away, travel, spans, strict=True):
        stances = clip.tracks.stances.copy()
        stances[:, 2] += mean + share * ground.wrap(gap - mean)
        aligned.append(settle_ground(stances, clip.tracks.pelvises, own, stride))
    return aligned


def _masks(spans: Sequence[FallSpans | RestSpans], clips: list[ClipAnalysis], stride: int) -> list[Array]:
    """Return which control frames of each clip lie in spans."""
    return [one.mask(clip.clip.frame_count // stride) for one, clip in zip(spans, clips, strict=True)]


def _travelling(analysis: ClipAnalysis) -> Array:
    """Return 0 where a body keeps its stance, 1 where it travels as fast as a walk, and what lies between. (F,)."""
    from scipy.ndimage import gaussian_filter1d

    fps = analysis.clip.fps
    path = gaussian_filter1d(analysis.tracks.pelvises[:, [0, 2]], _STRIDE * fps, axis=0, mode="nearest")
    share = (speeds(path, fps) * HEIGHT / analysis.body.height - _STANCE_SPEED) / (_TRAVEL_SPEED - _STANCE_SPEED)
    share = np.clip(share, 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share))

"""How often the same motion is seen again, the same strike at once, and stillness, from BVH files and playback frames.

A clip and its mirror image count as the same motion.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.plain_bvh import Array
from _exported.run import PELVIS, WORST, ExportedRun
from _exported.witness import Figure

PIECE = 0.25
"""Length of the pieces of the source whose repetitions are counted [s]."""
SAME, WITHIN, NEIGHBOUR = 0.1, 2.0, 2.5
"""Another boxer is at the same source when it plays motion within ``SAME`` seconds of an avatar's, at most ``WITHIN``
seconds before or after, and is nearer than ``NEIGHBOUR`` metres then."""
EVERY = 0.1
"""Time between the frames that are compared with those of others [s]."""
AT_ONCE, SAME_STRIKE = 0.15, 0.15
"""Strikes of opponents are the same one at once when they are this near in time and in the source [s]."""
STILL = 0.3
"""Mean speed of the joints of a body below which it is still [m/s]."""


def source_seconds(run: ExportedRun) -> tuple[Array, Array]:
    """Return which clip avatars play, and where in it [s]. Both of shape (N, F)."""
    source = run.source
    frames = np.clip(run.frames, 0, len(source.clips) - 1).astype(int)
    first = source.starts[np.searchsorted(source.starts, frames, side="right") - 1]
    return source.clips[frames], (frames - first) / run.sizes.rate


def most_repeated(clips: Array, seconds: Array, fps: float) -> Array:
    """Return how often per minute each avatar plays its most repeated piece of the source. Shape (N,).

    Args:
        clips: Clip at each frame. Shape (N, F).
        seconds: Time in it [s]. Shape (N, F).
        fps: Frames a second.
    """
    pieces = clips.astype(np.int64) * 1_000_000 + np.floor(seconds / PIECE).astype(np.int64)
    most = np.array([np.unique(row, return_counts=True)[1].max() for row in pieces])
    return np.asarray(most / (PIECE * fps) / (clips.shape[1] / fps / 60.0))


def same_source(clips: Array, seconds: Array, pelvises: Array, fps: float) -> Array:
    """Return whether a neighbour of each avatar is at the same source. Shape (N, F), bool.

    Args:
        clips: Clip at each frame. Shape (N, F).
        seconds: Time in it [s]. Shape (N, F).
        pelvises: Positions over the ground [m]. Shape (N, F, 2).
        fps: Frames a second.
    """
    count, frames = clips.shape
    keys, found = clips * 1e6 + seconds, np.zeros(clips.shape, bool)
    near = np.linalg.norm(pelvises[:, None] - pelvises[None], axis=-1) < NEIGHBOUR
    near[np.arange(count), np.arange(count)] = False
    reach = int(WITHIN * fps + 1e-6)
    for lag in range(-reach, reach + 1):
        own, theirs = slice(max(0, -lag), frames - max(0, lag)), slice(max(0, lag), frames - max(0, -lag))
        same = np.abs(keys[:, None, own] - keys[None, :, theirs]) < SAME
        found[:, own] |= (same & near[:, :, own]).any(axis=1)
    return found


def still(figure: Figure, fps: float, size: float = 1.0) -> Array:
    """Return whether the joints of a body are slower than ``STILL`` on the average. Shape (F - 1,), bool."""
    speeds = np.linalg.norm(np.diff(figure.joints, axis=0), axis=-1) * fps / size
    return np.asarray(speeds.mean(axis=1) < STILL)


def strikes_at_once(run: ExportedRun, clips: Array, seconds: Array) -> list[dict[str, Any]]:
    """Return the same strikes that two opponents throw at one another at once."""
    found = []
    strikes = run.strikes()
    for k, one in enumerate(strikes):
        for other in strikes[k + 1 :]:
            if (one.attacker, one.victim) != (other.victim, other.attacker):
                continue
            frames = [round(strike.seconds * run.fps) for strike in (one, other)]
            avatars = [one.attacker, other.attacker]
            apart = abs(float(np.diff(seconds[avatars, frames])[0]))
            same = clips[one.attacker, frames[0]] == clips[other.attacker, frames[1]]
            if same and apart < SAME_STRIKE and abs(one.seconds - other.seconds) < AT_ONCE:
                found.append({"value": abs(one.seconds - other.seconds), "avatar": one.attacker,
                              "frame": frames[0], "other": other.attacker})  # fmt: skip
    return found


def measure_variety(run: ExportedRun) -> dict[str, Any]:
    """Return repetitions, shares of the same source among neighbours, equal strikes, and stillness."""
    clips, seconds = source_seconds(run)
    every = max(round(EVERY * run.fps), 1)
    pelvises = np.stack([figure.joints[::every, PELVIS][:, [0, 2]] for figure in run.figures])
    same = same_source(clips[:, ::every], seconds[:, ::every], pelvises, run.fps / every)
    equal = strikes_at_once(run, clips, seconds)
    source = run.source
    bounds = zip(source.starts[:-1], source.starts[1:], strict=True)
    captured = [still(source.figure.part(slice(first, stop, run.step)), run.fps) for first, stop in bounds]
    shown = [still(figure, run.fps, size) for figure, size in zip(run.figures, run.scales, strict=True)]
    repeated = most_repeated(clips, seconds, run.fps)
    return {
        "most_repeated_per_minute": float(repeated.mean()),
        "most_repeated_per_minute_of_the_worst": float(repeated.max()),
        "same_source_share": float(same.mean()),
        "same_strikes_at_once": len(equal),
        "same_strikes_at_once_per_minute": len(equal) / run.minutes,
        "still_share": float(np.concatenate(shown).mean()),
        "still_share_of_the_source": float(np.concatenate(captured).mean()),
        "moments": equal[:WORST],
    }

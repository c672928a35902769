"""Feet, knees and elbows, and peaks of speed, from BVH files.

Each function returns plain data; ``worst`` names avatar and frame for a closer look. Frames are output frames of the
BVH files; the source motion is measured beside them at the same rate.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.plain_bvh import Array
from _exported.run import ExportedRun
from _exported.witness import HINGES, JOINTS, Figure, flexions, hinge_axes

LOW, SINKING = 0.03, 0.15
"""A foot is in contact while its ball is lower than this [m] and rises or falls slower than this [m/s]."""
POINTS = (*JOINTS, "left_fist", "right_fist", "head_middle")


def _slides(figure: Figure, fps: float, size: float) -> tuple[Array, Array]:
    """Level speed of the balls of the feet [m/s], and whether they stand. Shapes (F - 1, 2)."""
    balls = figure.soles[:, :, 1] / size
    moved = np.diff(balls, axis=0) * fps
    low = (balls[1:, :, 1] < LOW) & (balls[:-1, :, 1] < LOW) & (np.abs(moved[..., 1]) < SINKING)
    return np.linalg.norm(moved[..., [0, 2]], axis=-1), low


def _percentiles(values: list[Array]) -> dict[str, float]:
    joined = np.concatenate(values)
    return {name: float(np.percentile(joined, share)) for name, share in (("median", 50), ("p95", 95), ("p99", 99))}


def feet(run: ExportedRun) -> dict[str, Any]:
    """Slide of standing feet [m/s], for a body of the bundle's size, and the lowest point of any sole [m]."""
    figure, rate, starts = run.source.figure, run.sizes.rate, run.source.starts
    speed, low = _slides(figure, rate, 1.0)
    low[starts[1:-1] - 1] = False
    shown, same, beneath = [], [], []
    for one, size, pace, frames in zip(run.figures, run.scales, run.speeds, run.frames, strict=True):
        own, standing = _slides(one, run.fps, float(size))
        shown.append(own[standing])
        at = np.maximum(frames[1:].astype(int) - 1, 0)
        both = standing & low[at]
        same.append(own[both])
        beneath.append(speed[at][both] * pace)
    deepest = [float(one.soles[..., 1].min()) for one in run.figures]
    worst = int(np.argmin(deepest))
    return {
        "slide": _percentiles(shown),
        "slide_where_the_capture_stands_too": _percentiles(same),
        "slide_of_the_capture_there": _percentiles(beneath),
        "slide_of_all_the_capture": _percentiles([speed[low]]),
        "lowest_sole": deepest[worst],
        "lowest_sole_of_the_capture": float(figure.soles[..., 1].min()),
        "worst": {
            "avatar": worst,
            "frame": int(np.argmin(run.figures[worst].soles[..., 1].min(axis=(1, 2)))),
        },
    }


def hinges(run: ExportedRun) -> dict[str, Any]:
    """Least and greatest flexion of knees and elbows [deg], and how often they are past straight."""
    source, axes = run.source, np.zeros((4, 3))
    for clip in np.unique(source.clips):
        # Every clip has one voice.
        axes += hinge_axes(source.figure.part(source.clips == clip))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    captured = flexions(source.figure, axes)
    shown = np.stack([flexions(figure, axes) for figure in run.figures])
    outcome: dict[str, Any] = {}
    for name, part in (("knees", slice(0, 2)), ("elbows", slice(2, 4))):
        own, theirs = shown[..., part], captured[:, part]
        at = np.unravel_index(np.argmin(own), own.shape)
        outcome[name] = {
            "least": float(own.min()),
            "greatest": float(own.max()),
            "least_of_the_capture": float(theirs.min()),
            "greatest_of_the_capture": float(theirs.max()),
            "past_straight": float(np.mean((own < 0.0).any(axis=-1))),
            "past_straight_of_the_capture": float(np.mean((theirs < 0.0).any(axis=-1))),
            "worst": {"avatar": int(at[0]), "frame": int(at[1]), "joint": HINGES[part][int(at[2])]},
        }
    outcome["clips_with_backward_hinges"] = [{"clip": clip, "joint": joint} for clip, joint in source.backward]
    return outcome


def _points(figure: Figure) -> Array:
    return np.concatenate([figure.joints, figure.fists, figure.head[:, None]], axis=1)


def peaks(run: ExportedRun) -> dict[str, Any]:
    """Largest speeds [m/s] and accelerations [m/s2] of joints against the capture's, by parts of the body.

    Sizes and paces of avatars are divided out. ``frames_beyond`` is the share of frames in which any joint of the part
    exceeds the greatest that the capture has of it by a tenth; ``ratio`` the greatest excess.
    """
    source, step = run.source, run.step
    parts = {
        "trunk": [k for k, name in enumerate(POINTS) if name in ("pelvis", "chest", "neck", "head", "head_middle")],
        "arms": [k for k, name in enumerate(POINTS) if name.split("_")[-1] in ("shoulder", "elbow", "hand", "fist")],
        "legs": [k for k, name in enumerate(POINTS) if name.split("_")[-1] in ("hip", "knee", "foot")],
    }
    outcome: dict[str, Any] = {}
    for order, kind in ((1, "speed"), (2, "acceleration")):

        def sizes_of(points: Array, unit: float, order: int = order) -> Array:
            return np.linalg.norm(np.diff(points, order, axis=0), axis=-1) * run.fps**order / unit

        bounds = list(zip(source.starts[:-1], source.starts[1:], strict=True))
        captured = np.concatenate([sizes_of(_points(source.figure.part(slice(a, b, step))), 1.0) for a, b in bounds])
        shown = np.stack(
            [
                sizes_of(_points(figure), float(size * pace**order))
                for figure, size, pace in zip(run.figures, run.scales, run.speeds, strict=True)
            ]
        )
        most = captured.max(axis=0)
        outcome[kind] = {}
        for part, joints in parts.items():
            own = shown[..., joints] / most[joints]
            at = np.unravel_index(np.argmax(own), own.shape)
            joint = joints[int(at[2])]
            outcome[kind][part] = {
                "p9999": float(np.percentile(shown[..., joints], 99.99)),
                "p9999_of_the_capture": float(np.percentile(captured[:, joints], 99.99)),
                "ratio": float(own.max()),
                "frames_beyond": float((own > 1.1).any(axis=-1).mean()),
                "worst": {
                    "avatar": int(at[0]),
                    "frame": int(at[1]) + order - 1,
                    "joint": POINTS[joint],
                    "shown": float(shown[at[0], at[1], joint]),
                    "most_of_the_capture": float(most[joint]),
                },
            }
    return outcome

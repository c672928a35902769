"""Figures of a run from its BVH files: feet, knees and elbows, peaks, fists, overlapping bodies, transitions.

A ``Stage`` holds what was read. Each function returns plain data; ``worst`` names avatar and frame for a closer look.
Frames are output frames of the BVH files; the captured motion is measured beside them at the same rate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from _plain_bvh import Array
from _witness import HINGES, JOINTS, Figure, Sizes, Source, flexions, hinge_axes

LOW, SINKING = 0.03, 0.15
"""A foot stands while its ball is lower than this [m] and rises or falls slower than this [m/s]."""
TOUCH = 0.02
"""How far from the surface that it hits a fist may be [m]."""
BY = 0.8
"""Distance of pelvises within which trunks may lean into one another [m]."""
DISC = 0.2
"""Radius of the disc on the floor around a pelvis whose overlap is measured [m]."""
POINTS = (*JOINTS, "left_fist", "right_fist", "head_middle")


@dataclass(frozen=True)
class Stage:
    """A run as its BVH files show it; N avatars over F frames.

    Attributes:
        sizes: Numbers of the policy's bundle.
        source: The capture.
        figures: The avatars.
        scales: Size of each, from its bones. Shape (N,).
        speeds: Pace of each, from the take. Shape (N,).
        fps: Frames a second.
        frames: Playback frame of the capture at each output frame. Shape (N, F).
        decisions: Of each avatar the times at which it chose [s], the playback frame that it left, and the one that it
            went on from. Shape (n, 3) each.
        events: Strikes of the take by name: seconds, attacker, victim, hand, landed.
    """

    sizes: Sizes
    source: Source
    figures: list[Figure]
    scales: Array
    speeds: Array
    fps: int
    frames: Array
    decisions: list[Array]
    events: dict[str, Array]

    @property
    def step(self) -> int:
        """Playback frames in an output frame."""
        return round(self.sizes.rate / self.fps)


def _slides(figure: Figure, fps: float, size: float) -> tuple[Array, Array]:
    """Level speed of the balls of the feet [m/s], and whether they stand. Shapes (F - 1, 2)."""
    balls = figure.soles[:, :, 1] / size
    moved = np.diff(balls, axis=0) * fps
    low = (balls[1:, :, 1] < LOW) & (balls[:-1, :, 1] < LOW) & (np.abs(moved[..., 1]) < SINKING)
    return np.linalg.norm(moved[..., [0, 2]], axis=-1), low


def _told(values: list[Array]) -> dict[str, float]:
    joined = np.concatenate(values)
    return {name: float(np.percentile(joined, share)) for name, share in (("median", 50), ("p95", 95), ("p99", 99))}


def feet(stage: Stage) -> dict[str, Any]:
    """Slide of standing feet [m/s], for a body of the bundle's size, and the lowest point of any sole [m]."""
    figure, rate, starts = stage.source.figure, stage.sizes.rate, stage.source.starts
    speed, low = _slides(figure, rate, 1.0)
    low[starts[1:-1] - 1] = False
    shown, same, beneath = [], [], []
    for one, size, pace, frames in zip(stage.figures, stage.scales, stage.speeds, stage.frames, strict=True):
        own, standing = _slides(one, stage.fps, float(size))
        shown.append(own[standing])
        at = np.maximum(frames[1:].astype(int) - 1, 0)
        both = standing & low[at]
        same.append(own[both])
        beneath.append(speed[at][both] * pace)
    deepest = [float(one.soles[..., 1].min()) for one in stage.figures]
    worst = int(np.argmin(deepest))
    return {
        "slide": _told(shown),
        "slide_where_the_capture_stands_too": _told(same),
        "slide_of_the_capture_there": _told(beneath),
        "slide_of_all_the_capture": _told([speed[low]]),
        "lowest_sole": deepest[worst],
        "lowest_sole_of_the_capture": float(figure.soles[..., 1].min()),
        "worst": {
            "avatar": worst,
            "frame": int(np.argmin(stage.figures[worst].soles[..., 1].min(axis=(1, 2)))),
        },
    }


def hinges(stage: Stage) -> dict[str, Any]:
    """Least and greatest flexion of knees and elbows [deg], and how often they are past straight."""
    source, axes = stage.source, np.zeros((4, 3))
    for clip in np.unique(source.clips):
        # Every clip has one voice.
        axes += hinge_axes(source.figure.part(source.clips == clip))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    captured = flexions(source.figure, axes)
    shown = np.stack([flexions(figure, axes) for figure in stage.figures])
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


def peaks(stage: Stage) -> dict[str, Any]:
    """Largest speeds [m/s] and accelerations [m/s2] of joints against the capture's, by parts of the body.

    Sizes and paces of avatars are divided out. ``frames_beyond`` is the share of frames in which any joint of the part
    exceeds the greatest that the capture has of it by a tenth; ``ratio`` the greatest excess.
    """
    source, step = stage.source, stage.step
    parts = {
        "trunk": [k for k, name in enumerate(POINTS) if name in ("pelvis", "chest", "neck", "head", "head_middle")],
        "arms": [k for k, name in enumerate(POINTS) if name.split("_")[-1] in ("shoulder", "elbow", "hand", "fist")],
        "legs": [k for k, name in enumerate(POINTS) if name.split("_")[-1] in ("hip", "knee", "foot")],
    }
    outcome: dict[str, Any] = {}
    for order, kind in ((1, "speed"), (2, "acceleration")):

        def sizes_of(points: Array, unit: float, order: int = order) -> Array:
            return np.linalg.norm(np.diff(points, order, axis=0), axis=-1) * stage.fps**order / unit

        bounds = list(zip(source.starts[:-1], source.starts[1:], strict=True))
        captured = np.concatenate([sizes_of(_points(source.figure.part(slice(a, b, step))), 1.0) for a, b in bounds])
        shown = np.stack(
            [
                sizes_of(_points(figure), float(size * pace**order))
                for figure, size, pace in zip(stage.figures, stage.scales, stage.speeds, strict=True)
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


def _at(path: Array, frame: float) -> Array:
    """A path between its frames, smoothly."""
    low = int(np.clip(np.floor(frame + 1e-6), 1, len(path) - 3))
    u = frame - low
    a, b, c, d = path[low - 1 : low + 3]
    return b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a)))


def fists(stage: Stage) -> dict[str, Any]:
    """Distance of striking fists from the surface of head (a sphere) or torso (a capsule from pelvis to neck) [m].

    The fist is its middle. ``buried`` are strikes that are reported as missed although the fist is in the body by
    more than ``TOUCH``.
    """
    sizes, events, last = stage.sizes, stage.events, len(stage.figures[0].head) - 2
    pelvis, neck = JOINTS.index("pelvis"), JOINTS.index("neck")
    gaps, rows = [], []
    for k, (seconds, attacker, victim, hand) in enumerate(
        zip(*(events[name] for name in ("seconds", "attacker", "victim", "hand")), strict=True)
    ):
        frame = float(seconds) * stage.fps
        if victim < 0 or not 1 <= frame <= last:
            continue
        body, size = stage.figures[victim], float(stage.scales[victim])
        fist = _at(stage.figures[attacker].fists[:, hand], frame)
        low, high = _at(body.joints[:, pelvis], frame), _at(body.joints[:, neck], frame)
        axis = high - low
        share = np.clip(np.dot(fist - low, axis) / np.dot(axis, axis), 0.0, 1.0)
        to_torso = float(np.linalg.norm(fist - low - share * axis)) - sizes.torso_radius * size
        gaps.append(min(to_torso, float(np.linalg.norm(fist - _at(body.head, frame))) - sizes.head_radius * size))
        rows.append(k)
    gap, landed = np.array(gaps), events["landed"][rows].astype(bool)
    far = np.abs(gap[landed])
    if not len(far):
        return {"landed": 0}
    worst = int(np.flatnonzero(landed)[np.argmax(far)])
    k = rows[worst]
    return {
        "landed": int(landed.sum()),
        "gap": {"median": float(np.median(far)), "p95": float(np.percentile(far, 95)), "greatest": float(far.max())},
        "beyond_2_cm": float(np.mean(far > TOUCH)),
        "missed": int((~landed).sum()),
        "buried": float(np.mean(gap[~landed] < -TOUCH)) if (~landed).any() else 0.0,
        "worst": {
            "avatar": int(events["attacker"][k]),
            "victim": int(events["victim"][k]),
            "frame": round(float(events["seconds"][k]) * stage.fps, 1),
            "gap": float(gap[worst]),
        },
    }


def _between(p: Array, q: Array, r: Array, s: Array) -> Array:
    """Least distance of the segments p q and r s, each (n, 3)."""
    one, two, way = q - p, s - r, p - r
    a, e, b = np.sum(one * one, axis=1), np.sum(two * two, axis=1), np.sum(one * two, axis=1)
    c, f = np.sum(one * way, axis=1), np.sum(two * way, axis=1)
    square = a * e - b * b
    t = np.clip(np.where(square > 1e-9, (b * f - c * e) / np.maximum(square, 1e-9), 0.0), 0.0, 1.0)
    u = np.clip((b * t + f) / e, 0.0, 1.0)
    t = np.clip((b * u - c) / a, 0.0, 1.0)
    return np.linalg.norm(way + one * t[:, None] - two * u[:, None], axis=1)


def overlap(stage: Stage) -> dict[str, Any]:
    """Share of avatar-frames in which discs around pelvises, capsules of torsos, or heads lie in one another."""
    figures, sizes = stage.figures, stage.sizes
    pelvis, neck = JOINTS.index("pelvis"), JOINTS.index("neck")
    count, frames = len(figures), len(figures[0].head)
    inside = {name: np.zeros((frames, count), bool) for name in ("discs", "torsos", "heads")}
    deepest: tuple[float, int, int, int] = (0.0, 0, 0, 0)
    for i in range(count):
        low = figures[i].joints[:, pelvis]
        for j in range(i + 1, count):
            other = figures[j].joints[:, pelvis]
            apart = np.hypot(low[:, 0] - other[:, 0], low[:, 2] - other[:, 2])
            size = float(stage.scales[i] + stage.scales[j])
            # Whose pelvises are further apart has no other part in common that counts.
            near = np.flatnonzero(apart < 0.7 * size)
            if not len(near):
                continue
            one, two = (figures[k].joints[near][:, [pelvis, neck]] for k in (i, j))
            torsos = _between(one[:, 0], one[:, 1], two[:, 0], two[:, 1]) - sizes.torso_radius * size
            heads = np.linalg.norm(figures[i].head[near] - figures[j].head[near], axis=1) - sizes.head_radius * size
            for name, gap in (("discs", apart[near] - DISC * size), ("torsos", torsos), ("heads", heads)):
                inside[name][near[gap < 0.0], i] = True
                inside[name][near[gap < 0.0], j] = True
            at = int(np.argmin(torsos))
            deepest = min(deepest, (float(torsos[at]), i, j, int(near[at])))
    return {
        **{name: float(outcome.mean()) for name, outcome in inside.items()},
        "worst": {"avatar": deepest[1], "other": deepest[2], "frame": deepest[3], "depth": -deepest[0]},
    }


def undisturbed(stage: Stage) -> dict[str, Any]:
    """How far joints are from the capture where nothing is done to them, in their own frame [m].

    That is a second from transitions, away from strikes that the avatar throws (a fist that misses for being deep in a
    body is carried too) or takes, and from others; and below the head, which turns to the opponent.
    """
    events, gaps = stage.events, [np.zeros(0)]
    pelvises = np.stack([figure.joints[:, JOINTS.index("pelvis")][:, [0, 2]] for figure in stage.figures])
    below = [k for k, name in enumerate(JOINTS) if name != "head"]
    seconds = np.arange(len(stage.figures[0].head)) / stage.fps
    for avatar, figure in enumerate(stage.figures):
        outcome, frames = stage.decisions[avatar], stage.frames[avatar]
        free = np.abs(frames - np.round(frames)) < 1e-3
        for time in outcome[outcome[:, 1] != outcome[:, 2], 0]:
            free &= np.abs(seconds - time) > 1.0
        landed = events["landed"].astype(bool)
        for time in events["seconds"][events["attacker"] == avatar]:
            free &= np.abs(seconds - time) > 0.3
        for time in events["seconds"][landed & (events["victim"] == avatar)]:
            free &= (seconds < time) | (seconds > time + 0.7)
        # Trunks that lean into others give way, some control frames around that.
        apart = np.linalg.norm(pelvises - pelvises[avatar], axis=-1)
        apart[avatar] = np.inf
        close = np.flatnonzero(apart.min(axis=0) < BY)
        free &= np.abs(seconds[:, None] - seconds[close]).min(axis=1, initial=np.inf) > 0.3
        own = _own_frame(figure.joints[free]) / stage.scales[avatar]
        captured = _own_frame(stage.source.figure.joints[np.round(frames[free]).astype(int)])
        gaps.append(np.linalg.norm(own - captured, axis=-1)[:, below].max(axis=-1, initial=0.0))
    gap = np.concatenate(gaps)
    return {"frames": len(gap), "greatest_gap": float(gap.max()) if len(gap) else None}


def _own_frame(joints: Array) -> Array:
    """Joints over the floor under their pelvis, looking ahead."""
    across = joints[:, JOINTS.index("left_hip")] - joints[:, JOINTS.index("right_hip")]
    angle = np.arctan2(across[:, 2], across[:, 0])[:, None]
    seen = joints - joints[:, :1] * [1.0, 0.0, 1.0]
    x = seen[..., 0] * np.cos(angle) + seen[..., 2] * np.sin(angle)
    return np.stack([x, seen[..., 1], seen[..., 2] * np.cos(angle) - seen[..., 0] * np.sin(angle)], axis=-1)

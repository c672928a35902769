"""What hits do to those that they land on, from BVH files.

Displacements are of hits to the head, level and along the strike: the way that the fist goes over ``SWING`` seconds
before the hit. Hits to the body fold the trunk over what hits it, see ``blows.py``. ``raw`` is how far the victim's
head moves; ``over_unhit`` is how much further than in the source motion that the victim was playing, going on without
the hit. ``unhit`` are the same two at a time at which nothing hits the victim, along the same way as seen from attacker
to victim: what is found without any reaction. The lean is the head's position over the pelvis, less that in the source
frame that is played at the time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.plain_bvh import Array
from _exported.run import PELVIS, ExportedRun, Strike, worst_moments
from _exported.witness import JOINTS, Figure, unit

SWING = 0.05
"""Time over which the way of a strike is measured [s]."""
AFTER, MOVED = 0.2, 0.03
"""Time after a hit at which the head is measured [s], and how far it must have moved [m]."""
CURVE = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
"""Times after a hit at which leans are measured [s]."""
STEP_TIME, STEP = 1.0, 0.1
"""Time in which a foot steps after a strong hit [s], and how far along the strike [m]."""
STRONG = 0.75
"""Hits that are faster than this quantile of the run's are strong."""
CLEAR = 1.2
"""Time before and after an unhit moment in which nothing hits [s]."""
FEET = [JOINTS.index(name) for name in ("left_foot", "right_foot")]
NECK = JOINTS.index("neck")
HIPS = [JOINTS.index(name) for name in ("left_hip", "right_hip")]


def strike_way(run: ExportedRun, strike: Strike) -> tuple[Array, float]:
    """Return the level unit vector along a strike, shape (3,), and the speed of its fist then [m/s]."""
    attacker, frame = run.figures[strike.attacker], round(strike.seconds * run.fps)
    path = attacker.fists[:, strike.limb] if strike.limb < 2 else attacker.soles[:, strike.limb - 2, 1]
    before = max(frame - max(round(SWING * run.fps), 1), 0)
    moved = path[frame] - path[before]
    return unit(moved * [1.0, 0.0, 1.0]), float(np.linalg.norm(moved)) * run.fps / max(frame - before, 1)


def hits_body(run: ExportedRun, strike: Strike) -> bool:
    """Return whether a strike is below the victim's neck, along its trunk, and nearer to the torso than to the head."""
    frame, body, size = round(strike.seconds * run.fps), run.figures[strike.victim], run.scales[strike.victim]
    attacker = run.figures[strike.attacker]
    fist = attacker.fists[frame, strike.limb] if strike.limb < 2 else attacker.soles[frame, strike.limb - 2, 1]
    low, axis = body.joints[frame, PELVIS], body.joints[frame, NECK] - body.joints[frame, PELVIS]
    share = np.dot(fist - low, axis) / max(float(np.dot(axis, axis)), 1e-12)
    to_torso = np.linalg.norm(fist - low - np.clip(share, 0.0, 1.0) * axis) - run.sizes.torso_radius * size
    return bool(share <= 1.0 and to_torso < np.linalg.norm(fist - body.head[frame]) - run.sizes.head_radius * size)


def across_angle(figure: Figure, frame: int) -> float:
    """Return the direction of the hips about the vertical axis [rad]."""
    left, right = figure.joints[frame, HIPS]
    return float(np.arctan2(left[0] - right[0], left[2] - right[2]))


def turned(vector: Array, angle: float) -> Array:
    """Return vectors (..., 3) turned about the vertical axis, from z to x [rad]."""
    x, z = vector[..., 0], vector[..., 2]
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([x * cos + z * sin, vector[..., 1], z * cos - x * sin], axis=-1)


def unhit_displacement(run: ExportedRun, avatar: int, frame: int, frames: int) -> Array:
    """Return how far an avatar's head would move over some frames if the source motion went on. Shape (3,)."""
    source, figure = run.source, run.figures[avatar]
    here = int(np.clip(round(run.frames[avatar, frame]), 0, len(source.clips) - 1))
    end = source.starts[np.searchsorted(source.starts, here, side="right")] - 1
    there = min(here + round(frames * run.step * float(run.speeds[avatar])), int(end))
    moved = (source.figure.head[there] - source.figure.head[here]) * run.scales[avatar]
    return turned(moved, across_angle(figure, frame) - across_angle(source.figure, here))


def lean(run: ExportedRun, avatar: int, frame: int) -> Array:
    """Return the position of the head over the pelvis less that in the source frame played then [m]. Shape (3,)."""
    source, figure = run.source.figure, run.figures[avatar]
    here = int(np.clip(round(run.frames[avatar, frame]), 0, len(source.head) - 1))
    over = (source.head[here] - source.joints[here, PELVIS]) * run.scales[avatar]
    angle = across_angle(figure, frame) - across_angle(source, here)
    return np.asarray(figure.head[frame] - figure.joints[frame, PELVIS] - turned(over, angle))


def head_displacements(run: ExportedRun, avatar: int, frame: int, way: Array) -> tuple[float, float]:
    """Return how far a head moves along a way in ``AFTER`` seconds, raw and over what is unhit [m]."""
    frames = round(AFTER * run.fps)
    head = run.figures[avatar].head
    moved = head[frame + frames] - head[frame]
    return float(moved @ way), float((moved - unhit_displacement(run, avatar, frame, frames)) @ way)


def unhit_moment(run: ExportedRun, strike: Strike, hits: Array) -> tuple[int, Array] | None:
    """Return a frame at which nothing hits a victim, the nearest to a hit, and the way that answers to the strike's.

    ``hits`` are the times at which the victim is hit [s].
    """
    frame = round(strike.seconds * run.fps)
    last = run.count - round(STEP_TIME * run.fps) - 1
    clear = ~run.near(hits, CLEAR, CLEAR)
    clear[: round(SWING * run.fps)], clear[last:] = False, False
    frames = np.flatnonzero(clear)
    if not len(frames):
        return None
    chosen = int(frames[np.argmin(np.abs(frames - frame))])
    one, other = (run.figures[k].joints[:, PELVIS] for k in (strike.attacker, strike.victim))
    before, after = other[frame] - one[frame], other[chosen] - one[chosen]
    angle = np.arctan2(after[0], after[2]) - np.arctan2(before[0], before[2])
    return chosen, turned(strike_way(run, strike)[0], float(angle))


def foot_step(figure: Figure, frame: int, fps: float, way: Array) -> float:
    """Return how far the foot that goes further along a way has gone within ``STEP_TIME`` [m]."""
    feet = figure.joints[frame : frame + round(STEP_TIME * fps) + 1, FEET]
    return float(((feet - feet[0]) @ way).max())


def measure_reactions(run: ExportedRun) -> dict[str, Any]:
    """Return displacements of heads and feet after hits, beside those of unhit moments."""
    last = run.count - round(max(STEP_TIME, *CURVE) * run.fps) - 1
    hits = [hit for hit in run.strikes() if hit.landed and round(hit.seconds * run.fps) <= last]
    to_head = np.array([not hits_body(run, hit) for hit in hits], bool)
    if not to_head.any():
        return {"hits": 0}
    ways = [strike_way(run, hit) for hit in hits]
    strong = np.array([speed for _, speed in ways])
    strong = strong >= np.quantile(strong, STRONG)
    frames = [round(hit.seconds * run.fps) for hit in hits]
    moved, steps, leans, unhit, unhit_steps = [], [], [], [], []
    for hit, frame, (way, _) in zip(hits, frames, ways, strict=True):
        figure = run.figures[hit.victim]
        moved.append(head_displacements(run, hit.victim, frame, way))
        steps.append(foot_step(figure, frame, run.fps, way))
        still = lean(run, hit.victim, frame) @ way
        leans.append([lean(run, hit.victim, frame + round(time * run.fps)) @ way - still for time in CURVE])
        times = np.array([one.seconds for one in hits if one.victim == hit.victim])
        calm = unhit_moment(run, hit, times)
        if calm is not None:
            unhit.append(head_displacements(run, hit.victim, *calm))
            unhit_steps.append(foot_step(figure, calm[0], run.fps, calm[1]))
    shown, far = np.array(moved)[to_head], np.array(steps)
    curve = np.median(np.array(leans)[to_head], axis=0)
    columns = {name: np.array([getattr(hit, name) for hit in hits]) for name in ("victim", "attacker")}
    return {
        "hits": len(hits),
        "to_the_head": int(to_head.sum()),
        "raw": _shares(shown[:, 0]),
        "over_unhit": _shares(shown[:, 1]),
        "unhit": {"moments": len(unhit), **{
            name: _shares(np.array(unhit)[:, k]) if unhit else None for k, name in enumerate(("raw", "over_unhit"))
        }},
        "lean_after": {f"{time:g}": float(value) for time, value in zip(CURVE, curve, strict=True)},
        "lean_left_after_half_a_second": float(curve[CURVE.index(0.5)] / max(curve.max(), 1e-9)),
        "step_share_after_strong_hits": float(np.mean(far[strong] > STEP)),
        "step_median_after_strong_hits": float(np.median(far[strong])),
        "step_share_unhit": float(np.mean(np.array(unhit_steps) > STEP)) if unhit else None,
        "step_median_unhit": float(np.median(unhit_steps)) if unhit else None,
        "moments": worst_moments(
            -shown[:, 1], columns["victim"][to_head], np.array(frames)[to_head], run.fps,
            other=columns["attacker"][to_head],
        ),
    }  # fmt: skip


def _shares(values: Array) -> dict[str, float | None]:
    """Median [m], and shares of at least ``MOVED`` and of less than a centimetre; None where there is no value."""
    names = ("median", "share_of_3_cm", "share_below_1_cm")
    if not len(values):
        return dict.fromkeys(names)
    figures = (np.median(values), np.mean(values >= MOVED), np.mean(values < 0.01))
    return {name: float(figure) for name, figure in zip(names, figures, strict=True)}

"""One-frame jumps of rotations and sudden drops of the pelvis beside those of the source, from BVH files.

A jump is a step of a joint's rotation in the world that is greater by ``JUMP`` than both the step before and the one
after it: fast motion has steps that are alike. A drop is likewise the sinking of the pelvis over ``DROP_SECONDS``,
greater by ``DROP`` than over the same time before and after.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.accelerations import angular_velocity
from _exported.bodies import count_episodes
from _exported.plain_bvh import Array
from _exported.run import PELVIS, ExportedRun, worst_moments
from _exported.witness import JOINTS, Figure

JUMP = 10.0
"""Step beyond its neighbours that is a jump [deg]."""
BEYOND = 20.0
"""Step beyond the source's greatest that is counted apart [deg]."""
DROP, DROP_SECONDS = 0.02, 1.0 / 30.0
"""Drop beyond what is before and after [m], and the time that it takes [s]."""
PAUSE = 0.1
"""Frames of jumps that are less than this apart count as one [s]."""


def rotation_steps(figure: Figure) -> Array:
    """Return how far joints rotate between frames [deg]. Shape (F - 1, J)."""
    return np.asarray(np.degrees(np.linalg.norm(angular_velocity(figure.turns, 1.0), axis=-1)))


def excesses(steps: Array, apart: int = 1) -> Array:
    """Return by how much steps (F, ...) exceed the greater of those ``apart`` before and after them; 0 at the ends."""
    found = np.zeros(steps.shape)
    if len(steps) > 2 * apart:
        found[apart:-apart] = steps[apart:-apart] - np.maximum(steps[: -2 * apart], steps[2 * apart :])
    return found


def pelvis_drops(heights: Array, fps: float) -> Array:
    """Return by how much the pelvis sinks more after each frame than before and later [m]. Shape (F - k,)."""
    apart = max(round(DROP_SECONDS * fps), 1)
    return excesses(heights[:-apart] - heights[apart:], apart)


def measure_jumps(run: ExportedRun) -> dict[str, Any]:
    """Return rotation jumps and pelvis drops per minute, of the files and of the source."""
    source, pause = run.source, round(PAUSE * run.fps)
    bounds = zip(source.starts[:-1], source.starts[1:], strict=True)
    clips = [source.figure.part(slice(first, stop, run.step)) for first, stop in bounds]
    minutes = sum(len(clip.head) for clip in clips) / run.fps / 60.0
    captured = [rotation_steps(clip) for clip in clips]
    played = [played_jumps(run, avatar) for avatar in range(len(run.figures))]
    shown = [rotation_steps(figure) for figure in run.figures]
    most = np.max([steps.max(axis=0) for steps in captured], axis=0)
    jumps = np.stack([excesses(steps) for steps in shown])

    def per_minute(rows: list[Array], bound: float, time: float) -> float:
        return sum(count_episodes(row > bound, pause) for row in rows) / time

    drops = [
        pelvis_drops(figure.joints[:, PELVIS, 1] / size, run.fps)
        for figure, size in zip(run.figures, run.scales, strict=True)
    ]
    sunk = [pelvis_drops(clip.joints[:, PELVIS, 1], run.fps) for clip in clips]
    return {
        "rotation_jumps_per_minute": per_minute([one.max(axis=1) for one in jumps], JUMP, run.minutes),
        "rotation_jumps_per_minute_of_the_source": per_minute(
            [excesses(one).max(axis=1) for one in captured], JUMP, minutes
        ),
        "rotation_jumps_per_minute_of_the_source_as_played": sum(count_episodes(row, pause) for row in played)
        / run.minutes,
        "rotation_jumps_by_joint": {
            name: per_minute([one[:, k] for one in jumps], JUMP, run.minutes) for k, name in enumerate(JOINTS)
        },
        "steps_beyond_source_per_minute": per_minute([(one - most).max(axis=1) for one in shown], BEYOND, run.minutes),
        "pelvis_drops_per_minute": per_minute(drops, DROP, run.minutes),
        "pelvis_drops_per_minute_of_the_source": per_minute(sunk, DROP, minutes),
        "rotation_moments": _moments(run, jumps.max(axis=2), [JOINTS[k] for k in jumps.argmax(axis=2).ravel()]),
        "pelvis_moments": _moments(run, np.stack(drops), None),
    }


def played_jumps(run: ExportedRun, avatar: int) -> Array:
    """Return between which output frames an avatar plays a jump of the source; none over transitions. Shape (F - 1,).

    A jump shows as much greater as the avatar is faster.
    """
    source, pace, frames = run.source, float(run.speeds[avatar]), run.frames[avatar]
    # How many of the source's steps are jumps, up to each of its frames.
    count = np.zeros(len(source.clips) + 1, int)
    for first, stop in zip(source.starts[:-1], source.starts[1:], strict=True):
        for phase in range(run.step):
            rows = np.arange(first + phase, stop, run.step)
            jumps = excesses(rotation_steps(source.figure.part(rows))).max(axis=1, initial=0.0) * pace > JUMP
            count[rows[:-1] + 1] += jumps
    count = np.cumsum(count)
    now, later = frames[:-1], frames[1:]
    goes_on = (later > now) & (later - now < 1.5 * pace * run.step)
    low, high = (np.floor(values + 1e-6).astype(int) for values in (now, later))
    return np.asarray(goes_on & (count[np.where(goes_on, high, low)] > count[low]))


def _moments(run: ExportedRun, values: Array, parts: list[str] | None) -> list[dict[str, Any]]:
    rows = np.argsort(-values.ravel(), kind="stable")[:2000]
    avatars, frames = np.divmod(rows, values.shape[1])
    names = ["pelvis"] * len(rows) if parts is None else [parts[row] for row in rows]
    return worst_moments(values.ravel()[rows], avatars, frames, run.fps, parts=names)

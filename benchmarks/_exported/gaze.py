"""Where heads face, and hits from behind, from BVH files. Angles are level, in degrees."""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.plain_bvh import Array
from _exported.run import PELVIS, ExportedRun, worst_moments

NEAR = 1.5
"""Distance of the pelvises of opponents over the ground within which gaze counts [m]."""
LOOKS, AWAY, BEHIND = 45.0, 90.0, 120.0
"""A head faces an opponent, and is turned away; an attacker is behind [deg]."""
NOTICED = 1.0
"""Time in which the head turns to whoever hit from behind [s]."""
LEVEL = [0, 2]


def level_angles(ahead: Array, towards: Array) -> Array:
    """Return the level angles between directions [deg]; both shapes (..., 3)."""
    a, b = ahead[..., LEVEL], towards[..., LEVEL]
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.asarray(np.degrees(np.abs(np.arctan2(cross, np.sum(a * b, axis=-1)))))


def head_angles(run: ExportedRun) -> tuple[Array, Array]:
    """Return how far heads face off their opponents [deg], NaN without one, and the distance of pelvises [m].

    Both of shape (N, F).
    """
    angles, apart = np.full(run.opponents.shape, np.nan), np.full(run.opponents.shape, np.inf)
    heads = np.stack([figure.head for figure in run.figures])
    pelvises = np.stack([figure.joints[:, PELVIS] for figure in run.figures])
    frames = np.arange(run.count)
    for avatar, figure in enumerate(run.figures):
        known = run.opponents[avatar] >= 0
        whom, at = run.opponents[avatar][known], frames[known]
        angles[avatar, known] = level_angles(figure.faces[known], heads[whom, at] - heads[avatar, at])
        apart[avatar, known] = np.linalg.norm((pelvises[whom, at] - pelvises[avatar, at])[:, LEVEL], axis=1)
    return angles, apart


def measure_gaze(run: ExportedRun) -> dict[str, Any]:
    """Return shares of frames nearer than ``NEAR`` in which heads face opponents, and what comes from behind."""
    angles, apart = head_angles(run)
    near = apart < NEAR
    seen = angles[near]
    rows = np.argwhere(near)
    moments = worst_moments(seen, rows[:, 0], rows[:, 1], run.fps, other=run.opponents[near]) if len(seen) else []
    hits = [strike for strike in run.strikes() if strike.landed]
    behind, turned, off = [], [], []
    for hit in hits:
        victim, attacker = run.figures[hit.victim], run.figures[hit.attacker]
        frame = round(hit.seconds * run.fps)
        towards = attacker.joints[frame, PELVIS] - victim.joints[frame, PELVIS]
        off.append(float(level_angles(victim.pelvises[frame], towards)))
        behind.append(off[-1] > BEHIND)
        later = slice(frame + 1, frame + round(NOTICED * run.fps) + 1)
        if behind[-1] and later.stop <= run.count:
            gaps = level_angles(victim.faces[later], attacker.head[later] - victim.head[later])
            turned.append(bool((gaps < LOOKS).any()))
    columns = [np.array(one) for one in (off, [hit.victim for hit in hits], [hit.attacker for hit in hits])]
    frames = np.array([round(hit.seconds * run.fps) for hit in hits])
    return {
        "facing_share": float(np.mean(seen < LOOKS)) if len(seen) else None,
        "away_share": float(np.mean(seen > AWAY)) if len(seen) else None,
        "hits_from_behind_share": float(np.mean(behind)) if behind else None,
        "hits_from_behind": int(np.sum(behind)),
        "turned_to_attacker_share": float(np.mean(turned)) if turned else None,
        "moments": moments,
        "behind_moments": worst_moments(columns[0], columns[1], frames, run.fps, other=columns[2]) if hits else [],
    }

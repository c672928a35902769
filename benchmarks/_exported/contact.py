"""Fists off what they hit, and the overlap of simple shapes around bodies, from BVH files."""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.capsules import capsule_depths
from _exported.run import ExportedRun, between_frames
from _exported.witness import JOINTS

TOUCH = 0.02
"""How far from the surface that it hits a fist may be [m]."""
DISC = 0.2
"""Radius of the disc on the floor around a pelvis whose overlap is measured [m]."""


def fists(run: ExportedRun) -> dict[str, Any]:
    """Distance of striking fists from the surface of head (a sphere) or torso (a capsule from pelvis to neck) [m].

    The fist is its middle. ``buried`` are strikes that are reported as missed although the fist is in the body by
    more than ``TOUCH``.
    """
    sizes, pelvis, neck = run.sizes, JOINTS.index("pelvis"), JOINTS.index("neck")
    gaps, strikes = [], [strike for strike in run.strikes() if strike.limb < 2]
    for strike in strikes:
        frame, body, size = strike.seconds * run.fps, run.figures[strike.victim], float(run.scales[strike.victim])
        fist = between_frames(run.figures[strike.attacker].fists[:, strike.limb], frame)
        low, high = (between_frames(body.joints[:, joint], frame) for joint in (pelvis, neck))
        axis = high - low
        share = np.clip(np.dot(fist - low, axis) / np.dot(axis, axis), 0.0, 1.0)
        to_torso = float(np.linalg.norm(fist - low - share * axis)) - sizes.torso_radius * size
        to_head = float(np.linalg.norm(fist - between_frames(body.head, frame))) - sizes.head_radius * size
        gaps.append(min(to_torso, to_head))
    gap, landed = np.array(gaps), np.array([strike.landed for strike in strikes], bool)
    far = np.abs(gap[landed])
    if not len(far):
        return {"landed": 0}
    worst = int(np.flatnonzero(landed)[np.argmax(far)])
    return {
        "landed": int(landed.sum()),
        "gap": {"median": float(np.median(far)), "p95": float(np.percentile(far, 95)), "greatest": float(far.max())},
        "beyond_2_cm": float(np.mean(far > TOUCH)),
        "missed": int((~landed).sum()),
        "buried": float(np.mean(gap[~landed] < -TOUCH)) if (~landed).any() else 0.0,
        "worst": {
            "avatar": strikes[worst].attacker,
            "victim": strikes[worst].victim,
            "frame": round(strikes[worst].seconds * run.fps, 1),
            "gap": float(gap[worst]),
        },
    }


def overlap(run: ExportedRun) -> dict[str, Any]:
    """Share of avatar-frames in which discs around pelvises, capsules of torsos, or heads lie in one another."""
    figures, sizes = run.figures, run.sizes
    pelvis, neck = JOINTS.index("pelvis"), JOINTS.index("neck")
    count, frames = len(figures), len(figures[0].head)
    inside = {name: np.zeros((frames, count), bool) for name in ("discs", "torsos", "heads")}
    deepest: tuple[float, int, int, int] = (0.0, 0, 0, 0)
    for i in range(count):
        low = figures[i].joints[:, pelvis]
        for j in range(i + 1, count):
            other = figures[j].joints[:, pelvis]
            apart = np.hypot(low[:, 0] - other[:, 0], low[:, 2] - other[:, 2])
            size = float(run.scales[i] + run.scales[j])
            # Whose pelvises are further apart has no other part in common that counts.
            near = np.flatnonzero(apart < 0.7 * size)
            if not len(near):
                continue
            one, two = (figures[k].joints[near][:, [pelvis, neck]] for k in (i, j))
            radii = [np.full((len(near), 2), sizes.torso_radius * float(run.scales[k])) for k in (i, j)]
            torsos = -capsule_depths(one[:, 0], one[:, 1], radii[0], two[:, 0], two[:, 1], radii[1])
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

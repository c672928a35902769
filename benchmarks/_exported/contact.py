"""Fists off what they hit, and the overlap of simple shapes around bodies, from BVH files."""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.capsules import capsule_depths
from _exported.plain_bvh import Array
from _exported.run import ExportedRun, between_frames
from _exported.witness import JOINTS, PARTS, unit

TOUCH = 0.02
"""How far from the surface that it hits a fist may be [m]."""
HEIGHT = 1.75
"""Height of a body for which lengths below are given [m]."""
GLOVE = 0.0684
"""Radius of a glove [m]."""
SKINS = {
    (0.1, 0.1): (0.0, 0.0, 0.0, 0.0),
    (0.115, 0.115): (0.036, -0.006, -0.01, -0.01),
    (0.12, 0.075): (0.049, -0.014, 0.002, -0.008),
    (0.07, 0.07): (0.0, -0.007, -0.002, -0.002),
    (0.052, 0.052): (0.0, 0.0, 0.015, 0.015),
    (0.105, 0.105): (0.0, 0.003, -0.014, -0.014),
    (0.056, 0.043): (0.0, 0.0, 0.005, -0.003),
}
"""Capsules of trunk, head and upper arms by their radii: how far their skin is to both sides and ahead, and how much
thicker it is at both ends [m]."""
DISC = 0.2
"""Radius of the disc on the floor around a pelvis whose overlap is measured [m]."""


def fists(run: ExportedRun) -> dict[str, Any]:
    """Distance of the surface of striking fists from the skin of head, trunk and upper arms [m], outside or inside.

    A fist is a ball as large as gloves of skins are. Skins are capsules of the bundle, but those that go up the trunk
    lie in pairs, side by side: see ``SKINS``. ``buried`` are strikes that are reported as missed although their
    fist is in the body by more than ``TOUCH``.
    """
    gaps, strikes = [], [strike for strike in run.strikes() if strike.limb < 2]
    for strike in strikes:
        frame = strike.seconds * run.fps
        fist = between_frames(run.figures[strike.attacker].fists[:, strike.limb], frame)
        size = run.sizes.height / HEIGHT * float(run.scales[strike.attacker])
        gaps.append(above_skin(run, strike.victim, frame, fist) - GLOVE * size)
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


def above_skin(run: ExportedRun, avatar: int, frame: float, point: Array) -> float:
    """Return how far a point (3,) is outside the skin of trunk, head and upper arms, negative inside [m]."""
    sizes, parts = run.sizes, run.sizes.capsule_parts()
    size, scale = sizes.height / HEIGHT * float(run.scales[avatar]), float(run.scales[avatar])
    shown = [PARTS.index(part) for part in ("torso", "head", "left_upper_arm", "right_upper_arm")]
    skins = [
        (
            *between_frames(run.capsules[avatar][:, capsule].astype(float), frame),
            sizes.capsule_radii[capsule] * scale,
            fit,
        )
        for capsule in np.flatnonzero(np.isin(parts, shown))
        for radii, fit in SKINS.items()
        if np.allclose(sizes.capsule_radii[capsule], np.array(radii) * sizes.height / HEIGHT)
    ]
    if len(skins) < np.isin(parts, shown).sum():
        raise ValueError(f"capsules of avatar {avatar} have radii that no skin is known for, expected those of `SKINS`")
    joints = between_frames(run.figures[avatar].joints, frame)
    across = unit(joints[JOINTS.index("left_shoulder")] - joints[JOINTS.index("right_shoulder")])
    ahead = unit(np.cross(across, joints[JOINTS.index("neck")] - joints[JOINTS.index("chest")]))
    found = np.inf
    for start, end, radii, (wider, further, *thicker) in skins:
        for aside in (wider, -wider):
            axis, way = end - start, point - start - size * (aside * across + further * ahead)
            share = np.clip(np.dot(way, axis) / max(np.dot(axis, axis), 1e-12), 0.0, 1.0)
            radius = radii + np.array(thicker) * size
            found = min(found, float(np.linalg.norm(way - share * axis) - radius[0] - share * (radius[1] - radius[0])))
    return found


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

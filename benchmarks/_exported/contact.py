"""Fists off what they hit, and the overlap of simple shapes around bodies, from BVH files."""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.capsules import capsule_depths
from _exported.plain_bvh import Array
from _exported.run import ExportedRun, between_frames
from _exported.witness import JOINTS, PARTS, unit
from crowdsim.poses.skins import ACROSS, BODIES, PIECES

TOUCH = 0.02
"""How far from the surface that it hits a fist may be [m]."""
HEIGHT = 1.75
"""Height of a body for which lengths below are given [m]."""
GLOVE = 0.0684
"""Radius of a glove [m]."""
KINDS = {
    (0.1, 0.1): "pelvis",
    (0.115, 0.115): "trunk",
    (0.12, 0.075): "chest",
    (0.07, 0.07): "shoulders",
    (0.052, 0.052): "neck",
    (0.105, 0.105): "head",
    (0.056, 0.043): "upper arm",
}
"""Capsules of trunk, head and upper arms by their radii [m], as the table of skins names them."""
DISC = 0.2
"""Radius of the disc on the floor around a pelvis whose overlap is measured [m]."""


def fists(run: ExportedRun) -> dict[str, Any]:
    """Distance of the surface of striking fists from the skin of head, trunk and upper arms [m], outside or inside.

    A fist is a ball as large as gloves of skins are. Skins are the pieces of ``crowdsim.poses.skins``, a table that
    tests compare with the meshes; ``delivery.py`` measures fists on the meshes themselves. ``buried`` are strikes that
    are reported as missed although their fist is in the body by more than ``TOUCH``.
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
    sizes, parts, figure = run.sizes, run.sizes.capsule_parts(), run.figures[avatar]
    scale, girth = float(run.scales[avatar]), float(run.girths[avatar])
    size, known = sizes.height / HEIGHT * scale, BODIES[run.sexes[avatar]]
    nearest = min(known, key=lambda one: abs(one - girth))
    shown = [PARTS.index(part) for part in ("torso", "head", "left_upper_arm", "right_upper_arm")]
    joints, face = between_frames(figure.joints, frame), unit(between_frames(figure.faces, frame))
    crown = unit(between_frames(figure.head, frame) - joints[JOINTS.index("head")])
    face = unit(face - crown * np.dot(face, crown))
    lines, found = list[tuple[str, Array, float]](), np.inf
    for capsule in np.flatnonzero(np.isin(parts, shown)):
        radii = tuple(np.round(sizes.capsule_radii[capsule] * HEIGHT / sizes.height, 4).tolist())
        if radii not in KINDS:
            raise ValueError(f"a capsule of avatar {avatar} has radii {radii}, expected those of `KINDS`")
        lines.append((KINDS[radii], between_frames(run.capsules[avatar][:, capsule].astype(float), frame), 1.0))
    across, along = (next(ends for kind, ends, _ in lines if kind == one) for one in ("shoulders", "chest"))
    right, up = unit(across[1] - across[0]), unit(along[1] - along[0])
    for end, sign, role in ((0, -1.0, "left_shoulder"), (1, 1.0, "right_shoulder")):
        lines.append(("collar", np.stack([across[end], joints[JOINTS.index(role)]]), sign))
    for kind, ends, side in lines:
        axes, width = np.stack([right, np.cross(up, right), up]), size * girth / nearest
        if kind == "head":
            axes, width = np.stack([np.cross(crown, face), face, crown]), size
        elif kind == "upper arm":
            axes = np.stack([0.0 * face, 0.0 * face, unit(ends[1] - ends[0])])
        for (own, twice), piece in zip(PIECES, known[nearest], strict=True):
            for sign in ((1.0, -1.0) if twice else (1.0,)) if own == kind else ():
                # Of a pair that lies across a body the ends of one are those of the other on the other side.
                rows = piece[::-1] if sign < 0.0 and kind in ACROSS else piece
                start, end = ends + width * (rows[:, :3] * [sign * side, 1.0, 1.0]) @ axes
                axis, way = end - start, point - start
                share = np.clip(np.dot(way, axis) / max(np.dot(axis, axis), 1e-12), 0.0, 1.0)
                thick = width * (rows[0, 3] + share * (rows[1, 3] - rows[0, 3]))
                found = min(found, float(np.linalg.norm(way - share * axis) - thick))
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

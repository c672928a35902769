"""How far motion that nothing disturbs is from the source, from BVH files."""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.capsules import touches
from _exported.plain_bvh import Array
from _exported.run import PELVIS, ExportedRun
from _exported.witness import JOINTS

APART = 1.0
"""How far from transitions motion is calm [s]."""
THROWN, TAKEN = 0.3, 0.7
"""Time around strikes that an avatar throws, and after those that hit it or are blocked by it, that is not calm [s]."""
BY, AROUND = 0.8, 0.3
"""Distance of pelvises within which trunks may lean into one another [m], and time around that [s]."""
ROOM = 0.03
"""Distance of bodies within which limbs may have given way [m]."""
UNDER = 0.0005
"""How far soles of the source may be under the floor; feet that are deeper are lifted [m]."""


def undisturbed(run: ExportedRun) -> dict[str, Any]:
    """Return how far joints are from the source where nothing is done to them, in their own frame [m].

    That is a second from transitions, away from strikes that the avatar throws (a fist that misses for being deep in a
    body is carried too), takes or blocks; where trunks are not near others, and no part of it touches another body
    about then; where no sole of the source is under the floor; and below the head, which turns to the opponent.
    Heights are over the floor that the database has found, see ``floors_off``. ``where_bodies_touch`` is the same of
    frames that are left out for touching alone.
    """
    pelvises = np.stack([figure.joints[:, PELVIS][:, [0, 2]] for figure in run.figures])
    below = [k for k, name in enumerate(JOINTS) if name != "head"]
    gaps: dict[bool, list[Array]] = {True: [np.zeros(0)], False: [np.zeros(0)]}
    for avatar, figure in enumerate(run.figures):
        free = _free_of_transitions_and_strikes(run, avatar)
        # Trunks that lean into others give way, some control frames around that.
        apart = np.linalg.norm(pelvises - pelvises[avatar], axis=-1)
        apart[avatar] = np.inf
        free &= ~run.near(run.seconds[apart.min(axis=0) < BY], AROUND, AROUND)
        near = np.flatnonzero(run.near(run.seconds[free], AROUND, AROUND))
        touching = run.near(run.seconds[near[touches(run, avatar, near, ROOM)]], AROUND, AROUND)
        played = np.round(run.frames[avatar][free]).astype(int)
        floors = run.source.floors[run.source.clips[played]]
        captured = _own_frame(run.source.figure.joints[played]) - floors[:, None, None] * [0.0, 1.0, 0.0]
        own = _own_frame(figure.joints[free]) / run.scales[avatar]
        gap = np.linalg.norm(own - captured, axis=-1)[:, below].max(axis=-1, initial=0.0)
        for kind in gaps:
            gaps[kind].append(gap[touching[free] == kind])
    calm, touched = (np.concatenate(gaps[kind]) for kind in (False, True))
    return {
        "frames": len(calm),
        "greatest_gap": float(calm.max()) if len(calm) else None,
        "where_bodies_touch": {
            "frames": len(touched),
            "greatest_gap": float(touched.max()) if len(touched) else None,
        },
    }


def _free_of_transitions_and_strikes(run: ExportedRun, avatar: int) -> Array:
    """Output frames that show a frame of the source, away from what an avatar does and takes. Shape (F,), bool."""
    events, frames, source = run.events, run.frames[avatar], run.source
    free = np.abs(frames - np.round(frames)) < 1e-3
    lowest = source.figure.soles[..., 1].min(axis=(1, 2)) - source.floors[source.clips]
    free &= lowest[np.round(frames).astype(int)] > -UNDER
    free &= ~run.near(run.transitions(avatar), APART, APART)
    free &= ~run.near(events["seconds"][events["attacker"] == avatar], THROWN, THROWN)
    taken = (events["landed"] | events["blocked"]) & (events["victim"] == avatar)
    return np.asarray(free & ~run.near(events["seconds"][taken], 0.0, TAKEN))


def _own_frame(joints: Array) -> Array:
    """Joints over the floor under their pelvis, looking ahead."""
    across = joints[:, JOINTS.index("left_hip")] - joints[:, JOINTS.index("right_hip")]
    angle = np.arctan2(across[:, 2], across[:, 0])[:, None]
    seen = joints - joints[:, :1] * [1.0, 0.0, 1.0]
    x = seen[..., 0] * np.cos(angle) + seen[..., 2] * np.sin(angle)
    return np.stack([x, seen[..., 1], seen[..., 2] * np.cos(angle) - seen[..., 0] * np.sin(angle)], axis=-1)

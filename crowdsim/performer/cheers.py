"""Celebrations of the embedded boxer: out of the guard to raised fists, and back into the guard."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.moves import part
from crowdsim.performer.score import LEAD, Accent, Channel, Score, Span, Vector

_GUARD, _AFTER = 1.15, 1.3
"""Time in the guard before a celebration, and after it [s]."""
_RAISES, _LOWERS = 0.5, 0.65
"""Time in which fists are raised, and in which they are lowered again [s]."""
_HANDS = (Channel.LEAD_HAND_X, Channel.REAR_HAND_X)

# fmt: off
_UPRIGHT = part(0.0, 0.0, 0.0, 0.0, HEIGHT=0.035, FLEX=-0.20, PELVIS_TILT=-0.12, HEAD_NOD=-0.30, PELVIS_TURN=0.42,
                LEAD_RAISE=0.16, REAR_RAISE=0.16)
_OPEN = part(0.0, 0.0, 0.0, 0.0, LEAD_ELBOW=0.8, REAR_ELBOW=0.8)
_BEAT = part(0.0, 0.5, 0.5, 1.0, LEAD_HAND_Y=-0.11, REAR_HAND_Y=-0.11, HEIGHT=-0.025, HEAD_NOD=0.10)
_PUMP = part(0.0, 0.5, 0.5, 1.0, REAR_HAND_Y=-0.16, REAR_HAND_Z=0.08, REAR_ELBOW=0.3, HEIGHT=-0.02, TWIST=-0.08)
_SHOW = (*part(0.0, 0.75, -0.75, 0.0, HEAD_TURN=0.55), *part(0.1, 0.75, -0.75, -0.1, TWIST=0.22, PELVIS_TURN=0.10))
"""The body upright and open; fists that beat the air; a fist that strikes at the sky; and a turn to the side."""
_FISTS: dict[str, tuple[Vector, Vector]] = {
    "cheer_both": ((0.27, 0.62, 0.10), (-0.27, 0.62, 0.08)),
    "cheer_one": ((0.24, -0.38, 0.14), (-0.22, 0.66, 0.08)),
    "cheer_wide": ((0.45, 0.54, 0.08), (-0.45, 0.54, 0.06)),
}
# fmt: on
CHEERS = tuple(_FISTS)
"""Kinds of celebrations: both fists over the head, one, and arms spread."""


def write_cheer(plan: Choreographer, kind: str) -> Score:
    """Plan a clip of one celebration: a second in the guard, raised fists, and a second in the guard."""
    rng = plan.rng
    start = _GUARD + float(rng.uniform(0.0, 0.15))
    up = start + plan.about(_RAISES, 0.06)
    down = up + float(rng.uniform(1.7, 2.1))
    end = down + plan.about(_LOWERS, 0.06)
    plan.play((*_UPRIGHT, *_OPEN), (start, up, down, end), spread=0.06)
    for side, (fist, held) in enumerate(zip(_FISTS[kind], plan.style.fists, strict=True)):
        late = float(rng.uniform(0.0, 0.06))
        for axis, (there, here) in enumerate(zip(fist, held, strict=True)):
            channel = Channel((_HANDS[0] if side == LEAD else _HANDS[1]) + axis)
            plan.accent(channel, plan.about(there - here, 0.03), start + late, up + late, down, end - late)
    _beat(plan, kind, up, down)
    plan.score.cheers.append(Span(kind, start, end))
    return plan.finish(end + _AFTER)


def _beat(plan: Choreographer, kind: str, up: float, down: float) -> None:
    """Beat the air with raised fists, strike at the sky, or turn to both sides, from ``up`` to ``down`` [s]."""
    if kind == "cheer_wide":
        middle, sign = 0.5 * (up + down), float(plan.rng.choice([-1.0, 1.0]))
        for side, first, last in ((sign, up - 0.1, middle), (-sign, middle - 0.2, down + 0.2)):
            plan.play(_SHOW, (first, first, last, last), side, 0.1)
        return
    accents: tuple[Accent, ...] = _PUMP if kind == "cheer_one" else _BEAT
    beats = np.linspace(up + 0.05, down - 0.05, 4)
    for first, last in pairwise(beats):
        plan.play(accents, (float(first),) * 4, spread=0.12, unit=float(last - first))

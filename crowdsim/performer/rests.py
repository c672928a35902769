"""Rests of the embedded boxer: out of the guard to stand at ease, perhaps to walk off at ease too, and back again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from crowdsim.motion import ground
from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.footwork import stance_prints
from crowdsim.performer.moves import part
from crowdsim.performer.score import GUARD_SWING, LEAD, REAR, Accent, Channel, Rest, Score
from crowdsim.performer.travel import STROLL, Stride, stance_on, travel

_GUARD, _AFTER = 1.15, 1.15
"""Time in the guard before a rest, and after it [s]."""
_LOWERS, _RAISES = 0.85, 0.85
"""Time in which the guard is lowered, and in which it is raised again [s]."""
_HALF_WIDTH, _TOE_OUT = 0.125, (0.14, -0.16)
"""Distance of each foot from the middle of a body at ease [m], and headings of the feet, lead and rear [rad]."""
_HANGING = (0.225, -0.465, 0.085)
"""A hanging fist from the chest joint, outwards, up and ahead [m]."""
# fmt: off
_EASE = part(
    0.0, 0.0, 0.0, 0.0, HEIGHT=0.052, SHIFT_Z=-0.045, PELVIS_TURN=0.52, PELVIS_TILT=-0.12, TWIST=0.06, FLEX=-0.13,
    HEAD_NOD=-0.13, LEAD_HEEL=-0.20, REAR_HEEL=-0.40, LEAD_RAISE=-0.05, REAR_RAISE=-0.05, LEAD_FORTH=-0.10,
    REAR_FORTH=-0.10)
"""What takes the body from the guard to standing at ease, but for the hands."""
_SHIFT = part(0.0, 0.8, -0.8, 0.0, SHIFT_X=0.045, PELVIS_BEND=-0.07, BEND=0.09, TWIST=0.08)
_GLANCE = part(0.2, 0.8, -0.7, 0.0, HEAD_TURN=0.35)
"""The weight on one leg, and a look aside."""
_LOOK = (
    *part(0.0, 0.75, -0.75, 0.0, HEAD_TURN=0.85),
    *part(0.07, 0.75, -0.75, -0.07, TWIST=0.22),
    *part(0.14, 0.75, -0.75, -0.14, PELVIS_TURN=0.07),
    *part(0.07 * 3, 0.75, -0.75, -0.07 * 3, SHIFT_X=0.02),
)
"""A look over one shoulder."""
_SHAKES = (
    part(0.0, 0.5, 0.5, 1.0, LEAD_ROLL=0.5, LEAD_HAND_X=0.022, LEAD_RAISE=0.03),
    part(0.0, 0.5, 0.5, 1.0, REAR_ROLL=0.5, REAR_HAND_X=-0.022, REAR_RAISE=0.03),
)
"""One beat of shaking an arm, lead and rear."""
_SHOULDERS = (
    *part(0.0, 0.42, 0.50, 1.0, LEAD_RAISE=0.34, REAR_RAISE=0.34),
    *part(0.3, 0.65, 0.70, 1.0, LEAD_FORTH=-0.22, REAR_FORTH=-0.22),
)
_STOOP = part(
    0.0, 0.0, 0.0, 0.0, HEIGHT=-0.16, SHIFT_Z=-0.07, PELVIS_TILT=0.58, FLEX=0.50, HEAD_NOD=-0.28, LEAD_FORTH=0.12,
    REAR_FORTH=0.12, LEAD_HAND_X=-0.07, REAR_HAND_X=0.07, LEAD_HAND_Y=0.06, REAR_HAND_Y=0.06, LEAD_HAND_Z=0.22,
    REAR_HAND_Z=0.22)
_HEAVE = part(0.0, 0.5, 0.5, 1.0, FLEX=-0.07, LEAD_RAISE=0.07, REAR_RAISE=0.07, HEAD_NOD=-0.05)
"""Stooped, hands on the knees, and one deep breath there."""
_FORTH = part(0.0, 0.20, 0.25, 0.6, LEAD_FORTH=0.16, REAR_FORTH=0.16)
_NECK = part(0.0, 0.30, 0.32, 0.7, HEAD_BEND=0.32)
"""One roll of the shoulders backwards, in shares of its time; forward before that; and one of the neck."""
# fmt: on
_HANDS = (Channel.LEAD_HAND_X, Channel.REAR_HAND_X)


def _stand_easy(
    plan: Choreographer, lowers: tuple[float, float], eases: tuple[float, float], raises: tuple[float, float]
) -> None:
    """Bring the hands from the guard to hang, all else to ease, and all back: each from one time to another [s]."""
    (start, down), (up, end) = lowers, raises
    plan.play(_EASE, (*eases, up, end), spread=0.05)
    for side, fist in enumerate(plan.style.fists):
        out, high, ahead = _HANGING
        late = float(plan.rng.uniform(0.0, 0.08))
        for axis, there in enumerate((out if side == LEAD else -out, high, ahead)):
            size = plan.about(there - fist[axis], 0.03)
            plan.accent(Channel(_HANDS[side] + axis), size, start + late, down, up, end - late)


def _to_both_sides(
    overlap: float, plays: Sequence[tuple[tuple[Accent, ...], float]], plan: Choreographer, start: float, end: float
) -> None:
    """Play accents, drawn by a spread each, to one side and then to the other, which begins ``overlap`` earlier [s]."""
    side = float(plan.rng.choice([-1.0, 1.0]))
    middle = 0.5 * (start + end)
    for sign, first, last in ((side, start, middle), (-side, middle - overlap, end)):
        for accents, spread in plays:
            plan.play(accents, (first, first, last, last), sign, spread)


def _shake_arms(plan: Choreographer, start: float, end: float) -> None:
    """Shake the hanging arms loose, one after the other."""
    rng, lasts = plan.rng, end - start
    for side, first in ((LEAD, start), (REAR, start + 0.45 * lasts)):
        beat = float(rng.uniform(0.21, 0.25))
        for number in range(int(0.5 * lasts / beat)):
            size = (0.6, 1.0)[number > 0] * (1.0 if number % 2 == 0 else -1.0)
            plan.play(_SHAKES[side], (first + number * beat,) * 4, size, unit=beat)
        sign = 1.0 if side == LEAD else -1.0
        plan.accent(Channel(_HANDS[side] + 1), 0.05, first - 0.2, first + 0.2, first + 0.5 * lasts, end + 0.2)
        plan.accent(Channel.BEND, -0.06 * sign, first - 0.2, first + 0.3, first + 0.4 * lasts, end)
        plan.accent(Channel.HEAD_NOD, 0.12, first - 0.1, first + 0.4, first + 0.4 * lasts, end)


def _roll_shoulders(plan: Choreographer, start: float, end: float) -> None:
    """Roll the shoulders backwards, twice, and the neck after them."""
    lasts = (end - start) / 2.6
    for now in (start, start + lasts):
        plan.play(_FORTH, (now - 0.1, now, now, now), unit=lasts)
        plan.play(_SHOULDERS, (now, now, now, now), unit=lasts)
    now = start + 2.0 * lasts
    for sign, first in ((1.0, now - 0.2), (-1.0, now + 0.35 * lasts)):
        plan.play(_NECK, (first,) * 4, sign, unit=lasts)


def _stoop(plan: Choreographer, start: float, end: float) -> None:
    """Stoop, put the hands on the knees, and breathe deeply there."""
    plan.play(_STOOP, (start - 0.3, start + 0.5, end - 0.5, end + 0.3), spread=0.03)
    beats = np.linspace(start + 0.3, end - 0.2, 4)
    for first, last in pairwise(beats):
        plan.play(_HEAVE, (float(first),) * 4, spread=0.1, unit=float(last - first))


_shift_weight = partial(_to_both_sides, 0.2, ((_SHIFT, 0.1), (_GLANCE, 0.2)))
_IDLE: dict[str, Callable[[Choreographer, float, float], None]] = {
    "at_ease": _shift_weight,
    "look_about": partial(_to_both_sides, 0.0, ((_LOOK, 0.1),)),
    "shake_arms": _shake_arms,
    "roll_shoulders": _roll_shoulders,
    "hands_on_knees": _stoop,
}
_WALKS = {"walk_off_left": 1.0, "walk_off_right": -1.0}
_BACKS = {"step_back": 1, "back_off": 2, "back_away": 4}
"""Steps back from an opponent, in which the guard is lowered."""
ON_THE_SPOT = tuple(_IDLE)
"""Kinds of rests on the spot."""
AT_EASE = (*ON_THE_SPOT, *_BACKS)
"""Kinds of rests into which no walk leads."""
RESTS = (*AT_EASE, *_WALKS)
"""Kinds of rests: on the spot, stepping back while the guard is lowered, and walking off by a turn to either side."""


def write_rest(plan: Choreographer, kind: str, moves: bool) -> Score:
    """Plan a clip of one rest: a second in the guard, the rest, and a second in the guard.

    Where the boxer ``moves``, it steps about in the guard before the rest and after it, instead of standing.
    """
    rng = plan.rng
    start = _step_about(plan, 0.4, _GUARD) if moves else _GUARD
    start += float(rng.uniform(0.0, 0.15))
    down = start + plan.about(_LOWERS, 0.06)
    prints = plan.prints.copy()
    eases, eased = start, down
    if kind in _BACKS:
        eases = _back_off(plan, start + 0.1, _BACKS[kind])
        eased = stands = max(down, _stand_square(plan, eases, LEAD))
    else:
        stands = max(down, _stand_square(plan, start + 0.15, REAR))
    if kind in _WALKS:
        stands = _walk_off(plan, stands + float(rng.uniform(1.2, 1.5)), _WALKS[kind])
    up = stands + float(rng.uniform(4.6, 5.6))
    _IDLE.get(kind, _shift_weight)(plan, stands + 0.2, up - 0.3)
    if kind not in ON_THE_SPOT:
        # The guard keeps the lead foot where it is, and looks where the body does.
        plan.ground_frame = stance_on(plan, plan.style, LEAD, float(plan.ground_frame[2]))
        prints = stance_prints(plan.style, plan.ground_frame)
    back, returned = up + 0.15, up + 0.15 + plan.about(0.42, 0.06)
    plan.plant(REAR, back, returned, prints[REAR], plan.about(0.045, 0.1), GUARD_SWING)
    plan.twist_foot(LEAD, back + 0.1, returned + 0.1, float(prints[LEAD, 2] - plan.prints[LEAD, 2]))
    end = up + plan.about(_RAISES, 0.05)
    _stand_easy(plan, (start, down), (eases, eased), (up, end))
    last = _step_about(plan, end, end + _AFTER) + 0.3 if moves else end + _AFTER
    plan.score.rests.append(Rest(kind, start, eased, up, end))
    return plan.finish(last)


def _step_about(plan: Choreographer, begin: float, until: float) -> float:
    """Step about in the guard from ``begin`` until ``until`` [s]; return when the last step is done [s]."""
    rng, end = plan.rng, begin
    while end < until:
        angle, turn, quick = float(rng.uniform(-np.pi, np.pi)), float(rng.normal(0.0, 0.2)), bool(rng.uniform() < 0.6)
        far = float(rng.uniform(0.2, 0.4) if quick else rng.uniform(0.07, 0.25))
        end = plan.move(end, far * np.cos(angle), far * np.sin(angle), turn, plan.about(1.1), quick)
    return end


def _stand_square(plan: Choreographer, start: float, foot: int) -> float:
    """Step beside the other foot with one; return when both stand side by side [s]."""
    other, side = 1 - foot, _HALF_WIDTH if foot == LEAD else -_HALF_WIDTH
    x, z, yaw = plan.prints[other]
    heading = float(plan.ground_frame[2])
    middle = ground.compose([x, z, heading], [side, 0.0, 0.0])
    landing = ground.compose(middle, [side, float(plan.rng.uniform(-0.02, 0.02)), _TOE_OUT[foot]])
    end = start + plan.about(0.52, 0.06)
    plan.plant(foot, start, end, landing, plan.about(0.05, 0.1), GUARD_SWING)
    plan.twist_foot(other, end - 0.12, end + 0.3, heading + _TOE_OUT[other] - float(yaw))
    return end + 0.3


def _back_off(plan: Choreographer, start: float, steps: int) -> float:
    """Shuffle back by some steps; return when the last foot is down [s]."""
    for _ in range(steps):
        start = plan.move(start, -plan.about(0.37, 0.05), 0.0, tempo=0.65, quick=True)
    return start


def _walk_off(plan: Choreographer, start: float, side: float) -> float:
    """Look and turn away, walk some metres and stop, feet side by side; return when both stand [s]."""
    turn, count = side * float(plan.rng.uniform(1.8, 2.8)), 4
    plan.accent(Channel.HEAD_TURN, 0.35 * side, start - 0.45, start + 0.15, start + 0.3, start + 1.2)
    around = [Stride(STROLL, 0.42, turn / count)] * count
    straight = [Stride(STROLL, float(share)) for share in plan.rng.uniform(0.95, 1.05, 5)]
    balls = ((_HALF_WIDTH, 0.0), (-_HALF_WIDTH, 0.0))
    square = replace(plan.style, balls=balls, foot_yaws=_TOE_OUT, blade=0.0)
    return travel(plan, start, [*around, *straight, Stride(STROLL, 0.8)], closing=square)

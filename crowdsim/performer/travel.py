"""Travel of the embedded boxer: he walks and jogs out of the guard and back into it, and shuffles in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.motion import ground
from crowdsim.performer.gait import GUARD_SWING, JOG, Gait
from crowdsim.performer.score import LEAD, REAR, Channel, Style
from crowdsim.performer.steps import Stepper

_LEAST_STAND = 0.09
"""Least time for which a foot stands between two steps [s]."""
_HANDS = frozenset(channel for channel in Channel if channel >= Channel.LEAD_RAISE)


@dataclass(frozen=True)
class Stride:
    """One step of a gait.

    Attributes:
        gait: The gait.
        share: Length of the step, as a share of the gait's.
        turn: By how much the heading grows meanwhile [rad].
    """

    gait: Gait
    share: float = 1.0
    turn: float = 0.0


def shuffle(
    plan: Stepper, start: float, ahead: float, left: float, count: int, turn: float = 0.0, tempo: float = 1.0
) -> float:
    """Travel in the guard by quick steps of (ahead, left) [m] each; return when the last foot is down [s]."""
    end = begin = max(start, plan.feet_free)
    for _ in range(count):
        end = plan.move(end, plan.about(ahead, 0.05), plan.about(left, 0.05), turn, tempo, quick=True)
    plan.travelled("shuffle", begin, end)
    return end


def travel(
    plan: Stepper,
    start: float,
    strides: Sequence[Stride],
    facing: float = 0.0,
    relaxed: float = 1.0,
    closing: Style | None = None,
) -> float:
    """Walk or jog out of the guard and back into it; return when the last foot is down [s].

    Args:
        plan: Where steps are written.
        start: When the first foot leaves the floor at the earliest [s].
        strides: The steps; one more, into the guard, follows them.
        facing: Turn of that last step [rad].
        relaxed: How far hands go down, 1 as in the gait, 0 for hands up.
        closing: Where the feet stand in the end; in the guard when None.
    """
    start = max(start, plan.feet_free)
    heading = float(plan.ground_frame[2]) + strides[0].turn
    foot, point = _first_foot(plan, heading, strides[0].turn)
    landed = [-np.inf, -np.inf]
    touchdowns: list[float] = []
    for index, stride in enumerate(strides):
        gait = stride.gait
        if index:
            heading += stride.turn
        point = ground.compose([point[0], point[1], heading], [0.0, stride.share * gait.step, 0.0])
        down, lift_off = _swing_times(plan, start, touchdowns, strides, index)
        lift_off = max(lift_off, landed[foot] + _LEAST_STAND, start)
        side = gait.width if foot == LEAD else -gait.width
        toe_out = 0.10 if foot == LEAD else -0.14
        noise = plan.rng.uniform(-0.012, 0.012, 2)
        landing = ground.compose(point, [side + noise[0], noise[1], toe_out + plan.rng.uniform(-0.03, 0.03)])
        plan.plant(foot, lift_off, down, landing, plan.about(gait.lift, 0.08), gait.swing)
        if stride.turn:
            plan.face(max(lift_off, down - 0.4), down + 0.1, stride.turn)
            if abs(stride.turn) > 0.3:
                plan.twist_foot(1 - foot, max(lift_off, landed[1 - foot]), down, 0.6 * stride.turn)
        landed[foot] = down
        touchdowns.append(down)
        foot = 1 - foot
    end = _close(plan, closing or plan.style, foot, touchdowns[-1], strides[-1].gait, heading, facing)
    _ride(plan, start, touchdowns, end, strides, 1 - foot, relaxed)
    _note(plan, start, touchdowns, end, strides)
    plan.feet_free = end + 0.02
    return end


def _swing_times(
    plan: Stepper, start: float, touchdowns: Sequence[float], strides: Sequence[Stride], index: int
) -> tuple[float, float]:
    """Return when the foot of a stride is down and when it leaves the floor, in the rhythm of the gait before [s]."""
    stride = strides[index]
    gait = stride.gait
    if index == 0:
        return start + 2.0 * gait.seconds * gait.aloft * plan.about(1.0, 0.02), start
    before = strides[index - 1].gait
    seconds = 0.5 * (gait.seconds + before.seconds) * (0.85 + 0.15 * stride.share) * plan.about(1.0, 0.015)
    return touchdowns[-1] + seconds, touchdowns[-1] - before.seconds * (2.0 * before.aloft - 1.0)


def _first_foot(plan: Stepper, heading: float, turn: float) -> tuple[int, np.ndarray]:
    """Return the foot that goes first, the one behind, and the point of the path that is abreast of the other one."""
    way = np.array([np.sin(heading), np.cos(heading)])
    middle = plan.prints[:, :2].mean(axis=0)
    along = (plan.prints[:, :2] - middle) @ way
    if abs(along[LEAD] - along[REAR]) < 0.16:
        foot = LEAD if turn > 0.0 else REAR
    else:
        foot = LEAD if along[LEAD] < along[REAR] else REAR
    return foot, np.append(middle + max(along[1 - foot], 0.0) * way, heading)


def _close(plan: Stepper, style: Style, foot: int, down: float, gait: Gait, heading: float, facing: float) -> float:
    """Step into a stance about the foot that came down last, which turns on its ball; return when that is done [s]."""
    other = 1 - foot
    heading += facing
    ball = (style.lead_ball, style.rear_ball)[other]
    ground_frame = ground.compose([*plan.prints[other, :2], heading], [-ball[0], -ball[1], 0.0])
    goal = ground.compose(ground_frame, [*(style.lead_ball, style.rear_ball)[foot], style.foot_yaws[foot]])
    far = float(np.hypot(*(goal[:2] - plan.prints[foot, :2])))
    lift_off = down - (0.10 if gait is JOG else -0.03)
    end = lift_off + float(np.clip(0.20 + 0.20 * far, 0.22, 0.40))
    plan.plant(foot, lift_off, end, goal, 0.03 + 0.05 * far, GUARD_SWING)
    twist = heading + style.foot_yaws[other] - plan.prints[other, 2]
    plan.twist_foot(other, down + 0.02, end + 0.10, float(ground.wrap(twist)))
    if facing:
        plan.face(lift_off, end, facing)
    plan.ground_frame = ground_frame
    return end


def _ride(
    plan: Stepper,
    start: float,
    touchdowns: Sequence[float],
    end: float,
    strides: Sequence[Stride],
    last_foot: int,
    relaxed: float,
) -> None:
    """Let the body go along: each touchdown has a posture, and between touchdowns one passes into the next."""
    times = [start - 0.16, *touchdowns, end + 0.16]
    count = len(strides)
    for index, stride in enumerate(strides):
        gait = stride.gait
        before, now, after = times[index : index + 3]
        foot = last_foot if (count - 1 - index) % 2 == 0 else 1 - last_foot
        side = 1.0 if foot == LEAD else -1.0
        ends = 0.75 if index in (0, count - 1) else 1.0
        for parts, sign in ((gait.posture, ends), (gait.swung, side * min(stride.share, 1.0) * ends)):
            for channel, size in parts:
                hands = relaxed if channel in _HANDS and parts is gait.posture else 1.0
                plan.accent(channel, size * sign * hands, before, now, now, after)
        middle, half = now + gait.lowest * gait.seconds, 0.5 * gait.seconds
        bob = gait.bob * min(stride.share, 1.0)
        plan.accent(Channel.HEIGHT, -bob, middle - half, middle, middle, middle + half)
    swift = 0.20 if strides[0].gait is JOG else 0.09
    plan.accent(Channel.PELVIS_TILT, swift, start - 0.25, start + 0.15, touchdowns[0], times[2])
    hard = 0.16 if strides[-1].gait is JOG else 0.07
    plan.accent(Channel.PELVIS_TILT, -hard, times[-2] - 0.25, times[-2], times[-2] + 0.05, end + 0.3)


def _note(plan: Stepper, start: float, touchdowns: Sequence[float], end: float, strides: Sequence[Stride]) -> None:
    """Note which gait is travelled when."""
    begin = start
    for index, stride in enumerate(strides):
        following = strides[index + 1].gait if index + 1 < len(strides) else None
        if following is not stride.gait:
            finish = touchdowns[index] if following is not None else end
            plan.travelled(stride.gait.name, begin, finish)
            begin = finish

"""Travel of the embedded boxer: he walks and jogs out of the guard and back into it, and shuffles in it.

Figures of gaits are those of men of about 1.75 m: a walk of 1.5 m/s takes steps of 0.75 m, a jog of 2.7 m/s flies for a
tenth of a second between steps of 0.95 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.moves import part
from crowdsim.performer.score import GUARD_SWING, LEAD, REAR, Accent, Style, Swing, Travel
from crowdsim.performer.score import Channel as C

_WALK_SWING = Swing(push=0.29, settle=0.27, ramps=(0.23, 0.24), toe_off=1.0, roll=0.26, toe_up=0.20, load=0.0)
_JOG_SWING = Swing(push=0.23, settle=0.21, ramps=(0.24, 0.24), toe_off=1.0, roll=0.17, toe_up=0.06, load=0.0, fall=3.2)


@dataclass(frozen=True)
class Gait:
    """A gait in which feet pass one another, in steps of which each ends where the next one begins.

    Attributes:
        name: What it is called.
        swing: How a foot is carried.
        step: Length of a step [m].
        seconds: Time from touchdown to touchdown of the other foot [s].
        aloft: Time for which a foot swings, as a share of two steps.
        width: Distance of each foot from the line of travel [m].
        lift: Height that the ball of a swinging foot clears [m].
        bob: Height that the pelvis rises and falls by [m].
        lowest: When the pelvis is lowest, in steps after a touchdown.
        posture: What both feet's steps share, on top of the guard; it takes a bladed guard square to the way.
        swung: What changes sides: sizes at the touchdown of the lead foot; of the rear foot, their opposites.
    """

    name: str
    swing: Swing
    step: float
    seconds: float
    aloft: float
    width: float
    lift: float
    bob: float
    lowest: float
    posture: tuple[Accent, ...]
    swung: tuple[Accent, ...]


def _posture(**sizes: float) -> tuple[Accent, ...]:
    return part(0.0, 0.0, 0.0, 0.0, **sizes)


# fmt: off
WALK = Gait(
    "walk", _WALK_SWING, step=0.71, seconds=0.465, aloft=0.42, width=0.075, lift=0.045, bob=0.032, lowest=0.05,
    posture=_posture(
        PELVIS_TURN=0.50, LEAD_HEEL=-0.08, REAR_HEEL=-0.27, HEIGHT=0.038, SHIFT_Z=-0.055, PELVIS_TILT=-0.06,
        FLEX=-0.09, HEAD_NOD=-0.06, LEAD_RAISE=-0.05, REAR_RAISE=-0.05, LEAD_HAND_X=0.03, LEAD_HAND_Y=-0.20,
        LEAD_HAND_Z=-0.06, REAR_HAND_X=-0.10, REAR_HAND_Y=-0.20, REAR_HAND_Z=0.05),
    swung=_posture(
        PELVIS_TURN=-0.08, TWIST=0.15, LEAD_HAND_Z=-0.055, REAR_HAND_Z=0.055, LEAD_HAND_Y=-0.015, REAR_HAND_Y=0.015),
)
JOG = Gait(
    "jog", _JOG_SWING, step=0.93, seconds=0.345, aloft=0.66, width=0.055, lift=0.11, bob=0.065, lowest=0.36,
    posture=_posture(
        PELVIS_TURN=0.50, LEAD_HEEL=-0.08, REAR_HEEL=-0.27, HEIGHT=0.045, SHIFT_Z=-0.03, PELVIS_TILT=0.03,
        FLEX=-0.02, HEAD_NOD=-0.10, LEAD_HAND_X=0.02, LEAD_HAND_Y=-0.16, LEAD_HAND_Z=-0.08, REAR_HAND_X=-0.09,
        REAR_HAND_Y=-0.16, REAR_HAND_Z=0.04),
    swung=_posture(
        PELVIS_TURN=-0.11, TWIST=0.24, LEAD_HAND_Z=-0.07, REAR_HAND_Z=0.07, LEAD_HAND_Y=-0.03, REAR_HAND_Y=0.03),
)
STROLL = Gait(
    "stroll", _WALK_SWING, step=0.66, seconds=0.52, aloft=0.40, width=0.07, lift=0.04, bob=0.026, lowest=0.05,
    posture=(),
    swung=_posture(
        PELVIS_TURN=-0.07, TWIST=0.13, LEAD_HAND_Z=-0.13, REAR_HAND_Z=0.13, LEAD_HAND_Y=-0.012, REAR_HAND_Y=0.012),
)
"""A walk at ease: what is held and how the body stands is no part of it, but the arms swing."""
# fmt: on

_LEAST_STAND = 0.09
"""Least time for which a foot stands between two steps [s]."""


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
    plan: Choreographer, start: float, ahead: float, left: float, count: int, turn: float = 0.0, tempo: float = 1.0
) -> float:
    """Travel in the guard by quick steps of (ahead, left) [m] each; return when the last foot is down [s]."""
    end = begin = max(start, plan.feet_free)
    for _ in range(count):
        end = plan.move(end, plan.about(ahead, 0.05), plan.about(left, 0.05), turn, tempo, quick=True)
    plan.score.travels.append(Travel("shuffle", begin, end))
    return end


def travel(
    plan: Choreographer,
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
    times, feet = [start], []
    for index, stride in enumerate(strides):
        gait = stride.gait
        if index:
            heading += stride.turn
        point = ground.compose([point[0], point[1], heading], [0.0, stride.share * gait.step, 0.0])
        if index:
            # The rhythm is that of the gait before.
            before = strides[index - 1].gait
            seconds = 0.5 * (gait.seconds + before.seconds) * (0.85 + 0.15 * stride.share) * plan.about(1.0, 0.015)
            down, lift_off = times[-1] + seconds, times[-1] - before.seconds * (2.0 * before.aloft - 1.0)
        else:
            down, lift_off = start + 2.0 * gait.seconds * gait.aloft * plan.about(1.0, 0.02), start
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
        times.append(down)
        feet.append(foot)
        foot = 1 - foot
    end = _close(plan, closing or plan.style, foot, times[-1], strides[-1].gait, heading, facing)
    _ride(plan, [*times, end], strides, feet, relaxed)
    begin = start
    for index, stride in enumerate(strides):
        last = index + 1 == len(strides)
        if last or strides[index + 1].gait is not stride.gait:
            finish = end if last else times[index + 1]
            plan.score.travels.append(Travel(stride.gait.name, begin, finish))
            begin = finish
    plan.feet_free = end + 0.02
    return end


def _first_foot(plan: Choreographer, heading: float, turn: float) -> tuple[int, Array]:
    """Return the foot that goes first, the one behind, and the point of the path that is abreast of the other one."""
    way = np.array([np.sin(heading), np.cos(heading)])
    middle = plan.prints[:, :2].mean(axis=0)
    along = (plan.prints[:, :2] - middle) @ way
    if abs(along[LEAD] - along[REAR]) < 0.16:
        foot = LEAD if turn > 0.0 else REAR
    else:
        foot = LEAD if along[LEAD] < along[REAR] else REAR
    return foot, np.append(middle + max(along[1 - foot], 0.0) * way, heading)


def stance_on(plan: Choreographer, style: Style, foot: int, heading: float) -> Array:
    """Return the ground frame of a stance with a heading [rad] and one foot where it is now. Shape (3,)."""
    x, z = style.balls[foot]
    return ground.compose([*plan.prints[foot, :2], heading], [-x, -z, 0.0])


def _close(
    plan: Choreographer, style: Style, foot: int, down: float, gait: Gait, heading: float, facing: float
) -> float:
    """Step into a stance about the foot that came down last, which turns on its ball; return when that is done [s]."""
    other = 1 - foot
    heading += facing
    ground_frame = stance_on(plan, style, other, heading)
    goal = ground.compose(ground_frame, [*style.balls[foot], style.foot_yaws[foot]])
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
    plan: Choreographer, times: Sequence[float], strides: Sequence[Stride], feet: Sequence[int], relaxed: float
) -> None:
    """Let the body go along: each touchdown has a posture, and between touchdowns one passes into the next.

    ``times`` are the start, all touchdowns and the end [s], ``feet`` those of the strides.
    """
    start, *touchdowns, end = times
    times = [start - 0.16, *touchdowns, end + 0.16]
    for index, stride in enumerate(strides):
        gait = stride.gait
        before, now, after = times[index : index + 3]
        side = 1.0 if feet[index] == LEAD else -1.0
        ends = 0.75 if index in (0, len(strides) - 1) else 1.0
        for held in gait.posture:
            size = held.size * ends * (relaxed if held.channel >= C.LEAD_RAISE else 1.0)
            plan.accent(held.channel, size, before, now, now, after)
        plan.play(gait.swung, (before, now, now, after), side * min(stride.share, 1.0) * ends)
        middle, half = now + gait.lowest * gait.seconds, 0.5 * gait.seconds
        bob = gait.bob * min(stride.share, 1.0)
        plan.accent(C.HEIGHT, -bob, middle - half, middle, middle, middle + half)
    swift = 0.20 if strides[0].gait is JOG else 0.09
    plan.accent(C.PELVIS_TILT, swift, start - 0.25, start + 0.15, touchdowns[0], times[2])
    hard = 0.16 if strides[-1].gait is JOG else 0.07
    plan.accent(C.PELVIS_TILT, -hard, times[-2] - 0.25, times[-2], times[-2] + 0.05, end + 0.3)

"""From footsteps to the tracks of both feet, and of the pelvis that they carry over the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.performer.curves import glide, pulse, step, window
from crowdsim.performer.score import Footstep, Score, Style

_LEAN = 0.2
"""Time before and after a step in which the weight goes over to the other foot and comes back [s]."""


@dataclass(frozen=True)
class Footwork:
    """Tracks over F frames; feet are lead, rear.

    Attributes:
        heading: Heading of the stance, continuous [rad]. Shape (F,).
        balls: Position of the balls of the feet on the floor (x, z) [m]. Shape (F, 2, 2).
        lifts: Height of the balls over where they are when planted [m]. Shape (F, 2).
        yaws: Heading of the feet, continuous [rad]. Shape (F, 2).
        heels: Lift of the heels that comes from stepping [rad]. Shape (F, 2).
        rolls: Lift of the heels of feet that roll over the ball in a gait, on top of all else [rad]. Shape (F, 2).
        toes_up: Lift of the toes of a foot that lands on its heel [rad]. Shape (F, 2).
        points: Turn of the toes back to level, 1 when planted and 0 in mid-air. Shape (F, 2).
        planted: Whether the ball stands. Shape (F, 2), bool.
        carried: Where the feet carry the pelvis (x, z) [m]. Shape (F, 2).
        loads: Share of the weight that steps put on the lead foot, from -1 (none) over 0 (half) to 1. Shape (F,).
    """

    heading: Array
    balls: Array
    lifts: Array
    yaws: Array
    heels: Array
    rolls: Array
    toes_up: Array
    points: Array
    planted: Array
    carried: Array
    loads: Array


def stance_prints(style: Style, ground_frame: ArrayLike) -> Array:
    """Return where the feet stand in a stance whose ground transform is given: (x, z, yaw), lead and rear. (2, 3)."""
    return ground.compose(ground_frame, np.column_stack([style.balls, style.foot_yaws]))


def trace_feet(score: Score, times: Array) -> Footwork:
    """Carry out the footsteps, pivots and turns of a score at the given times [s], which ascend. Shape (F,)."""
    frames = len(times)
    stance = stance_prints(score.style, score.start)
    prints, print_yaws = stance[:, :2], stance[:, 2]
    balls = np.tile(prints, (frames, 1, 1))
    yaws = np.tile(print_yaws, (frames, 1))
    lifts, heels, rolls, toes_up = np.zeros((4, frames, 2))
    points, planted = np.ones((frames, 2)), np.ones((frames, 2), bool)
    carried = np.tile(prints.mean(axis=0), (frames, 1))
    loads = np.zeros(frames)
    heading = np.full(frames, score.start[2])
    for turn in score.turns:
        heading += turn.angle * step(times, turn.start, turn.end)
    for pivot in score.pivots:
        yaws[:, pivot.foot] += pivot.angle * step(times, pivot.start, pivot.end)
    positions = prints.copy()
    facing = print_yaws.copy()
    pivots = sorted(score.pivots, key=lambda pivot: pivot.start)
    for footstep in sorted(score.footsteps, key=lambda footstep: footstep.start):
        foot, swing = footstep.foot, footstep.swing
        start, end = footstep.start, footstep.end
        shift = np.array([footstep.x, footstep.z]) - positions[foot]
        turned = sum(p.angle for p in pivots if p.foot == foot and p.start < start)
        gone = step(times, start, end) if swing.ramps is None else glide(times, start, end, *swing.ramps)
        balls[:, foot] += shift * gone[:, None]
        yaws[:, foot] += (footstep.yaw - facing[foot] - turned) * step(times, start, end)
        facing[foot] = footstep.yaw - turned
        positions[foot] += shift
        length = end - start
        carried += 0.5 * shift * step(times, start - swing.push, end + swing.settle)[:, None]
        aloft = window(times, start, end)
        x = np.clip((times[aloft] - start) / length, 0.0, 1.0)
        up = _bump(x, swing.fall)
        lifts[aloft, foot] += footstep.lift * up
        points[aloft, foot] -= 0.6 * up
        planted[(times > start) & (times < end), foot] = False
        _roll_foot(footstep, float(np.hypot(*shift)), times, heels[:, foot], rolls[:, foot], toes_up[:, foot])
        leaning = window(times, start - _LEAN, end + _LEAN)
        at = np.clip((times[leaning] - start + _LEAN) / (length + 2.0 * _LEAN), 0.0, 1.0)
        loads[leaning] += swing.load * (1.0 if foot else -1.0) * _bump(at)
    return Footwork(heading, balls, lifts, yaws, heels, rolls, toes_up, points, planted, carried, loads)


def _bump(x: Array, fall: float = 3.0) -> Array:
    """Return a smooth bump that is 0 at 0 and 1, and 1 in the middle, or before it where ``fall`` is above 3."""
    middle = 3.0 / (3.0 + fall)
    return np.asarray((x / middle) ** 3 * ((1.0 - x) / (1.0 - middle)) ** fall)


def _roll_foot(footstep: Footstep, far: float, times: Array, heels: Array, rolls: Array, toes_up: Array) -> None:
    """Add the roll of one foot (F,) over its ball before it leaves the floor, and over its heel as it lands."""
    swing, start, end = footstep.swing, footstep.start, footstep.end
    length = end - start
    near = window(times, start - swing.roll, end)
    if swing.toe_off is None:
        off = np.clip((times[near] - start + swing.roll) / (length + 0.5 * swing.roll), 0.0, 1.0)
        heels[near] += (0.18 + 0.5 * far) * _bump(off)
        return
    rolls[near] += swing.toe_off * pulse(
        times[near], start - swing.roll, start + 0.15 * length, start + 0.2 * length, start + 0.9 * length
    )
    if swing.toe_up > 0.0:
        toes_up[near] += swing.toe_up * pulse(
            times[near], start + 0.45 * length, start + 0.8 * length, start + 0.82 * length, end
        )

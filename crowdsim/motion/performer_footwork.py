"""From footsteps to the tracks of both feet, and of the pelvis that they carry over the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import ground
from crowdsim.motion.performer_curves import step, window
from crowdsim.motion.performer_score import Score

Array = NDArray[Any]

_PUSH, _SETTLE = 0.18, 0.32
"""The body moves before a foot leaves the floor, and comes to rest after it is down [s]."""

_LEAN = 0.2
"""Time before and after a step in which the weight goes over to the other foot and comes back [s]."""


@dataclass(frozen=True)
class Footwork:
    """Tracks over F frames; feet are lead, rear.

    Attributes:
        heading: Heading of the stance, continuous [rad]. Shape (F,).
        balls: Place of the balls of the feet on the floor (x, z) [m]. Shape (F, 2, 2).
        lifts: Height of the balls over where they are when planted [m]. Shape (F, 2).
        yaws: Heading of the feet, continuous [rad]. Shape (F, 2).
        heels: Lift of the heels that comes from stepping [rad]. Shape (F, 2).
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
    points: Array
    planted: Array
    carried: Array
    loads: Array


def footprints(score: Score) -> tuple[Array, Array]:
    """Return where the feet stand at first: balls (2, 2) as (x, z) [m] and headings (2,) [rad]."""
    places = np.array([score.style.lead_ball, score.style.rear_ball])
    points = np.stack([places[:, 0], np.zeros(2), places[:, 1]], axis=-1)
    world = ground.to_world(np.array(score.start), points)
    return world[:, [0, 2]], score.start[2] + np.array(score.style.foot_yaws)


def trace_feet(score: Score, times: Array) -> Footwork:
    """Carry out the footsteps, pivots and turns of a score at the given times [s], which ascend. Shape (F,)."""
    frames = len(times)
    prints, print_yaws = footprints(score)
    balls = np.tile(prints, (frames, 1, 1))
    yaws = np.tile(print_yaws, (frames, 1))
    lifts, heels = np.zeros((frames, 2)), np.zeros((frames, 2))
    points, planted = np.ones((frames, 2)), np.ones((frames, 2), bool)
    carried = np.tile(prints.mean(axis=0), (frames, 1))
    loads = np.zeros(frames)
    heading = np.full(frames, score.start[2])
    for turn in score.turns:
        heading += turn.angle * step(times, turn.start, turn.end)
    for pivot in score.pivots:
        yaws[:, pivot.foot] += pivot.angle * step(times, pivot.start, pivot.end)
    places = prints.copy()
    facing = print_yaws.copy()
    pivots = sorted(score.pivots, key=lambda pivot: pivot.start)
    for swing in sorted(score.footsteps, key=lambda swing: swing.start):
        foot = swing.foot
        shift = np.array([swing.x, swing.z]) - places[foot]
        turned = sum(p.angle for p in pivots if p.foot == foot and p.end <= swing.start)
        gone = step(times, swing.start, swing.end)[:, None]
        balls[:, foot] += shift * gone
        yaws[:, foot] += (swing.yaw - facing[foot] - turned) * gone[:, 0]
        facing[foot] = swing.yaw - turned
        places[foot] += shift
        length = swing.end - swing.start
        carried += 0.5 * shift * step(times, swing.start - _PUSH, swing.end + _SETTLE)[:, None]
        aloft = window(times, swing.start, swing.end)
        x = np.clip((times[aloft] - swing.start) / length, 0.0, 1.0)
        up = 64.0 * (x * (1.0 - x)) ** 3
        lifts[aloft, foot] += swing.lift * up
        points[aloft, foot] -= 0.6 * up
        planted[(times > swing.start) & (times < swing.end), foot] = False
        near = window(times, swing.start - 0.12, swing.end)
        off = np.clip((times[near] - swing.start + 0.12) / (length + 0.06), 0.0, 1.0)
        heels[near, foot] += (0.18 + 0.5 * float(np.hypot(*shift))) * 64.0 * (off * (1.0 - off)) ** 3
        leaning = window(times, swing.start - _LEAN, swing.end + _LEAN)
        at = np.clip((times[leaning] - swing.start + _LEAN) / (length + 2.0 * _LEAN), 0.0, 1.0)
        loads[leaning] += (1.0 if foot else -1.0) * 64.0 * (at * (1.0 - at)) ** 3
    return Footwork(heading, balls, lifts, yaws, heels, points, planted, carried, loads)

"""Phrases of travel: run-ups on foot, shuffles every way, circles about an opponent, and bouncing on the spot."""

from __future__ import annotations

import numpy as np

from crowdsim.motion import ground
from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.travel import JOG, WALK, Gait, Stride, shuffle, travel

ROOM = 4.5
"""Distance from the middle of the floor that travel keeps within [m]."""
_SHARPEST = 0.95
"""Most that one step turns [rad]."""


def run_up(plan: Choreographer, start: float, seconds: float, sharp: float = 0.5) -> float:
    """Walk or jog a distance and end in the guard; return when the last foot is down [s].

    Args:
        plan: Where steps are written.
        start: When it may begin [s].
        seconds: About how long it may take at the most [s].
        sharp: Share of run-ups that leave the present heading.
    """
    rng = plan.rng
    far = float(rng.triangular(0.9, 2.4, 8.0)) if rng.uniform() < 0.75 else float(rng.uniform(0.6, 2.2))
    far = min(far, max(seconds - 1.5, 0.6))
    turn = float(rng.uniform(-np.pi, np.pi)) if rng.uniform() < sharp else float(rng.normal(0.0, 0.12))
    end = ground.compose(plan.ground_frame, [0.0, 0.0, turn])
    end = ground.compose(end, [0.0, far, 0.0])
    if np.hypot(end[0], end[1]) > ROOM:
        x, z = rng.uniform(-0.35 * ROOM, 0.35 * ROOM, 2)
        dx, dz = x - plan.ground_frame[0], z - plan.ground_frame[1]
        turn = float(ground.wrap(np.arctan2(dx, dz) - plan.ground_frame[2]))
        far = min(max(float(np.hypot(dx, dz)), 0.7), max(seconds - 1.5, 0.6))
    relaxed = float(rng.uniform(0.0, 0.25) if rng.uniform() < 0.6 else rng.uniform(0.5, 1.0))
    if abs(turn) > 0.7 and rng.uniform() < 0.4:
        start, turn = quick_turn(plan, start, turn), 0.0
    facing = float(rng.normal(0.0, 0.12)) if rng.uniform() < 0.8 else float(rng.uniform(-0.8, 0.8))
    jog = far > 2.0 and rng.uniform() < 0.65
    return travel(plan, start, _strides(plan, far, turn, jog), facing, relaxed)


def _strides(plan: Choreographer, far: float, turn: float, jog: bool) -> list[Stride]:
    """Return steps over a distance ``far`` [m], the first of which turn by ``turn`` [rad]."""
    rng = plan.rng
    strides, left = [], far - 0.35
    count = int(np.ceil(abs(turn) / _SHARPEST)) if abs(turn) > 0.05 else 0
    for index in range(count):
        share = 0.9 if count == 1 and abs(turn) < 0.4 else 0.35 + 0.5 * index / max(count, 2)
        strides.append(Stride(WALK, share * float(rng.uniform(0.9, 1.1)), turn / count))
    left -= sum(0.5 * stride.share * WALK.step for stride in strides)
    gait: Gait = JOG if jog else WALK
    pace = float(rng.uniform(0.9, 1.1))
    curve = float(rng.uniform(-0.4, 0.4)) if rng.uniform() < 0.35 else 0.0
    about = left > 2.5 and rng.uniform() < 0.15
    if not strides:
        strides.append(Stride(gait, 0.8 * pace))
        left -= 0.8 * pace * gait.step
    while left > 0.35 * WALK.step:
        if jog and left < 0.8 * JOG.step:
            gait = WALK
        share = min(pace, max(left / gait.step, 0.4))
        if about and left < 0.6 * far:
            quarter = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.75, 0.9))
            strides += [Stride(WALK, 0.6), *[Stride(WALK, 0.4, quarter)] * int(rng.integers(2, 5))]
            about = False
        strides.append(Stride(gait, share, curve * float(rng.uniform(0.5, 1.0)) * min(share, 1.0)))
        left -= share * gait.step
    if strides[-1].gait is JOG:
        strides.append(Stride(WALK, 0.8))
    return strides


def quick_turn(plan: Choreographer, start: float, turn: float) -> float:
    """Turn in the guard by at most a right angle at a time; return when that is done [s]."""
    count = int(np.ceil(abs(turn) / 1.65))
    for _ in range(count):
        start = plan.pivot(start, turn / count, plan.about(1.35, 0.05))
    return start


def shuffle_any_way(plan: Choreographer, start: float, most: int = 6) -> float:
    """Shuffle some steps in any direction, straight or about an opponent; return when that is done [s]."""
    rng = plan.rng
    x, z, heading = plan.ground_frame
    angle = float(rng.uniform(-np.pi, np.pi))
    if np.hypot(x, z) > 0.7 * ROOM:
        angle = float(np.arctan2(-x, -z) - heading + rng.normal(0.0, 0.4))
    elif rng.uniform() < 0.4:
        angle = float(rng.choice([0.0, 0.0, np.pi, 0.5 * np.pi, -0.5 * np.pi]) + rng.normal(0.0, 0.1))
    far = float(rng.uniform(0.34, 0.43)) if rng.uniform() < 0.8 else float(rng.uniform(0.2, 0.34))
    ahead, left = far * np.cos(angle), 0.95 * far * np.sin(angle)
    turn = -left / float(rng.uniform(0.9, 1.6)) if abs(left) > 0.15 and rng.uniform() < 0.5 else 0.0
    return shuffle(plan, start, ahead, left, int(rng.integers(1, most + 1)), turn, plan.about(1.0, 0.04))


def in_and_out(plan: Choreographer, start: float, ahead: bool) -> float:
    """Shuffle up to an opponent, or away from one; return when that is done [s]."""
    far = float(plan.rng.uniform(0.32, 0.43))
    return shuffle(plan, start, far if ahead else -far, 0.0, int(plan.rng.integers(1, 5)))


def bounce(plan: Choreographer, start: float, seconds: float) -> float:
    """Bounce on the spot, or circle a little, for some seconds at most; return when that is done [s]."""
    rng = plan.rng
    end = start
    until = start + float(rng.uniform(0.6, seconds))
    side = float(rng.choice([-1.0, 1.0]))
    circling = rng.uniform() < 0.5
    ahead = 0.0
    while end < until:
        ahead = float(np.sign(-ahead if ahead else rng.uniform(-1.0, 1.0))) * float(rng.uniform(0.07, 0.15))
        left = side * float(rng.uniform(0.10, 0.22)) if circling else float(rng.uniform(-0.05, 0.05))
        turn = -left / float(rng.uniform(0.9, 1.5)) if circling else 0.0
        ahead *= 0.4 if circling else 1.0
        end = plan.move(end + float(rng.uniform(0.05, 0.5)), ahead, left, turn, plan.about(1.0, 0.08), quick=True)
    return end

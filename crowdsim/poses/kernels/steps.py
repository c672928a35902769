"""Compiled decision on what feet do about transitions: stay, be dragged, hop or step."""

import math
from typing import NamedTuple

import numpy as np

from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import BEGIN, END, GAP_X, GAP_Z, HEADING, RISE
from crowdsim.poses.kernels.transitions import measure_gaps

AIRBORNE, STAYS, STEP = 0, 1, 2
"""Kinds of moves: the foot is in the air; it stays on the floor all along; it makes a step."""
HOP = 0.15
"""Least time of a hop [s]."""


class StepRules(NamedTuple):
    """When feet step for transitions, and how.

    Attributes:
        lifts_within: Time after a transition in which a foot comes up by itself, so that it needs no step [s].
        landed_within: Time before a transition in which a foot came down, so that it needs no step [s].
        wait: Time from a transition to the step of the foot that leads [s].
        shortest: Least duration of a step [s].
        longest: Greatest duration of a step [s].
        highest: Greatest height of a step [m].
        ahead: Time before a transition from which on feet are dragged a little way [s].
        behind: Time after it up to which they are [s].
        drag: Furthest that they are dragged [m].
        speed: Mean speed of feet in the air that is never exceeded for a transition [m/s].
        drag_anyhow: How far they are dragged anyhow before they step [m].
    """

    lifts_within: float
    landed_within: float
    wait: float
    shortest: float
    longest: float
    highest: float
    ahead: float
    behind: float
    drag: float
    speed: float
    drag_anyhow: float


@kernel
def _plant_at(plants, n, foot, time):
    """Return beginning and end of the foot plant at a time, and the time in the air before it.

    Without one the end lies before the beginning.
    """
    spans = plants.spans[n, foot]
    for k in range(plants.counts[n, foot]):
        if spans[k, BEGIN] < time < spans[k, END]:
            return spans[k, BEGIN], spans[k, END], spans[k, BEGIN] - spans[k - 1, END] if k > 0 else HOP
    return 0.0, -1.0, HOP


@kernel
def _plan_foot(transition, foot, transitions, plants, motion, scale, rules, gait, near, steps):
    """Decide what a foot does about one transition; return how long the step takes that it needs, 0 without [s]."""
    time, move = transitions.times[transition], steps.moves[transition, foot]
    steps.kinds[transition, foot] = AIRBORNE
    move[BEGIN], move[END], move[RISE] = time - 1e-3, time, 0.0
    begin, end, air = _plant_at(plants, transitions.owners[transition], foot, time)
    if end < begin:
        return 0.0
    gap = steps.gaps[transition, foot]
    far = math.sqrt(gap[GAP_X] * gap[GAP_X] + gap[GAP_Z] * gap[GAP_Z])
    steps.kinds[transition, foot] = STAYS
    old, new = transitions.before[transition], transitions.after[transition]
    if not (motion.contacts[old, foot] and motion.contacts[new, foot]):
        # It is in the air for a moment, and goes over in a hop as long as it needs.
        steps.kinds[transition, foot] = STEP
        half = 0.5 * min(max(HOP, far / (scale * rules.speed)), 2.0 * HOP)
        move[BEGIN], move[END] = time - half, time + half
    elif time - begin < rules.landed_within and air > min(far / (scale * rules.speed), HOP) - 1e-6:
        move[BEGIN], move[END] = time - 11.0, time - 10.0
    elif end - time < rules.lifts_within:
        move[BEGIN], move[END] = time + 10.0, time + 11.0
    elif far < near * scale:
        move[BEGIN], move[END] = time - rules.ahead, time + rules.behind
    else:
        steps.kinds[transition, foot] = STEP
        way = far / scale
        high = min(gait.height + gait.height_each * way, rules.highest) * min(way / 0.04, 1.0)
        move[RISE] = high * scale
        return min(max(gait.seconds + gait.seconds_each * way, rules.shortest), rules.longest)
    return 0.0


@kernel
def _leader(transition, transitions, motion, gaps):
    """Return the foot that leads the way at a transition, and steps first where both do."""
    holds, heading = motion.holds[transitions.after[transition]], transitions.ground[transition, HEADING]
    x, z = holds[0, 0] - holds[1, 0], holds[0, 2] - holds[1, 2]
    x, z = x * math.cos(heading) + z * math.sin(heading), z * math.cos(heading) - x * math.sin(heading)
    along = x * (gaps[0, GAP_X] + gaps[1, GAP_X])
    along += z * (gaps[0, GAP_Z] + gaps[1, GAP_Z])
    return 0 if along > 0.0 else 1


@kernel(allocates=True)
def plan_steps(first, stop, transitions, plants, motion, toes, scales, rules, gait, steps):
    """Decide what feet of avatars do about transitions.

    A foot that comes up soon after the transition stays where it is until then, one that came down shortly before it
    came down where it stays. Where it is not far, and the foot gets there no faster than planted feet slide in the
    capture, it is dragged. Others make a step as the capture has them, before the transition or after it. All of it
    depends on what lies near the transition, and on no other transition.

    Args:
        first: First column.
        stop: One past the last.
        transitions: A ``Transitions``.
        plants: A ``FootPlants``.
        motion: The playback frames, a ``motion.Frames``.
        toes: Joint of each foot's toes, -1 where there is none. Shape (2,).
        scales: Body size by column.
        rules: A ``StepRules``.
        gait: A ``gait.Gait``.
        steps: Written, a ``Steps``.
    """
    # An eased way is fastest in its middle, 15 / 8 of the mean.
    near = max(min(rules.drag, gait.slide * (rules.ahead + rules.behind) / 1.875), rules.drag_anyhow)
    durations = np.empty(2)
    for n in range(first, stop):
        for k in range(transitions.starts[n], transitions.starts[n + 1]):
            measure_gaps(k, transitions, motion, toes, scales[n], steps)
            for foot in range(2):
                durations[foot] = _plan_foot(k, foot, transitions, plants, motion, scales[n], rules, gait, near, steps)
            both = durations[0] > 0.0 and durations[1] > 0.0
            # Feet wait as long as they can, for they may come up by themselves.
            leader = _leader(k, transitions, motion, steps.gaps[k]) if both else -1
            for foot in range(2):
                if durations[foot] > 0.0:
                    move = steps.moves[k, foot]
                    move[BEGIN] = transitions.times[k] + (rules.wait if foot == leader else rules.lifts_within)
                    move[END] = move[BEGIN] + durations[foot]

"""How often each behaviour of a policy does what it is for: short trials with a still target.

Starts and times are those of ``benchmarks/policy_quality.py``, which judges policies at length. Trials call the kernel
that decides and do the rest in numpy, so that nothing is compiled for them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.policy.axes.axis import UNSEEN_STRIKE
from crowdsim.policy.policy import Behaviour, Policy, build_lookup_tables
from crowdsim.policy.rewards import HitTerm, ProximityTerm, StrikeTerm, lands, surface_distance
from crowdsim.training.evaluation import random_starts
from crowdsim.training.ranges import strike_reach

STARTS = 200
"""Random starts of each behaviour."""

NEAR_AND_FAR = (0.6, 4.0)
"""How far away targets are that avatars must walk to [m]."""

CLOSE = 0.1
"""How much further away than wanted a target may be that an avatar has come to [m]."""

ARRIVED_WITHIN, LANDED_WITHIN, WALKED_AND_LANDED_WITHIN = 10.0, 3.0, 6.0
"""By when a trial has succeeded [s]: by arrival, by a landed strike, and by one with a walk before it."""

WARNED = 0.4
"""How long before a strike reaches furthest an avatar begins that is to keep clear of it [s]."""

_UNSEEN = (0.3, 1.3)
"""How far away near targets are where there are no strikes to reach them [m]."""


@dataclass(frozen=True)
class Success:
    """How often a behaviour does what it is for.

    Attributes:
        task: One of ``weaknesses.TASKS``.
        seconds: By when a trial has succeeded [s].
        share: Share of the trials that succeed.
        median_seconds: Median time of those that do [s]; None where none does.
        share_behind: Share of success where the target is behind at first; None where targets are only ahead.
    """

    task: str
    seconds: float
    share: float
    median_seconds: float | None
    share_behind: float | None


def measure_success(policy: Policy, behaviour: Behaviour) -> Success:
    """Return how often a behaviour does what it is for.

    One that is rewarded for strikes has succeeded when one lands, any other when it comes to where the target is
    wanted. Targets of one that is rewarded for strikes alone are where strikes reach; of one that is rewarded for being
    near they are further away and all around; of one that is rewarded for both they are half and half. One that is
    rewarded for neither, but pays for hits, has succeeded where a strike that it sees ``WARNED`` ahead does not land.

    Args:
        policy: Its actions, and the motion that says what strikes reach.
        behaviour: The behaviour; it alone decides.
    """
    strikes = [term.tolerance for term in behaviour.terms if isinstance(term, StrikeTerm)]
    wanted = [term.between[1] for term in behaviour.terms if isinstance(term, ProximityTerm)]
    hits = [term.distance for term in behaviour.terms if isinstance(term, HitTerm) and term.distance is not None]
    evades = bool(hits) and not strikes and not wanted
    states, targets = starts_of_trials(policy, bool(strikes), bool(wanted), STARTS)
    if evades:
        seconds, goal = WARNED, _Goal(outside=hits[0])
        targets *= (hits[0][0] + hits[0][1]) / 2.0 / np.hypot(targets[:, :1], targets[:, 2:]) * [1, 0, 1] + [0, 1, 0]
    elif strikes:
        seconds = WALKED_AND_LANDED_WITHIN if wanted else LANDED_WITHIN
        goal = _Goal(tolerance=max(strikes))
    else:
        seconds, goal = ARRIVED_WITHIN, _Goal(within=max(wanted, default=0.5) + CLOSE)
    times = _run_trials(policy, behaviour, states, targets, round(seconds * policy.database.control_rate), goal)
    times /= policy.database.control_rate
    done = np.isfinite(times)
    behind = targets[:, 2] < 0.0
    return Success(
        task="evade" if evades else ("strike" if strikes else "arrive"),
        seconds=seconds,
        share=float(done.mean()),
        median_seconds=float(np.median(times[done])) if done.any() else None,
        share_behind=float(done[behind].mean()) if behind.mean() > 0.1 else None,
    )


@dataclass(frozen=True)
class _Goal:
    """What ends a trial: being so near [m], a strike that lands by a tolerance [m], or being elsewhere when it does."""

    within: float | None = None
    tolerance: float | None = None
    outside: tuple[float, float] | None = None


def starts_of_trials(policy: Policy, strikes: bool, walks: bool, count: int) -> tuple[Array, Array]:
    """Return states (N,) and targets (N, 3) at the start of each trial."""
    database = policy.database
    heads = np.asarray(database.head_heights, dtype=float)
    low, high = np.percentile(heads, [5.0, 95.0])
    around, height = (-math.pi, math.pi), (float(low), float(high))
    distance, bearing = _UNSEEN, around
    if len(database.strike_frames):
        reach = strike_reach(database)
        distance, bearing = reach.distance, reach.bearing
    near = random_starts(policy, count, distance, bearing, height)
    far = random_starts(policy, count, NEAR_AND_FAR, around, height)
    if not walks:
        return near
    if not strikes:
        return far
    odd = np.arange(count) % 2 == 1
    return np.where(odd, far[0], near[0]), np.where(odd[:, None], far[1], near[1])


def _run_trials(
    policy: Policy, behaviour: Behaviour, states: Array, targets: Array, horizon: int, goal: _Goal
) -> Array:
    """Return in which control frame each trial reaches its goal, NaN where it does not in time. Shape (N,)."""
    from crowdsim.policy.axes.axis import Target
    from crowdsim.policy.kernels.axes import Corners
    from crowdsim.policy.kernels.values import evaluate_actions

    tables = build_lookup_tables(policy.actions, (behaviour.everywhere().in_numbers(),), policy.body)
    actions = policy.actions
    most = int(np.diff(actions.offsets).max())
    corners, values = Corners(np.empty(64, np.int64), np.empty(64)), np.empty(most)
    weights, headings = np.ones(1), math.tau * ((np.arange(len(states)) * 0.6180339887498949) % 1.0)
    times = np.full(len(states), np.nan)
    for i in range(len(states)):
        state, target, frame, heading = int(states[i]), np.asarray(targets[i], dtype=float), 0, float(headings[i])
        while frame < horizon:
            impact = float(horizon - frame) if goal.outside is not None else UNSEEN_STRIKE
            seen = Target(target[0], target[1], target[2], 0.0, 0.0, heading, impact)
            count = evaluate_actions(tables, weights, state, seen, corners, values)
            action = int(actions.offsets[state]) + int(np.argmax(values[:count]))
            reached = frame + _time_in_action(policy, action, target, goal, horizon - frame)
            if reached <= horizon:
                times[i] = reached
                break
            frame += int(actions.lengths[action])
            end = actions.paths[actions.path_offsets[action + 1] - 1]
            target, heading = ground.to_local(end, target), heading - float(end[2])
            state = int(actions.next[action])
    return times


def _time_in_action(policy: Policy, action: int, target: Array, goal: _Goal, left: int) -> float:
    """Return when within an action its goal is reached [control frames]; infinity where it is not.

    The trial ends in ``left`` frames.
    """
    actions = policy.actions
    path = np.asarray(actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]], dtype=float)
    far = np.hypot(target[0] - path[:, 0], target[2] - path[:, 1])
    if goal.outside is not None:
        clear = left <= len(far) and not goal.outside[0] <= far[left - 1] <= goal.outside[1]
        return float(left) if clear else math.inf
    if goal.within is not None:
        near = np.flatnonzero(far <= goal.within)
        return float(near[0]) + 1.0 if len(near) else math.inf
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        if lands(surface_distance(actions.strike_positions[strike], target, policy.body), goal.tolerance or 0.0):
            return float(actions.strike_times[strike])
    return math.inf

"""Transitions into falls and staggers, and out of them, beside all other transitions of the same fights."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from _motion.shown_motion import Shown, read_shown
from _motion.smoothness import around, by_clip, excesses, jumps, margins
from _motion.transition_judge import judge, mean_of
from _motion.transition_windows import made, without_strikes
from crowdsim.core.types import Array
from crowdsim.policy.policy import Policy
from crowdsim.poses.sampler import PoseSampler
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario

ON_FLOOR = 0.03
"""Height of the ball of a foot under which it is on the floor [m]."""
QUICK = ["groups.0.count=8", "groups.0.placement.radius=2", "duration=400", "types.boxer.damage.health=10"]
"""What is other in a quick brawl."""


def of_falls(policy: Policy, left: Array, entered: Array) -> Array:
    """Return which transitions lead into a fall or stagger or out of one, by playback frames. Shape (n,), bool."""
    falls, graph, stride = policy.falls, policy.graph, policy.database.stride
    assert falls is not None
    before = np.asarray(graph.action_first, np.int64) - 1
    last = before + np.asarray(graph.action_lengths)
    into = before[np.concatenate([falls.fall, falls.stagger])] * stride
    out = last[np.concatenate([falls.rise, falls.stagger])] * stride
    return np.asarray(np.isin(entered, into) | np.isin(left, out))


def measure_fall_motion(shown: Shown, policy: Policy) -> dict[str, Any]:
    """Compare motion within 0.25 s of transitions of falls with motion near other transitions of bodies that stand.

    Returns:
        ``falls`` and ``others``: the number of ``transitions``; of each part of the body how often accelerations
        exceed the 99.9th percentile of the capture's [per mille]; ``jumps``, one-frame jumps of joints in a thousand
        transitions; ``slide_median`` and ``slide_95``, horizontal speed of balls of feet on the floor [m/s]. All are
        ``shown``, and ``captured`` in the frames of the capture behind them.
    """
    falls, stride = policy.database.falls, policy.database.stride
    lain = np.zeros(len(shown.clips), bool)
    for down, rise in zip(falls.downs * stride, falls.rises * stride, strict=True):
        lain[down : rise + 1] = True
    return measure_motion_near(shown, "falls", of_falls(policy, shown.left, shown.entered), lain)


def measure_motion_near(shown: Shown, name: str, chosen: Array, lain: Array) -> dict[str, Any]:
    """Compare motion within 0.25 s of some transitions with motion near others, as ``measure_fall_motion`` does.

    Args:
        shown: The motion.
        name: What the chosen transitions are called in the result.
        chosen: Which decisions count, if they are transitions. Shape (n,), bool.
        lain: Which playback frames of the database others are not near to. Shape (P,), bool.
    """
    cut = shown.left != shown.entered
    of_fall = cut & chosen
    other = cut & ~of_fall & ~lain[shown.entered] & ~lain[shown.left]
    near_falls = around(shown, shown.owners[of_fall], shown.times[of_fall])
    groups = {
        name: near_falls,
        "others": around(shown, shown.owners[other], shown.times[other]) & ~near_falls & ~lain[shown.frames],
    }
    result: dict[str, Any] = excesses(shown, groups, {})
    inner = margins(shown)
    balls = [shown.names.index(f"{side}_ball") for side in ("left", "right")]
    slides, heights = _ground_speeds(shown.positions[:, :, balls], shown.rate), shown.positions[:, :, balls, 1]
    points = shown.captured[0][:, balls]
    own = by_clip(shown, _ground_speeds, points, shown.rate)[shown.frames]
    jumped = np.any(jumps(shown.local), axis=-1)
    behind = by_clip(shown, lambda rotations: np.any(jumps(rotations), axis=-1), shown.captured[2])[shown.frames]
    for group, count in ((name, of_fall), ("others", other)):
        here = groups[group] & inner
        number = max(int(count.sum()), 1)
        result[group]["transitions"] = int(count.sum())
        result[group]["jumps"] = {
            "shown": 1000.0 * float(jumped[here].sum()) / number,
            "captured": 1000.0 * float(behind[here].sum()) / number,
        }
        floored = [here[..., None] & low for low in (heights < ON_FLOOR, (points[..., 1] < ON_FLOOR)[shown.frames])]
        for figure, share in (("slide_median", 50), ("slide_95", 95)):
            result[group][figure] = {
                side: float(np.percentile(speeds[where], share)) if where.any() else float("nan")
                for side, speeds, where in zip(("shown", "captured"), (slides, own), floored, strict=True)
            }
    return result


def _ground_speeds(points: Array, rate: float) -> Array:
    """Return horizontal speeds of points (..., T, P, 3), 0 in the first frame. Shape (..., T, P)."""
    out = np.zeros(points.shape[:-1], np.float32)
    out[..., 1:, :] = np.linalg.norm(np.diff(points[..., [0, 2]], axis=-3), axis=-1) * rate
    return out


def measure_falls(
    policy: Policy, brawls: int, half: int, most: int, noise: float, quick: bool = False
) -> dict[str, Any] | None:
    """Return the figures of transitions of falls in brawls to the last boxer standing; None where there are no falls.

    Args:
        policy: The policy.
        brawls: How many, with seeds from 1 on.
        half: Playback frames of a window before and after the transition.
        most: Most transitions of a brawl that are classified.
        noise: Standard deviation of the noise on positions [m].
        quick: Whether brawls are small.

    Returns:
        What ``judge`` returns, and under ``motion`` what ``measure_fall_motion`` does.
    """
    database = policy.database
    if not database.falls.any:
        return None
    figures, parts = [], []
    for seed in range(1, brawls + 1):
        changes = ["types.boxer.scale=1", *(QUICK if quick else []), f"seed={seed}"]
        take = run(load_scenario("brawl_last_standing", changes), [policy], threads=2)
        figures.append(measure_fall_motion(read_shown(PoseSampler(take, [policy], threads=2)), policy))
        rng = np.random.default_rng(seed)
        parts.append(made(without_strikes(take, policy), half, most, rng, partial(of_falls, policy))[:3])
    leave, enter, windows = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return {**judge(database, leave, enter, windows, noise=noise), "motion": mean_of(figures)}

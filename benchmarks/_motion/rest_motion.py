"""Transitions into rests, in them and out of them, beside all other transitions of the same fights."""

from __future__ import annotations

import json
from functools import partial
from typing import Any

import numpy as np

from _motion.fall_motion import measure_motion_near
from _motion.shown_motion import Shown, read_shown
from _motion.transition_judge import judge, mean_of
from _motion.transition_windows import made, without_strikes
from crowdsim.core.types import Array
from crowdsim.motion.database import MotionDatabase
from crowdsim.policy.policy import Policy
from crowdsim.poses.sampler import PoseSampler
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario

ROUND = 6.0
"""Seconds that avatars fight, and rest, in turns."""
QUICK = ["groups.0.count=8", "groups.0.placement.radius=2", "duration=30s"]
"""What is other in a quick brawl."""


def rounds(seconds: float) -> str:
    """Return the events of a brawl in which everyone fights and rests in turns, as an override of a scenario."""
    turns = range(1, int(seconds / ROUND))
    events: list[dict[str, Any]] = []
    for turn in turns:
        when = {"kind": "seconds", "seconds": turn * ROUND}
        events.append(
            {"kind": "fight", "when": when} if turn % 2 == 0 else {"kind": "rest", "when": when, "distance": 1.5}
        )
    return f"events={json.dumps(events)}"


def of_rests(database: MotionDatabase, left: Array, entered: Array) -> Array:
    """Return which transitions lead into a rest, within one or out of one, by playback frames. Shape (n,), bool."""
    inside = np.repeat(database.rests.mask(database.frame_count), database.stride)
    return np.asarray(inside[left] | inside[entered])


def measure_rest_motion(shown: Shown, database: MotionDatabase) -> dict[str, Any]:
    """Compare motion near transitions of rests with motion near others, see ``measure_motion_near``."""
    inside = np.repeat(database.rests.mask(database.frame_count), database.stride)
    return measure_motion_near(shown, "rests", of_rests(database, shown.left, shown.entered), inside)


def measure_rests(
    policy: Policy, brawls: int, half: int, most: int, noise: float, quick: bool = False
) -> dict[str, Any] | None:
    """Return the figures of transitions of rests in brawls by rounds; None where there are no rests.

    Args:
        policy: The policy.
        brawls: How many, with seeds from 1 on.
        half: Playback frames of a window before and after the transition.
        most: Most transitions of a brawl that are classified.
        noise: Standard deviation of the noise on positions [m].
        quick: Whether brawls are small.

    Returns:
        What ``judge`` returns, and under ``motion`` what ``measure_rest_motion`` does.
    """
    database = policy.database
    if policy.rests is None:
        return None
    figures, parts = [], []
    for seed in range(1, brawls + 1):
        changes = ["types.boxer.scale=1", "duration=66s", rounds(66.0), *(QUICK if quick else []), f"seed={seed}"]
        take = run(load_scenario("brawl_30", changes), [policy], threads=2)
        figures.append(measure_rest_motion(read_shown(PoseSampler(take, [policy], threads=2)), database))
        rng = np.random.default_rng(seed)
        parts.append(made(without_strikes(take, policy), half, most, rng, partial(of_rests, database))[:3])
    leave, enter, windows = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return {**judge(database, leave, enter, windows, noise=noise), "motion": mean_of(figures)}

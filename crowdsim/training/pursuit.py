"""How fast a target may flee before avatars fall behind: the speed that a policy can sustain."""

from __future__ import annotations

import math

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.policy import LookupTables, Policy, build_lookup_tables

MARGIN, MOST, TEMPERATURE = 0.1, 4, 0.05
"""How avatars draw among the best actions unless a scenario says otherwise: the defaults of its types."""

AVATARS = 64
"""Avatars that are watched."""

LEAD = 2.0
"""How far away their targets are at the start [m]."""

LOST = 4.0
"""Avatars that are further behind than this have lost their target [m]."""

BEGUN, DONE = 15.0, 25.0
"""From when to when they are watched [s]: all have turned to their target by then, and have caught up or never do."""

FASTEST, HALVINGS = 8.0, 8
"""Highest speed that is tried [m/s], and how often the range of speeds is halved."""


def sustained_speed(policy: Policy) -> float:
    """Return the highest speed at which a target flees straight away and avatars do not lose it [m/s].

    They begin in states all over the graph, with the target in every direction, and choose as in a crowd: by the
    weights of the policy's recipe, at the default temperature. They hold on to it if the median one is no further
    behind than ``LOST``. The speed is found by bisection, to three hundredths of a metre a second; 0 where even slower
    targets are lost.
    """
    low, high, tables = 0.0, FASTEST, tables_of(policy)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if float(np.median(distances_behind(policy, middle, tables))) <= LOST:
            low = middle
        else:
            high = middle
    return low


def distances_behind(policy: Policy, speed: float, tables: tuple[LookupTables, Array]) -> Array:
    """Return how far behind a fleeing target each avatar is, in the mean [m]. Shape (AVATARS,).

    Args:
        policy: The policy.
        speed: Speed of the target [m/s].
        tables: What ``tables_of`` returns of the policy.
    """
    from crowdsim.core.candidates import CandidateRules
    from crowdsim.training.kernels.pursuit import Chase, pursue

    numbers, rate = np.arange(AVATARS), float(policy.database.control_rate)
    states = (numbers * policy.actions.state_count // AVATARS).astype(np.int32)
    bearings = 2.0 * math.pi * ((0.5 + numbers * 0.6180339887498949) % 1.0)
    height = float(np.median(np.asarray(policy.database.head_heights, dtype=float)))
    rules = CandidateRules(MARGIN, float(MOST), TEMPERATURE)
    chase = Chase(height, LEAD, speed / rate, round(BEGUN * rate), round(DONE * rate), rules)
    out = np.empty(AVATARS)
    pursue(*tables, chase, states, bearings, out)
    return out


def tables_of(policy: Policy) -> tuple[LookupTables, Array]:
    """Return the behaviours that count as flat arrays, and their weights; float32, as training has compiled it."""
    counts = policy.weights > 0.0
    behaviours = tuple(one.in_numbers() for one, count in zip(policy.behaviours, counts, strict=True) if count)
    return build_lookup_tables(policy.actions, behaviours, policy.body), policy.weights[counts]

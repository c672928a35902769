"""How good a behaviour is: episodes from random starts, by its table, at random, or by searching at run time."""

from __future__ import annotations

import itertools
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.actions import Actions
from crowdsim.policy.policy import Behaviour, Policy, build_lookup_tables
from crowdsim.policy.rewards import TargetBody

CHOICES = {"table": 0, "random": 1, "search": 2}
"""Numbers of the choices in compiled code."""


@dataclass(frozen=True)
class Episodes:
    """What came of N episodes.

    Attributes:
        returns: Discounted reward over the horizon. Shape (N,).
        earned: The same without the price of transitions. Shape (N,).
        distances: Least distance to the target over the ground [m]. Shape (N,).
        arrivals: When the target was first as near as was asked for [s], NaN where it never was. Shape (N,).
        landings: When a strike first landed [s], NaN where none did. Shape (N,).
        landed: Strikes landed. Shape (N,).
        seconds_a_decision: Mean processor time that a decision took [s].
        transitions_per_second: Transitions a second.
        seconds_between_transitions: Mean time from one transition to the next [s].
        actions_used: How many of the graph's actions were done at all.
    """

    returns: Array
    earned: Array
    distances: Array
    arrivals: Array
    landings: Array
    landed: Array
    seconds_a_decision: float
    transitions_per_second: float
    seconds_between_transitions: float
    actions_used: int


@dataclass(frozen=True)
class Composition:
    """Several behaviours that choose together, as in a crowd.

    Attributes:
        actions: What they were learned over.
        behaviours: The behaviours.
        weights: Weight of each. Shape (B,).
    """

    actions: Actions
    behaviours: tuple[Behaviour, ...]
    weights: Array


def random_starts(
    policy: Policy,
    count: int,
    distance: tuple[float, float],
    bearing: tuple[float, float],
    height: tuple[float, float],
) -> tuple[Array, Array]:
    """Return states and targets drawn evenly: over the states, and in a range of distance, bearing and height.

    Returns:
        States, shape (N,), int32, and targets in the avatar's ground frame, shape (N, 3) [m].
    """
    draw = np.random.default_rng(0)
    states = draw.integers(0, policy.actions.state_count, count).astype(np.int32)
    far, angle = draw.uniform(*distance, count), draw.uniform(*bearing, count)
    high = draw.uniform(*height, count)
    return states, np.stack([far * np.sin(angle), high, far * np.cos(angle)], axis=-1)


@dataclass(frozen=True)
class EpisodeSettings:
    """How episodes are played.

    Attributes:
        seconds: Length of an episode [s].
        choice: ``table``, ``random``, or ``search``: a beam search with V behind its leaves.
        width: Width of the beam.
        depth: Its depth in actions.
        target_speed: Speed of the target, in a direction drawn anew for every action [m/s].
        within: Distance over the ground at which an avatar has arrived [m].
        seed: Of the draws.
    """

    seconds: float = 10.0
    choice: str = "table"
    width: int = 1
    depth: int = 1
    target_speed: float = 0.0
    within: float = 0.6
    seed: int = 0


def run_episodes(
    actions: Actions,
    behaviour: Behaviour,
    body: TargetBody,
    control_rate: float,
    states: Array,
    targets: Array,
    settings: EpisodeSettings | None = None,
    composition: Composition | None = None,
    threads: int = 1,
) -> Episodes:
    """Let an avatar pursue a target from each start, and return what came of it.

    Args:
        actions: What it can do.
        behaviour: What it does, and what is rewarded; learned over these actions.
        body: Sizes of the target.
        control_rate: Control frames a second.
        states: Where each starts. Shape (N,).
        targets: Where the target is then [m]. Shape (N, 3).
        settings: How episodes are played; the defaults when None.
        composition: What chooses in place of the behaviour's own table, over the same actions; their costs may differ.
        threads: Threads to use; results are the same for any number.
    """
    from crowdsim.training.kernels import episodes as played

    settings = settings or EpisodeSettings()
    judge = build_lookup_tables(actions, (behaviour.everywhere(),), body)
    tables, weights = judge, np.ones(1)
    if composition is not None:
        tables = build_lookup_tables(composition.actions, composition.behaviours, body)
        weights = np.asarray(composition.weights, float)
    horizon = round(settings.seconds * control_rate)
    rules = played.Rules(
        tables,
        weights,
        judge,
        CHOICES[settings.choice],
        settings.width,
        settings.depth,
        float(settings.target_speed / control_rate),
        horizon,
        float(settings.within),
        settings.seed,
    )
    out, used = np.zeros(len(states), played.EPISODE), np.zeros(actions.action_count, np.uint8)
    states, targets = np.asarray(states, np.int32), np.asarray(targets, float)
    numbers = np.arange(len(states))

    def play(some: slice) -> float:
        started = time.thread_time()
        played.run_episodes(rules, states[some], targets[some], numbers[some], out[some], used)
        return time.thread_time() - started

    play(slice(0, 1))  # compiled here, so that the times below are those of decisions
    out[0] = np.zeros((), out.dtype)
    bounds = np.linspace(0, len(states), threads + 1).astype(int)
    with ThreadPoolExecutor(threads) as pool:
        spent = sum(pool.map(play, [slice(*pair) for pair in itertools.pairwise(bounds)]))
    return _episodes(out, used, spent, control_rate)


def _episodes(out: Array, used: Array, spent: float, rate: float) -> Episodes:
    """Return the episodes of the kernel's records (N,) and flags of actions (A,), which took so long [s]."""
    transitions, frames = float(out["transitions"].sum()), float(out["frames"].sum())
    return Episodes(
        returns=out["gained"],
        earned=out["earned"],
        distances=out["nearest"],
        arrivals=np.where(out["arrived"] < 0.0, np.nan, out["arrived"] / rate),
        landings=np.where(out["first_landed"] < 0.0, np.nan, out["first_landed"] / rate),
        landed=out["landed"].astype(float),
        seconds_a_decision=spent / float(out["decisions"].sum()),
        transitions_per_second=transitions / frames * rate,
        seconds_between_transitions=frames / rate / max(transitions, 1.0),
        actions_used=int(used.sum()),
    )

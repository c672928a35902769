"""Numbers of a motion graph: its size, and how many transitions it makes at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.graph.states import MotionGraph

_SWEEPS = 500
_RUNS = 1000
"""Steps after which stationary shares and the lengths of uncut runs have long settled."""


@dataclass(frozen=True)
class GraphStatistics:
    """What a motion graph is in numbers.

    Attributes:
        frames: Control frames kept.
        transitions: Transitions kept.
        states: Number of states.
        actions: Number of actions.
        branching: Actions of a state, mean.
        branching_most: Actions of the state that has most.
        action_frames: Control frames of an action, mean.
        action_frames_most: Control frames of the longest action.
        cost_mean: Mean cost of the transitions [m].
        cost_95: Their 95th percentile [m].
        threshold: Largest cost allowed [m].
        transitions_per_second: Those of a body that draws its actions evenly at random. A policy makes fewer.
        seconds_between_transitions: Median time between two transitions of such a body [s].
    """

    frames: int
    transitions: int
    states: int
    actions: int
    branching: float
    branching_most: int
    action_frames: float
    action_frames_most: int
    cost_mean: float
    cost_95: float
    threshold: float
    transitions_per_second: float
    seconds_between_transitions: float


def graph_statistics(graph: MotionGraph, control_rate: float) -> GraphStatistics:
    """Return the numbers of a graph whose frames come ``control_rate`` times a second."""
    counts = np.diff(graph.action_offsets)
    shares = _random_shares(graph)
    frames = float(shares @ graph.action_lengths)
    return GraphStatistics(
        frames=int(graph.frames_kept.sum()),
        transitions=len(graph.transition_from),
        states=graph.state_count,
        actions=graph.action_count,
        branching=float(counts.mean()),
        branching_most=int(counts.max()),
        action_frames=float(graph.action_lengths.mean()),
        action_frames_most=int(graph.action_lengths.max()),
        cost_mean=float(graph.transition_costs.mean(dtype=np.float64)),
        cost_95=float(np.percentile(graph.transition_costs, 95)),
        threshold=graph.threshold,
        transitions_per_second=float(shares[graph.action_has_transition].sum() / frames * control_rate),
        seconds_between_transitions=_median_run(graph, shares) / control_rate,
    )


def frames_kept_by_clip(graph: MotionGraph, clip_starts: Array) -> Array:
    """Return how many control frames of each clip the graph keeps. Shape (C,), int64."""
    before = np.concatenate([[0], np.cumsum(graph.frames_kept)])
    return before[clip_starts[1:]] - before[clip_starts[:-1]]


def _random_shares(graph: MotionGraph) -> Array:
    """Return the share of each action among those taken by a body that draws evenly at random, for ever. Shape (A,)."""
    counts = np.diff(graph.action_offsets)
    shares = np.full(graph.state_count, 1.0 / graph.state_count)
    states, chance = graph.action_states, 1.0 / np.repeat(counts, counts)
    for _ in range(_SWEEPS):
        onward = np.bincount(graph.action_next, weights=shares[states] * chance, minlength=graph.state_count)
        # Half a step each time, so that a graph whose loops have one length settles too.
        changed, shares = np.abs(onward - shares).sum(), 0.5 * (onward + shares)
        if changed < 1e-12:
            break
    return shares[states] * chance


def _median_run(graph: MotionGraph, shares: Array) -> float:
    """Return the median number of frames from one transition to the next, actions being drawn evenly at random."""
    transitions = graph.action_has_transition
    if not transitions.any():
        return float("inf")
    counts = np.diff(graph.action_offsets)
    # The action that continues the capture comes first in its state, where there is one.
    onward = np.minimum(graph.action_offsets[:-1], graph.action_count - 1)
    stay = np.where(~transitions[onward], 1.0 / counts, 0.0)
    states = graph.action_next[transitions]
    frames = graph.action_lengths[transitions].astype(np.int64)
    mass = shares[transitions] / shares[transitions].sum()
    lengths, ends = [], []
    for _ in range(_RUNS):
        lengths.append(frames)
        ends.append(mass * (1.0 - stay[states]))
        mass = mass * stay[states]
        if mass.sum() < 1e-9:
            break
        frames = frames + graph.action_lengths[onward[states]]
        states = graph.action_next[onward[states]]
    by_length = np.bincount(np.concatenate(lengths), weights=np.concatenate(ends))
    return float(np.searchsorted(np.cumsum(by_length), 0.5 * by_length.sum()))

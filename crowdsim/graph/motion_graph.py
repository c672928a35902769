"""The motion graph of a database: features, transitions, states and actions in one call.

Transitions and decisions are found for the captured frames; those of their mirror images are the mirror images of
these, so that the graph is its own mirror image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.errors import MotionError
from crowdsim.graph.features import frame_features
from crowdsim.graph.settings import GraphSettings
from crowdsim.graph.states import MotionGraph, graph_of_transitions
from crowdsim.graph.transitions import Transitions, decision_frames, find_transitions, with_images
from crowdsim.motion.database import MotionDatabase

__all__ = ["MotionGraph", "build_graph"]


_ELSEWHERE = 1e3
"""What the features of frames lie off by that no transition leads to [m]."""


def build_graph(
    database: MotionDatabase, settings: GraphSettings | None = None, progress: Progress | None = None
) -> MotionGraph:
    """Build the motion graph of a database by a recipe's section ``graph``, or its defaults.

    Raises:
        MotionError: The graph has no cycle, or only one loop without a decision.
    """
    settings = settings or GraphSettings()
    features = frame_features(database, settings, progress)
    # What is before and after rests and falls is not among the cheapest targets that a frame has.
    features[database.apart | database.beside_falls] += _ELSEWHERE
    transitions = _find(database, features, settings, settings.threshold, progress)
    if settings.threshold is None:
        graph = _graph_of_actions(database, transitions, settings, settings.actions or 0)
    else:
        try:
            graph = _graph_at(database, transitions, settings, settings.threshold)
        except MotionError as error:
            every = _find(database, features, settings, None, progress)
            raise MotionError(f"{error} ({_hint(database, every, settings)})") from None
    if progress is not None:
        progress("states", 1, 1)
    return graph


def _find(
    database: MotionDatabase,
    features: Array,
    settings: GraphSettings,
    threshold: float | None,
    progress: Progress | None,
) -> Transitions:
    """Return the cheapest transitions of each captured frame, up to a threshold if there is one."""
    contacts = np.ascontiguousarray(database.contacts[:: database.stride])
    near = _frames(settings.near, database.control_rate)
    ceiling = np.inf if threshold is None else threshold
    found = find_transitions(
        features,
        database.segment_starts,
        contacts,
        near,
        settings.branching,
        ceiling=ceiling,
        progress=progress,
        leading=database.captured_frames,
        telling=database.telling,
    )
    fallen, winding = database.apart | database.beside_falls, _before_strikes(database, settings.windup)
    # A transition is decided on in the frame before the one that it leads to.
    barred = fallen[found.sources] | fallen[found.targets] | winding[found.sources] | winding[found.targets - 1]
    return found.chosen(~barred) if barred.any() else found


def _before_strikes(database: MotionDatabase, seconds: float) -> Array:
    """Return the frames with a strike within some time, which are no decisions. Shape (F,), bool."""
    barred = np.zeros(database.frame_count, bool)
    frames = round(seconds * database.control_rate)
    strikes = np.asarray(database.strike_frames, np.int64)
    segments = np.searchsorted(np.asarray(database.segment_starts) * database.stride, strikes, side="right") - 1
    first = np.asarray(database.segment_starts, np.int64)[segments]
    for before in range(frames):
        at = (strikes - 1) // database.stride - before
        barred[at[at >= first]] = True
    return barred


def _graph_at(
    database: MotionDatabase, transitions: Transitions, settings: GraphSettings, threshold: float
) -> MotionGraph:
    """Return the graph of the transitions up to a threshold, at frames that lie apart, and of their mirror images."""
    below = transitions.chosen(transitions.costs <= np.float32(threshold))
    # What costs nearly the threshold is worth little, and a little more than nothing.
    worth = np.float32(threshold) - below.costs + 1e-6
    spacing = _frames(settings.spacing, database.control_rate)
    decisions = decision_frames(below, worth, database.segment_starts, spacing)
    chosen = with_images(below.chosen(decisions[below.sources]), database.captured_frames, database.frame_count)
    return graph_of_transitions(chosen, database.segment_starts, threshold, database.segment_names)


def _graph_of_actions(
    database: MotionDatabase, transitions: Transitions, settings: GraphSettings, wanted: int
) -> MotionGraph:
    """Return the graph whose number of actions is nearest to ``wanted``."""
    costs = np.unique(transitions.costs)
    most = _graph_at(database, transitions, settings, float(costs[-1]) if len(costs) else 0.0)
    if most.action_count < wanted:
        more = (
            f"{wanted} actions were asked for, and there are only {most.action_count}; "
            "a higher graph.branching or a lower graph.spacing gives more"
        )
        return replace(most, warnings=(more, *most.warnings))
    rank = _lowest_rank(database, transitions, settings, costs, wanted)
    graph = _graph_at(database, transitions, settings, float(costs[rank]))
    if rank > 0 and graph.action_count > wanted:
        try:
            fewer = _graph_at(database, transitions, settings, float(costs[rank - 1]))
        except MotionError:
            return graph
        if wanted - fewer.action_count < graph.action_count - wanted:
            return fewer
    return graph


def _lowest_rank(
    database: MotionDatabase, transitions: Transitions, settings: GraphSettings, costs: Array, wanted: int
) -> int:
    """Return by bisection the rank of the least of the ascending ``costs`` that gives ``wanted`` actions or more.

    The highest of them gives as many.
    """
    low, high = -1, len(costs) - 1
    while high - low > 1:
        middle = (low + high) // 2
        try:
            enough = _graph_at(database, transitions, settings, float(costs[middle])).action_count >= wanted
        except MotionError:
            enough = False
        low, high = (low, middle) if enough else (middle, high)
    return high


def _hint(database: MotionDatabase, transitions: Transitions, settings: GraphSettings) -> str:
    """Return which threshold would give a graph."""
    costs = np.unique(transitions.costs)
    try:
        _graph_at(database, transitions, settings, float(costs[-1]) if len(costs) else 0.0)
    except MotionError:
        return "no threshold gives one"
    least = float(costs[_lowest_rank(database, transitions, settings, costs, 2)])
    return f"the least threshold that gives one is {math.ceil(least * 1e3) / 1e3:.3f} m"


def _frames(seconds: float, rate: float) -> int:
    """Return the least number of frames that last this long, at least 1."""
    return max(1, math.ceil(seconds * rate - 1e-9))

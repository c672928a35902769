"""Pruning: of many transitions out of a frame, those that are worth most to the behaviours are kept.

The cheapest transitions are not the most useful ones: most frames similar to a guard lead to the same few moves. So a
wide graph is first solved on coarse grids. For each state, transitions are added greedily, each time the one that
raises the best value most, averaged over targets on all sides and over the behaviours, alone and together. Of decisions
that are too close in time, the most valuable are kept. No transition may enter just before a decision, because
transitions in quick succession are the most visible. The transitions that remain are then chosen once more. The pruned
graph has fewer decisions among fewer actions, at hardly any loss of reward (``benchmarks/policy_quality.py``).

Mirrored motion is judged once for both sides: transitions of mirror images are the mirror images of those kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.core.workers import share
from crowdsim.graph.states import MotionGraph, graph_of_transitions
from crowdsim.graph.transitions import Transitions, decision_frames, with_images
from crowdsim.policy.actions import Actions, build_actions, leading_actions
from crowdsim.policy.rewards import TargetBody, TransitionTerm, once_of
from crowdsim.training.behaviours import Lesson
from crowdsim.training.mirroring import solved_states
from crowdsim.training.ranges import sample_targets
from crowdsim.training.recipe import BehaviourSpec, PruningSpec, ValueIterationSpec
from crowdsim.training.scales import fades_of

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase


COARSE, FEW = {"distance": 11, "bearing": 16, "height": 3}, 6
"""Most points of each axis on which the wide graph is learned, and of all others."""

ROUGH = 0.03
"""Tolerance of those values; a third of it changes one transition in twenty, for one of equal value."""


def prune_graph(
    database: MotionDatabase,
    graph: MotionGraph,
    specs: dict[str, BehaviourSpec],
    body: TargetBody,
    settings: PruningSpec,
    progress: Progress | None = None,
) -> MotionGraph:
    """Return the graph of the transitions of a wide graph that are worth most to the behaviours, given by name."""
    actions = build_actions(database, graph)
    values: dict[str, Array] = {}
    states = _judged_states(database, graph, specs)
    keep, gains = judge_transitions(database, graph, actions, specs, body, settings.transitions, progress, values)
    jumps = graph.action_has_transition[: len(keep)]
    wide_transitions = _transitions_of(graph, jumps)
    worth = np.zeros(len(wide_transitions))
    chosen = keep[jumps]
    # Above 0 even where a transition adds nothing, so that no frame loses all its transitions for that.
    worth[chosen] = gains[jumps][chosen] + 1e-9
    spacing = _frames(settings.spacing, database)
    decisions = decision_frames(wide_transitions.chosen(chosen), worth[chosen], database.segment_starts, spacing)
    landing = _frames(settings.landing, database)
    if landing > 1:
        mirrored = states < graph.state_count
        everywhere = decisions | np.roll(decisions, database.captured_frames) if mirrored else decisions
        fits = decisions[wide_transitions.sources] & (_frames_shown(wide_transitions, everywhere, database) >= landing)
        wide = graph.state_frames[:states]
        graph = _graph_of(database, wide_transitions.chosen(fits), graph.threshold, mirrored)
        states = _judged_states(database, graph, specs)
        values = _values_at(graph.state_frames[:states], values, wide)
        actions = build_actions(database, graph)
        keep, _ = judge_transitions(database, graph, actions, specs, body, settings.transitions, progress, values)
        left = _transitions_of(graph, graph.action_has_transition[: len(keep)] & keep)
    else:
        left = wide_transitions.chosen(chosen & decisions[wide_transitions.sources])
    return _graph_of(database, left, graph.threshold, states < graph.state_count)


def _judged_states(database: MotionDatabase, graph: MotionGraph, specs: dict[str, BehaviourSpec]) -> int:
    """Return the number of states whose transitions are judged: the captured ones if enough (``solved_states``)."""
    return solved_states(database, graph, map(_coarse, specs.values()))


def _graph_of(database: MotionDatabase, transitions: Transitions, threshold: float, mirrored: bool) -> MotionGraph:
    """Return the graph of some transitions, with their mirror images if it is ``mirrored``."""
    if mirrored:
        transitions = with_images(transitions, database.captured_frames, database.frame_count)
    return graph_of_transitions(transitions, database.segment_starts, threshold, database.segment_names)


def _frames(seconds: float, database: MotionDatabase) -> int:
    return max(1, round(seconds * database.control_rate))


def _transitions_of(graph: MotionGraph, which: Array) -> Transitions:
    """Return the transitions that some actions begin with, in the order of (source, target), as actions are."""
    chosen = np.flatnonzero(which)
    sources = graph.state_frames[graph.action_states[chosen]]
    return Transitions(sources, graph.action_first[chosen], graph.action_costs[chosen])


def _frames_shown(transitions: Transitions, decisions: Array, database: MotionDatabase) -> Array:
    """Return how many frames each transition shows up to the next decision of the clip, or its end. Shape (T,)."""
    stops = np.flatnonzero(
        decisions | np.isin(np.arange(database.frame_count), np.asarray(database.segment_starts) - 1)
    )
    following = np.searchsorted(stops, transitions.targets)
    return stops[np.minimum(following, len(stops) - 1)] - transitions.targets + 1


def judge_transitions(
    database: MotionDatabase,
    graph: MotionGraph,
    actions: Actions,
    specs: dict[str, BehaviourSpec],
    body: TargetBody,
    most: int,
    progress: Progress | None = None,
    values: dict[str, Array] | None = None,
) -> tuple[Array, Array]:
    """Return which actions of a graph are kept, and what each adds to those kept before it.

    Args:
        database: The motion.
        graph: The graph.
        actions: Its actions.
        specs: What is to be learned, by name.
        body: Sizes of the target.
        most: Most actions that begin with a transition that each state keeps.
        progress: Called with (stage, done, total).
        values: Values of each behaviour from which to start, shape (S, C); replaced by those that were found.

    Returns:
        Whether each action is kept, shape (A,), bool; where captured motion runs on, it always is. What each of the
        others adds to the value of its state, in parts of the behaviours' scales, shape (A,), float64. A counts the
        actions of the states that are solved (``mirroring.solved_states``).
    """
    from crowdsim.training.kernels import judging

    actions = leading_actions(actions, _judged_states(database, graph, specs))
    targets, values = sample_targets(database), {} if values is None else values
    worth = np.empty((len(specs), actions.action_count, len(targets)), np.float32)
    factors, prices = np.zeros((len(specs), len(targets))), np.zeros((len(specs), actions.action_count))
    for row, (name, spec) in enumerate(specs.items()):
        lesson = Lesson(f"prune, {name}", _coarse(spec), database, actions, body, progress)
        values[name] = lesson.solve(values.get(name)).values
        worth[row], scale = lesson.judge(values[name], targets)
        fades = fades_of(lesson.grid, targets)
        factors[row] = (fades / scale if scale > 0.0 else 0.0) if spec.normalise else fades
        priced = tuple(term for term in lesson.terms if isinstance(term, TransitionTerm))
        prices[row] = -once_of(priced, actions)  # what the transition into each action costs
    keep, gains = np.zeros(actions.action_count, np.uint8), np.zeros(actions.action_count)
    jumps, judged = graph.action_has_transition[: len(keep)], judging.Judged(worth, factors, prices)
    share(actions.state_count, judging.judge_transitions, actions.offsets, jumps, judged, most, keep, gains)
    if progress is not None:
        progress("prune, transitions", actions.state_count, actions.state_count)
    return keep.astype(bool), gains


def _values_at(frames: Array, values: dict[str, Array], of_frames: Array) -> dict[str, Array]:
    """Return the values of the states at frames, taken from those of the states next to them at other frames."""
    middles = (of_frames[1:] + of_frames[:-1]) / 2.0
    return {name: table[np.searchsorted(middles, frames)] for name, table in values.items()}


def _coarse(spec: BehaviourSpec) -> BehaviourSpec:
    """Return a behaviour on a grid of few points, solved roughly."""
    axes = {
        name: axis.model_copy(update={"count": min(axis.count, COARSE.get(name, FEW))})
        for name, axis in spec.axes.given().items()
    }
    changes = {
        "axes": spec.axes.model_copy(update=axes),
        "lookup": "v",
        "backup": "interpolation_of_max",
        "solver": ValueIterationSpec(tolerance=ROUGH),
        "finer": 1,
    }
    return spec.model_copy(update=changes)

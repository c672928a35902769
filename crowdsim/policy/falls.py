"""Falls and staggers as actions behind all those that states choose among, for control to knock avatars down with.

Each can start from any pose: its motion is laid on the avatar's ground transform, and blends in as any other does. A
fall leads from standing to lying, a piece of lying can be repeated, and rising leads back to a state of the graph.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.graph.features import frame_features
from crowdsim.motion import ground
from crowdsim.motion.falls import FallSpans, no_falls
from crowdsim.policy.actions import Actions

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.graph.settings import GraphSettings
    from crowdsim.motion.database import MotionDatabase


LIE = 0.5
"""Length of a piece of lying that can be repeated [s]."""
FALL, LYING, RISE, STAGGER = range(4)
"""Kinds of such actions."""


@dataclass(frozen=True)
class Falls:
    """The falls and staggers of a policy, by numbers of actions: F falls, G staggers.

    Attributes:
        fall: From standing to lying. Shape (F,), int32.
        lie: A short piece of lying, which can follow the fall, or itself. Its state of arrival is that of the rise, as
            is that of the fall. Shape (F,), int32.
        rise: From lying to a state of the graph. Shape (F,), int32.
        direction: Bearing of the trunk's way in the avatar's ground frame at the start: 0 forward, pi / 2 to the left
            [rad]. Shape (F,), float32.
        stagger: From standing to a state of the graph. Shape (G,), int32.
        stagger_direction: Bearing of the trunk's way likewise [rad]. Shape (G,), float32.
    """

    fall: Array
    lie: Array
    rise: Array
    direction: Array
    stagger: Array
    stagger_direction: Array

    @property
    def actions(self) -> Array:
        """All of these actions, those of a fall side by side, and staggers behind them. Shape (3 F + G,), int32."""
        three = np.stack([self.fall, self.lie, self.rise], axis=1).reshape(-1)
        return np.concatenate([three, self.stagger]).astype(np.int32)


def add_falls(
    database: MotionDatabase, graph: MotionGraph, actions: Actions, settings: GraphSettings
) -> tuple[MotionGraph, Actions, Falls | None]:
    """Return a graph and its actions with the falls of the motion behind them, and which these are.

    None and nothing new where the motion has no falls.

    Args:
        database: The motion.
        graph: The graph, without falls.
        actions: Its actions.
        settings: How poses are compared: a rise ends in the state whose pose is nearest.
    """
    spans = database.falls
    if not spans.any:
        return graph, actions, None
    first, lengths, arrivals = _pieces(database, spans)
    states = _nearest_states(database, graph, arrivals, settings)
    count, before = len(first), graph.choice_count
    extended = replace(
        graph,
        action_next=np.concatenate([graph.action_next, states]),
        action_first=np.concatenate([graph.action_first, first]),
        action_lengths=np.concatenate([graph.action_lengths, lengths]),
        action_costs=np.concatenate([graph.action_costs, np.zeros(count, np.float32)]),
    )
    numbers = np.arange(before, before + count, dtype=np.int32)
    three, staggers = np.split(numbers, [3 * len(spans.starts)])
    fall, lie, rise = (np.ascontiguousarray(part) for part in three.reshape(-1, 3).T)
    falls = Falls(fall, lie, rise, spans.directions, staggers, spans.stagger_directions)
    return extended, actions_behind(database, actions, first, lengths, states), falls


def _pieces(database: MotionDatabase, spans: FallSpans) -> tuple[Array, Array, Array]:
    """Return first frame and length of each action, those of a fall side by side, and the frame that it leads to.

    What leads to no state has the frame that the rise leads to. Shapes (3 F + G,), int32.
    """
    most = max(1, round(LIE * database.control_rate))
    lying = np.minimum(spans.rises - spans.downs, most)
    first = np.stack([spans.starts, spans.downs, spans.rises], axis=1) + 1
    lengths = np.stack([spans.downs - spans.starts, lying, spans.stops - spans.rises], axis=1)
    arrivals = np.repeat(spans.stops, 3)
    starts, stops = spans.staggers.T
    return (
        np.concatenate([first.reshape(-1), starts + 1]).astype(np.int32),
        np.concatenate([lengths.reshape(-1), stops - starts]).astype(np.int32),
        np.concatenate([arrivals, stops]).astype(np.int32),
    )


def _nearest_states(database: MotionDatabase, graph: MotionGraph, frames: Array, settings: GraphSettings) -> Array:
    """Return the state whose pose is nearest to that at each control frame, the first among equals. Int32."""
    features = frame_features(database, settings).astype(np.float64)
    states = features[graph.state_frames]
    return np.array([np.argmin(np.sum((states - features[frame]) ** 2, axis=1)) for frame in frames], np.int32)


def actions_behind(
    database: MotionDatabase,
    actions: Actions,
    first: Array,
    lengths: Array,
    states: Array,
    shifts: Array | None = None,
) -> Actions:
    """Return actions with more behind them, which have no strikes and cost nothing.

    Args:
        database: The motion.
        actions: The actions.
        first: First frame of each further one. Shape (n,).
        lengths: Its frames. Shape (n,).
        states: The state in which it ends. Shape (n,).
        shifts: How it is laid on what comes before (``alignment.Alignment``); not shifted when None. Shape (n, 3).
    """
    moved = np.zeros((len(first), 3), np.float32) if shifts is None else np.asarray(shifts, np.float32)
    stride, count = database.stride, len(first)
    owner = np.repeat(np.arange(count), lengths)
    ends = np.cumsum(lengths)
    frames = first.astype(np.int64)[owner] + np.arange(ends[-1]) - (ends - lengths)[owner]
    undo = ground.inverse(database.ground[stride * (first.astype(np.int64) - 1)])
    if shifts is not None:
        undo = ground.compose(moved, undo)
    paths = ground.compose(undo[owner], database.ground[stride * frames])
    return actions._replace(
        next=np.concatenate([actions.next, states]),
        lengths=np.concatenate([actions.lengths, lengths]),
        shifts=np.concatenate([actions.shifts, moved]),
        costs=np.concatenate([actions.costs, np.zeros(count, np.float32)]),
        path_offsets=np.concatenate([actions.path_offsets, actions.path_offsets[-1] + ends]).astype(np.int32),
        paths=np.concatenate([actions.paths, paths.astype(np.float32)]),
        strike_offsets=np.concatenate([actions.strike_offsets, np.full(count, actions.strike_offsets[-1])]).astype(
            np.int32
        ),
    )


def spans_of(falls: Falls | None, graph: MotionGraph) -> FallSpans:
    """Return the spans of a motion database from which ``add_falls`` made these actions."""
    if falls is None:
        return no_falls()
    before = np.asarray(graph.action_first, np.int32) - np.int32(1)
    last = before + np.asarray(graph.action_lengths, np.int32)
    return FallSpans(
        starts=before[falls.fall],
        downs=last[falls.fall],
        rises=before[falls.rise],
        stops=last[falls.rise],
        directions=np.asarray(falls.direction),
        staggers=np.stack([before[falls.stagger], last[falls.stagger]], axis=1),
        stagger_directions=np.asarray(falls.stagger_direction),
    )


def flatten_falls(falls: Falls | None) -> dict[str, Array]:
    """Return the arrays of falls by the names that they have in a bundle; none where there are no falls."""
    return {} if falls is None else {f"falls_{field.name}": getattr(falls, field.name) for field in fields(falls)}


def read_falls(arrays: Mapping[str, Array]) -> Falls | None:
    """Return the falls in the arrays of a bundle."""
    names = [field.name for field in fields(Falls)]
    if f"falls_{names[0]}" not in arrays:
        return None
    return Falls(*(arrays[f"falls_{name}"] for name in names))

"""Falls, staggers and celebrations as actions behind all those that states choose among.

Each can start from any pose: its motion is laid on the ground transform of an avatar, and blends in as any other does.
A fall leads from standing to lying, a piece of lying can be repeated; rising, staggers and celebrations lead back to
a state of the graph.
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
from crowdsim.policy.actions import Actions, Stillness, stillness_between

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.graph.settings import GraphSettings
    from crowdsim.motion.database import MotionDatabase


LIE = 5.0 / 3.0
"""Longest piece of lying that is repeated [s]: one in which the embedded boxer breathes once."""
LEAVES = 0.6
"""Time after a stagger, getting up or a rest within which captured motion is left for a state [s]."""
HASTE = 0.03
"""What a second counts for that it takes longer to be in a state, beside how unlike poses are [m/s]."""
FALL, LYING, RISE, STAGGER, CHEER = range(5)
"""Kinds of such actions."""


@dataclass(frozen=True)
class Falls:
    """The falls, staggers and celebrations of a policy, by numbers of actions: F falls, G staggers, C celebrations.

    Attributes:
        fall: From standing to lying. Shape (F,), int32.
        lie: A short piece of lying, which can follow the fall, or itself. Its state of arrival is that of the rise, as
            is that of the fall. Shape (F,), int32.
        rise: From lying to a state of the graph. Shape (F,), int32.
        direction: Bearing of the trunk's way in the avatar's ground frame at the start: 0 forward, pi / 2 to the left
            [rad]. Shape (F,), float32.
        stagger: From standing to a state of the graph. Shape (G,), int32.
        stagger_direction: Bearing of the trunk's way likewise [rad]. Shape (G,), float32.
        stop: Control frame in which each rise brings the body to stand. Shape (F,), int32.
        stagger_stop: Control frame in which each stagger is over. Shape (G,), int32.
        cheer: From standing to a state of the graph, fists raised between. Shape (C,), int32.
        cheer_stop: Control frame in which each celebration is over. Shape (C,), int32.
    """

    fall: Array
    lie: Array
    rise: Array
    direction: Array
    stagger: Array
    stagger_direction: Array
    stop: Array
    stagger_stop: Array
    cheer: Array
    cheer_stop: Array

    @property
    def actions(self) -> Array:
        """All of these actions, those of a fall side by side, then staggers and celebrations. Shape (n,), int32."""
        return numbers_of(self.fall, self.lie, self.rise, self.stagger, self.cheer)


def numbers_of(fall: Array, lie: Array, rise: Array, stagger: Array, cheer: Array) -> Array:
    """Return the numbers of all actions, as in ``Falls``. Shape (n,), int32."""
    return np.concatenate([np.stack([fall, lie, rise], axis=1).reshape(-1), stagger, cheer]).astype(np.int32)


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
    stops, ends, states = _arrivals(database, graph, settings)
    first, lengths = _frames(database, stops, ends)
    up, stay = np.split(states, [len(spans.starts)])
    states = np.concatenate([np.repeat(up, 3), stay])
    count, before = len(first), graph.choice_count
    extended = replace(
        graph,
        action_next=np.concatenate([graph.action_next, states]),
        action_first=np.concatenate([graph.action_first, first]),
        action_lengths=np.concatenate([graph.action_lengths, lengths]),
        action_costs=np.concatenate([graph.action_costs, np.zeros(count, np.float32)]),
    )
    numbers = np.arange(before, before + count, dtype=np.int32)
    three, staggers, cheers = np.split(numbers, np.cumsum([3 * len(spans.starts), len(spans.staggers)]))
    fall, lie, rise = (np.ascontiguousarray(part) for part in three.reshape(-1, 3).T)
    falls = Falls(
        fall=fall,
        lie=lie,
        rise=rise,
        direction=spans.directions,
        stagger=staggers,
        stagger_direction=spans.stagger_directions,
        stop=spans.stops,
        stagger_stop=spans.staggers[:, 1],
        cheer=cheers,
        cheer_stop=spans.cheers[:, 1],
    )
    return extended, actions_behind(database, actions, first, lengths, states), falls


def _frames(database: MotionDatabase, stops: Array, ends: Array) -> tuple[Array, Array]:
    """Return first frame and length of each action, those of a fall side by side. Shapes (n,), int32.

    Args:
        database: The motion.
        stops: Last frame of each rise. Shape (F,).
        ends: Last frame of each stagger and celebration. Shape (G + C,).
    """
    spans = database.falls
    most = max(1, round(LIE * database.control_rate))
    lying = np.minimum(spans.rises - spans.downs, most)
    first = np.stack([spans.starts, spans.downs, spans.rises], axis=1) + 1
    lengths = np.stack([spans.downs - spans.starts, lying, stops - spans.rises], axis=1)
    starts = np.concatenate([spans.staggers, spans.cheers])[:, 0]
    return (
        np.concatenate([first.reshape(-1), starts + 1]).astype(np.int32),
        np.concatenate([lengths.reshape(-1), ends - starts]).astype(np.int32),
    )


def _arrivals(database: MotionDatabase, graph: MotionGraph, settings: GraphSettings) -> tuple[Array, Array, Array]:
    """Return the last frame of each rise, of each stagger and celebration, and the state whose pose is most like it.

    The states of rises come first. Shapes (F,), (G + C,) and (F + G + C,), int32.
    """
    spans = database.falls
    features = frame_features(database, settings).astype(np.float64)
    ends, found, stillness = [], [], stillness_between(database)
    # Motion is left before it strikes, falls again or comes to rest, and before the clip ends.
    strikes, rests = database.strike_frames // database.stride, database.rests.frames[:, 0]
    bounds = np.sort(np.concatenate([database.clip_starts - 1, strikes, spans.spans[:, 0], rests]))
    for stop in np.concatenate([spans.stops, spans.staggers[:, 1], spans.cheers[:, 1]]).astype(int):
        bound = int(bounds[np.searchsorted(bounds, stop, side="right")]) - 1
        end, state = way_to_state(database, graph, features, stillness, stop, max(stop, bound))
        ends.append(end)
        found.append(state)
    rises, others = np.split(np.array(ends, np.int32), [len(spans.stops)])
    return rises, others, np.array(found, np.int32)


def way_to_state(
    database: MotionDatabase, graph: MotionGraph, features: Array, stillness: Stillness, first: int, last: int
) -> tuple[int, int]:
    """Return the frame in which captured motion is left for a state, and that state.

    That is where the transition is least visible, soon after ``first``.

    Args:
        database: The motion.
        graph: The graph.
        features: Features of all frames.
        stillness: How much more visible a transition is, see ``actions.stillness_between``.
        first: First frame that may be left.
        last: Last one.
    """
    last = min(last, first + round(LEAVES * database.control_rate))
    frames = np.arange(first, last + 1)
    states = features[graph.state_frames]
    gaps = np.array([np.linalg.norm(states - features[frame], axis=1) for frame in frames])
    gaps *= stillness(frames[:, None], graph.state_frames)
    gaps += HASTE / database.control_rate * np.arange(len(frames))[:, None]
    at, state = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    return int(frames[at]), int(state)


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
        stops=np.asarray(falls.stop),
        directions=np.asarray(falls.direction),
        staggers=np.stack([before[falls.stagger], np.asarray(falls.stagger_stop)], axis=1),
        stagger_directions=np.asarray(falls.stagger_direction),
        cheers=np.stack([before[falls.cheer], np.asarray(falls.cheer_stop)], axis=1),
    )


def flatten_falls(falls: Falls | None) -> dict[str, Array]:
    """Return the arrays of falls by the names that they have in a bundle; none where there are no falls."""
    return {} if falls is None else {f"falls_{field.name}": getattr(falls, field.name) for field in fields(falls)}


def read_falls(arrays: Mapping[str, Array]) -> Falls | None:
    """Return the falls in the arrays of a bundle; in older ones, bodies stand when rises and staggers end."""
    if "falls_fall" not in arrays:
        return None
    last = arrays["graph_action_first"] + arrays["graph_action_lengths"] - np.int32(1)
    stops = {"falls_stop": last[arrays["falls_rise"]], "falls_stagger_stop": last[arrays["falls_stagger"]]}
    found = {**stops, "falls_cheer": last[:0], "falls_cheer_stop": last[:0], **arrays}
    return Falls(**{field.name: found[f"falls_{field.name}"] for field in fields(Falls)})

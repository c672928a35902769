"""Walks of those who stand at ease: out of a piece of a rest, in parts, to another rest in which no walk begins.

A walk begins in a pose that is like one at ease before it in the motion, no less than poses are between which the graph
has transitions. A walk is always finished: it is not broken off for a fight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.alignment import align_transitions
from crowdsim.policy.falls import actions_behind

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.motion.rests import RestSpans
    from crowdsim.policy.actions import Actions

HASTE = 0.03
"""What a second counts for that an avatar stands before it walks off, beside the costs of transitions [m/s]."""


@dataclass(frozen=True)
class Walks:
    """The walks of a policy's R rests, whose pieces have the numbers 0 to B - 1: W ways into them, V parts.

    Attributes:
        spans: First and last frame at ease before each rest's walk, see ``RestSpans.walks``. Shape (R, 2), int32.
        take: Actions out of pieces at ease to the end of the first part of a walk. Shape (W,), int32.
        piece: The piece at whose end each begins, ascending. Shape (W,), int32.
        row: The piece or part in the pose of whose end it ends; that of part v is B + v. Shape (W,), int32.
        hold: Actions that show the parts. The first part of a walk is never performed: it stands for the pose at its
            end, and the last one is the first piece of its rest. Shape (V,), int32.
        next: The part or piece that follows each. Shape (V,), int32.
    """

    spans: Array
    take: Array
    piece: Array
    row: Array
    hold: Array
    next: Array


def no_walks() -> Walks:
    """Return the walks of rests without any."""
    return Walks(np.zeros((0, 2), np.int32), *np.zeros((5, 0), np.int32))


def walk_cuts(go: int, begin: int, piece: float) -> Array:
    """Return the frames from the last one before a walk to its end, cut in parts of about so many frames. Int64."""
    count = max(1, round((begin - go) / piece))
    return np.linspace(go, begin, count + 1).round().astype(int)


@dataclass(frozen=True)
class Laid:
    """Actions by frames of the motion, n of them.

    Attributes:
        before: The frame in whose pose each begins. Shape (n,).
        first: The first frame that it shows. Shape (n,).
        last: Its last frame. Shape (n,).
        states: The state in which it ends. Shape (n,).
    """

    before: Array
    first: Array
    last: Array
    states: Array


def laid_behind(
    database: MotionDatabase, graph: MotionGraph, actions: Actions, features: Array, laid: Laid, costs: Array
) -> tuple[MotionGraph, Actions, Array]:
    """Return a graph and its actions with more behind them, and the numbers of these.

    The first of them have the given costs; the others cost what their poses are apart [m].
    """
    first, lengths = laid.first.astype(np.int32), (laid.last - laid.first + 1).astype(np.int32)
    states = laid.states.astype(np.int32)
    stride, after = database.stride, laid.first.astype(np.int64) - 1
    shifts = align_transitions(database, laid.before.astype(np.int64) * stride, after * stride).shifts
    shifts[laid.before == after] = 0.0
    apart = np.linalg.norm(features[laid.before] - features[after], axis=1).astype(np.float32)
    apart[: len(costs)] = costs
    extended = replace(
        graph,
        action_next=np.concatenate([graph.action_next, states]),
        action_first=np.concatenate([graph.action_first, first]),
        action_lengths=np.concatenate([graph.action_lengths, lengths]),
        action_costs=np.concatenate([graph.action_costs, apart]),
    )
    numbers = np.arange(graph.action_count, graph.action_count + len(first), dtype=np.int32)
    return extended, actions_behind(database, actions, first, lengths, states, shifts), numbers


def add_walks(
    database: MotionDatabase,
    graph: MotionGraph,
    actions: Actions,
    features: Array,
    poses: Array,
    ends: list[tuple[int, int]],
    states: Array,
    piece: float,
    limit: float,
) -> tuple[MotionGraph, Actions, Walks]:
    """Return a graph and its actions with the walks behind them, and which these are.

    Args:
        database: The motion.
        graph: The graph, with rests.
        actions: Its actions.
        features: Features of all frames.
        poses: The frame in whose pose each piece of the rests ends. Shape (B,).
        ends: First and last piece of each rest.
        states: The state to which each piece leads back. Shape (B,).
        piece: About how long parts are [control frames].
        limit: What a walk's transition costs at the most [m].
    """
    spans = database.rests
    # An avatar that has just come to rest stands for a piece before it goes.
    starts = np.concatenate(
        [np.arange(a + 1, b + 1) for (a, b), far in zip(ends, spans.walked, strict=True) if not far]
    )
    ways: list[tuple[int, int, int, int, int]] = []
    parts: list[tuple[int, int, int, int]] = []
    for number in np.flatnonzero(spans.walked).tolist():
        own, count = ends[number][0], len(poses) + len(parts)
        cuts = walk_cuts(int(spans.walks[number, 1]), int(poses[own]), piece)
        row = own if len(cuts) == 2 else count
        for start, frame in zip(starts, _like(database, features, spans, number, poses[starts], limit), strict=True):
            if frame >= 0:
                ways.append((int(start), frame, int(cuts[1]), row, own))
        for k in range(len(cuts) - 2):
            parts.append((int(cuts[k]), int(cuts[k + 1]), own if k == len(cuts) - 3 else count + k + 1, own))
    if not ways:
        return graph, actions, no_walks()
    ways.sort()
    taken, held = np.array(ways, np.int64), np.array(parts, np.int64).reshape(-1, 4)
    laid = Laid(
        before=np.concatenate([poses[taken[:, 0]], held[:, 0]]),
        first=np.concatenate([taken[:, 1], held[:, 0]]) + 1,
        last=np.concatenate([taken[:, 2], held[:, 1]]),
        states=states[np.concatenate([taken[:, 4], held[:, 3]])],
    )
    graph, actions, numbers = laid_behind(database, graph, actions, features, laid, np.zeros(0, np.float32))
    take, hold = np.split(numbers, [len(taken)])
    piece_of, row_of, following = (part.astype(np.int32) for part in (taken[:, 0], taken[:, 3], held[:, 2]))
    return graph, actions, Walks(spans.walks, take, piece_of, row_of, hold, following)


def _like(
    database: MotionDatabase, features: Array, spans: RestSpans, number: int, poses: Array, limit: float
) -> list[int]:
    """Return the frame at ease before a rest's walk that is most like each pose; -1 where none is like it."""
    first, last = spans.walks[number]
    frames, contacts = np.arange(first, last + 1), database.contacts[:: database.stride]
    found = []
    for pose in poses:
        gaps = np.linalg.norm(features[frames] - features[pose], axis=1)
        differ = (gaps > limit) | np.any(contacts[frames] != contacts[pose], axis=1)
        costs = np.where(differ, np.inf, gaps + HASTE / database.control_rate * (last - frames))
        best = int(np.argmin(costs))
        found.append(-1 if np.isinf(costs[best]) else int(frames[best]))
    return found


def flatten_walks(walks: Walks) -> dict[str, Array]:
    """Return the arrays of walks by the names that they have in a bundle; none where there are no walks."""
    return {f"walks_{field.name}": getattr(walks, field.name) for field in fields(walks)} if len(walks.take) else {}


def read_walks(arrays: Mapping[str, Array]) -> Walks:
    """Return the walks in the arrays of a bundle."""
    names = [f"walks_{field.name}" for field in fields(Walks)]
    return Walks(*(arrays[name] for name in names)) if names[0] in arrays else no_walks()

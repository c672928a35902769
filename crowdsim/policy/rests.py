"""Rests as actions behind all those that states choose among, for avatars that need not fight.

A rest is entered from a state whose pose is like one of the guard before it, no less than poses are between which the
graph has transitions. Standing at ease is cut into short pieces that can be repeated without end; out of each of them
an action leads back to the guard, and to a state. Out of some a walk leads to another rest (``walks``).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.graph.features import frame_features
from crowdsim.motion.rests import DOWN, FIRST, LAST, START, STOP, UP, RestSpans, no_rests, rests_on_the_spot
from crowdsim.policy.actions import Actions, Stillness, stillness_between
from crowdsim.policy.falls import HASTE, way_to_state
from crowdsim.policy.walks import Laid, Walks, add_walks, flatten_walks, laid_behind, no_walks, read_walks, walk_cuts

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.graph.settings import GraphSettings
    from crowdsim.motion.database import MotionDatabase

ENTRIES = 256
"""Most states from which rests are entered; those of the cheapest transitions."""
AWAY = 0.4
"""Way from which on a body that comes to rest goes away from where it was [m]."""
_LATE = 0.4
"""How long before it begins to go it may be entered [s]."""
_EARLY, _LONG = 0.25, 0.5
"""Share of the time at ease in which repetition begins, and least share that is repeated."""
_ALIKE = 0.5
"""How far a rest may be from the end of the one before it, over what a transition of a fight costs at the most."""
_LEAVES = 0.75
"""Share of the time at ease after which the way back to the guard may begin."""


@dataclass(frozen=True)
class Rests:
    """The rests of a policy: E ways into them, B pieces of standing at ease.

    Attributes:
        frames: Where they are in the motion, see ``RestSpans``. Shape (K, 6), int32.
        enter: Actions from the guard to standing at ease. Shape (E,), int32.
        state: The state that each begins in, ascending. Shape (E,), int32.
        row: The piece, by its number, in the pose of whose end it ends. Shape (E,), int32.
        hold: Actions that stand at ease for a while. Shape (B,), int32.
        leave: Actions from the end of each of these to a state. Shape (B,), int32.
        next: The piece that follows each. Shape (B,), int32.
        walks: What leads from these pieces to rests that are entered from no state.
    """

    frames: Array
    enter: Array
    state: Array
    row: Array
    hold: Array
    leave: Array
    next: Array
    walks: Walks = field(default_factory=no_walks)

    @property
    def actions(self) -> Array:
        """All of these actions, those of walks behind the others. Int32."""
        return np.concatenate([self.enter, self.hold, self.leave, self.walks.take, self.walks.hold])


@dataclass(frozen=True)
class _Piece:
    """A piece of a rest: what it shows, and what follows.

    Attributes:
        before: Frame in whose pose it begins.
        first: First frame that it shows.
        last: Its last frame.
        next: Number of the piece that follows.
    """

    before: int
    first: int
    last: int
    next: int


def add_rests(
    database: MotionDatabase, graph: MotionGraph, actions: Actions, settings: GraphSettings, seconds: float | None
) -> tuple[MotionGraph, Actions, Rests | None]:
    """Return a graph and its actions with the rests of the motion behind them, and which these are.

    None and nothing new where the motion has no rests, or no state is like the guard before any. A piece of standing at
    ease is about so many ``seconds`` long; None for no rests.
    """
    if seconds is None or not len(database.rests.frames):
        return graph, actions, None
    features = frame_features(database, settings).astype(np.float64)
    length = seconds * database.control_rate
    limit = float(np.percentile(graph.action_costs[: graph.choice_count][graph.action_has_transition], 90))
    pieces, ends, begins = _all_pieces(features, database, length, _ALIKE * limit)
    stillness = stillness_between(database)
    state, frame, rest, costs = _entries(database, graph, features, stillness, limit)
    if not len(state):
        return graph, actions, None
    poses = np.array([piece.last for piece in pieces])
    poses[[first for first, _ in ends]] = begins
    leave_from, leave_to, arrivals = _ways_back(database, graph, features, stillness, poses)
    begin = np.array([begins[k] for k in rest], np.int64)
    row = np.array([ends[k][0] for k in rest], np.int32)
    laid = Laid(
        before=np.concatenate([graph.state_frames[state], [p.before for p in pieces], poses]),
        first=np.concatenate([frame + 1, [p.first for p in pieces], leave_from + 1]),
        last=np.concatenate([begin, [p.last for p in pieces], leave_to]),
        states=np.concatenate([arrivals[row], arrivals, arrivals]),
    )
    graph, actions, numbers = laid_behind(database, graph, actions, features, laid, costs)
    graph, actions, walks = add_walks(database, graph, actions, features, poses, ends, arrivals, length, limit)
    enter, hold, leave = np.split(numbers, [len(state), len(state) + len(pieces)])
    rests = Rests(
        frames=database.rests.frames,
        enter=enter,
        state=state.astype(np.int32),
        row=row,
        hold=hold,
        leave=leave,
        next=np.array([p.next for p in pieces], np.int32),
        walks=walks,
    )
    return graph, actions, rests


def _all_pieces(
    features: Array, database: MotionDatabase, length: float, alike: float
) -> tuple[list[_Piece], list[tuple[int, int]], list[int]]:
    """Return the pieces of all rests, the first and last number of each rest's, and where each begins to repeat.

    The first piece of a rest is never performed: it stands for the pose in which the rest has been entered. Where a
    walk leads there, it is the last part of that. Pieces are about ``length`` frames long. Behind a rest comes another
    one, whose pose at its start is at most ``alike`` [m] from that in which the rest ends, or the same one again.
    """
    pieces: list[_Piece] = []
    ends, spans = [], database.rests
    cuts = []
    for row in spans.frames.astype(int):
        start, stop = _loop(features, row)
        count = max(1, round((stop - start) / length))
        cuts.append(np.linspace(start, stop, count + 1).round().astype(int).tolist())
    begins, stops = [cut[0] for cut in cuts], [cut[-1] for cut in cuts]
    firsts = np.cumsum([0, *(len(cut) + 1 for cut in cuts)]).tolist()
    following = _order_rests(features, database, begins, stops, alike)
    for number, (cut, then) in enumerate(zip(cuts, following, strict=True)):
        own, start = len(pieces), cut[0]
        if spans.walked[number]:
            before = int(walk_cuts(int(spans.walks[number, 1]), start, length)[-2])
            pieces.append(_Piece(before, before + 1, start, own + 1))
        else:
            pieces.append(_Piece(start, start + 1, cut[1], own + 1))
        for part, (one, other) in enumerate(itertools.pairwise(cut)):
            pieces.append(_Piece(one, one + 1, other, own + 2 + part))
        # Behind the last piece the next rest begins, out of the last one's pose.
        pieces.append(_Piece(cut[-1], begins[then] + 1, cuts[then][1], firsts[then] + 2))
        ends.append((own, own + len(cut)))
    return pieces, ends, begins


def _order_rests(
    features: Array, database: MotionDatabase, begins: list[int], stops: list[int], alike: float
) -> list[int]:
    """Return the number of the rest that follows each, so that rests form cycles.

    Beginning with the lowest number, each is followed by that rest not yet in a cycle which begins most like it ends;
    the last one of a cycle by the first. Poses may be ``alike`` [m] apart at the most, and both feet must touch the
    floor alike; a rest that no other may follow repeats. Rests behind a walk follow one another alone.
    """
    contacts, walked = database.contacts[:: database.stride], database.rests.walked
    gaps = np.linalg.norm(features[stops][:, None] - features[begins][None], axis=-1)
    apart = (gaps > alike) | np.any(contacts[stops][:, None] != contacts[begins][None], axis=-1)
    gaps[apart | (walked[:, None] != walked[None])] = np.inf
    following = list(range(len(begins)))
    left = set(following)
    while left:
        first = at = min(left)
        while at in left:
            left.remove(at)
            near = [other for other in sorted(left) if np.isfinite(gaps[at, other])]
            if near:
                following[at] = near[int(np.argmin(gaps[at, near]))]
            elif np.isfinite(gaps[at, first]):
                following[at] = first
            at = following[at]
    return following


def _loop(features: Array, row: Array) -> tuple[int, int]:
    """Return the frames of a rest between which motion repeats best: the first early, the second late enough."""
    down, up = int(row[DOWN]), int(row[UP])
    span = up - down
    starts = np.arange(down, down + max(int(_EARLY * span), 1))
    stops = np.arange(min(down + max(int((_EARLY + _LONG) * span), 2), up), up + 1)
    gaps = np.linalg.norm(features[starts][:, None] - features[stops][None], axis=-1)
    best = int(np.argmin(gaps))
    return int(starts[best // len(stops)]), int(stops[best % len(stops)])


def _entries(
    database: MotionDatabase, graph: MotionGraph, features: Array, stillness: Stillness, limit: float
) -> tuple[Array, Array, Array, Array]:
    """Return states from which rests are entered, the frame each is like, its rest, and what that costs [m].

    These are the least visible ones (``actions.stillness``), and none costs more than ``limit``. Rests to which a walk
    leads are not entered otherwise. Those that step back are entered from states of their own, from one for each of
    the last frames before them: an avatar in a pose like theirs enters one by how far it leads.
    """
    states, contacts = features[graph.state_frames], database.contacts[:: database.stride]
    best, costs = np.full((2, graph.state_count), np.inf)
    frames, rests = np.zeros((2, graph.state_count), np.int64)
    backs = []

    def price(frame: int) -> tuple[Array, Array]:
        cost = np.linalg.norm(states - features[frame], axis=1)
        cost[np.any(contacts[graph.state_frames] != contacts[frame], axis=1) | (cost > limit)] = np.inf
        return cost, cost * stillness(graph.state_frames, np.array(frame))

    for number, row in enumerate(database.rests.frames.astype(int)):
        if database.rests.walked[number]:
            continue
        if _leads_away(database, row):
            first = max(row[FIRST] + 1, row[START] - round(_LATE * database.control_rate))
            backs += [(number, frame) for frame in range(first, row[START] + 1)]
            continue
        for frame in range(row[FIRST] + 1, row[START] + 1):
            cost, seen = price(frame)
            better = seen < best
            best[better], costs[better], frames[better], rests[better] = seen[better], cost[better], frame, number
    most = np.sort(best)[min(ENTRIES, len(best)) - 1]
    chosen = (best <= most) & np.isfinite(best)
    for number, frame in backs:
        cost, seen = price(frame)
        state = int(np.argmin(np.where(chosen, np.inf, seen)))
        if np.isfinite(seen[state]) and not chosen[state]:
            chosen[state], costs[state], frames[state], rests[state] = True, cost[state], frame, number
    found = np.flatnonzero(chosen)
    return found, frames[found], rests[found], costs[found].astype(np.float32)


def _leads_away(database: MotionDatabase, row: Array) -> bool:
    """Return whether a body goes away from where it stood in the guard before it is at ease."""
    start, down = database.ground[row[[START, DOWN]] * database.stride, :2].astype(float)
    return float(np.hypot(*(down - start))) > AWAY


def _ways_back(
    database: MotionDatabase, graph: MotionGraph, features: Array, stillness: Stillness, poses: Array
) -> tuple[Array, Array, Array]:
    """Return for each piece the frame that its last pose is laid on, the last frame of the way back, and its state."""
    haste = HASTE / database.control_rate
    late, wait, lasts, found = [], [], [], []
    for row in database.rests.frames.astype(int):
        last, state = way_to_state(database, graph, features, stillness, int(row[STOP]), int(row[LAST]))
        frames = np.arange(row[DOWN] + int(_LEAVES * (row[UP] - row[DOWN])), row[UP] + 1)
        late.append(frames)
        wait.append(haste * (row[UP] - frames))
        lasts.append(np.full(len(frames), last))
        found.append(np.full(len(frames), state))
    from_frames, waits, to_frames, arrivals = (np.concatenate(parts) for parts in (late, wait, lasts, found))
    best = np.zeros(len(poses), np.int64)
    for number, pose in enumerate(poses):
        gap = np.linalg.norm(features[from_frames] - features[pose], axis=1) * stillness(pose, from_frames)
        best[number] = np.argmin(gap + waits)
    return from_frames[best], to_frames[best], arrivals[best]


def flatten_rests(rests: Rests | None) -> dict[str, Array]:
    """Return the arrays of rests by the names that they have in a bundle; none where there are no rests."""
    if rests is None:
        return {}
    return {f"rests_{name}": getattr(rests, name) for name in _NAMES} | flatten_walks(rests.walks)


_NAMES = tuple(item.name for item in fields(Rests) if item.name != "walks")


def read_rests(arrays: Mapping[str, Array]) -> Rests | None:
    """Return the rests in the arrays of a bundle."""
    if f"rests_{_NAMES[0]}" not in arrays:
        return None
    parts: dict[str, Any] = {name: arrays[f"rests_{name}"] for name in _NAMES}
    return Rests(**parts, walks=read_walks(arrays))


def rests_of(rests: Rests | None) -> RestSpans:
    """Return where the rests of a policy are in its motion."""
    if rests is None:
        return no_rests()
    frames = np.asarray(rests.frames)
    return RestSpans(frames, np.asarray(rests.walks.spans)) if len(rests.walks.take) else rests_on_the_spot(frames)

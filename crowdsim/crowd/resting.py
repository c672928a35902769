"""The rests of the policies of a run, from which states they can be entered, and where walks out of them lead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.resting import NO_WAY
from crowdsim.motion import ground
from crowdsim.policy.rests import AWAY

if TYPE_CHECKING:
    from crowdsim.policy.actions import Actions
    from crowdsim.policy.policy import Policy
    from crowdsim.policy.rests import Rests


def rest_rows(policies: Sequence[Policy], starts: dict[str, Array]) -> tuple[Array, Array]:
    """Return the rests of all policies, and how their states lead to them; see ``Model``.

    Args:
        policies: The policies.
        starts: First state and first action of each in the run, and the numbers of all.
    """
    rows = [np.zeros((0, 5), np.int64)]
    if all(policy.rests is None for policy in policies):
        return rows[0].astype(np.int32), np.zeros((0, 4), np.int32)
    ways = np.tile([-1, 0, NO_WAY, -1], (int(starts["state"][-1]), 1))
    walked = 0
    for number, policy in enumerate(policies):
        rests = policy.rests
        if rests is None:
            continue
        action, state, before = int(starts["action"][number]), int(starts["state"][number]), sum(map(len, rows))
        ways[state + rests.state, 0], ways[state + rests.state, 1] = action + rests.enter, before + rests.row
        away, walks = leads_away(policy.actions, rests), rests.walks
        until = actions_until(policy.actions, rests.state[~away])
        ways[state : state + len(until), 2] = until
        ways[state + rests.state[away], 3] = walked + len(walks.take) + np.arange(np.count_nonzero(away))
        pieces = np.arange(len(rests.hold) + len(walks.hold))
        first, last = (walked + np.searchsorted(walks.piece, pieces, side) for side in ("left", "right"))
        hold, following = np.concatenate([rests.hold, walks.hold]), np.concatenate([rests.next, walks.next])
        leave = np.concatenate([action + rests.leave, np.full(len(walks.hold), -1)])
        rows.append(np.column_stack([action + hold, leave, before + following, first, last]).astype(np.int64))
        walked += len(walks.take) + np.count_nonzero(away)
    return np.concatenate(rows).astype(np.int32), ways.astype(np.int32)


SPACING = 0.5
"""About how far apart the points of a walk are [m]."""


def leads_away(actions: Actions, rests: Rests) -> Array:
    """Return which of the ways into rests lead away from where they begin. Shape (E,), bool."""
    return np.asarray(np.hypot(*actions.displacements[rests.enter, :2].T.astype(float)) > AWAY)


def walk_rows(policies: Sequence[Policy], starts: dict[str, Array]) -> tuple[Array, Array]:
    """Return the walks of all policies, and their points, see ``Model``. Shapes (n, 3) and (n, most points, 2).

    Behind those of each policy are its ways into rests that lead away.

    Args:
        policies: The policies.
        starts: First action of each in the run, and the number of all.
    """
    heads: list[tuple[float, int, int]] = []
    lines: list[Array] = []
    before = 0
    for number, policy in enumerate(policies):
        rests = policy.rests
        if rests is None:
            continue
        away = leads_away(policy.actions, rests)
        takes = np.concatenate([rests.walks.take, rests.enter[away]])
        for take, row in zip(takes, np.concatenate([rests.walks.row, rests.row[away]]), strict=True):
            path = _path(policy.actions, rests, int(take), int(row))
            far = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
            marks = np.linspace(0.0, far[-1], max(1, round(float(far[-1]) / SPACING)) + 1)[1:]
            heads.append((float(np.hypot(*path.T).max()), int(starts["action"][number]) + int(take), before + int(row)))
            lines.append(np.column_stack([np.interp(marks, far, path[:, column]) for column in range(2)]))
        before += len(rests.hold) + len(rests.walks.hold)
    most = max((len(line) for line in lines), default=0)
    points = np.zeros((len(lines), most, 2))
    for row, line in zip(points, lines, strict=True):
        row[:] = line[np.minimum(np.arange(most), len(line) - 1)]
    return np.array(heads).reshape(-1, 3), points


def note_walks(policies: Sequence[Policy], starts: dict[str, Array], halts: Array) -> None:
    """Write to ``halts`` (A, 2) that whoever walks off halts where the walk ends, see ``Model``."""
    for first, policy in zip(starts["action"], policies, strict=False):
        rests = policy.rests
        if rests is None:
            continue
        count = len(rests.hold)
        rows = np.concatenate([rests.walks.row, count + np.arange(len(rests.walks.hold))])
        for action, row in zip(np.concatenate([rests.walks.take, rests.walks.hold]), rows, strict=True):
            halts[int(first) + int(action)] = _path(policy.actions, rests, int(action), int(row))[-1]


def _path(actions: Actions, rests: Rests, action: int, row: int) -> Array:
    """Return where a walk leads in each control frame, x and z seen from the start of ``action`` [m]. Shape (n, 2).

    ``row`` is the part of the walk, or the piece of the rest behind it, in the pose of whose end that action ends.
    """
    pieces, parts = len(rests.hold), [np.zeros(3), *_frames(actions, action)]
    while row >= pieces:
        row = int(rests.walks.next[row - pieces])
        action = int(rests.hold[row] if row < pieces else rests.walks.hold[row - pieces])
        parts += list(ground.compose(parts[-1], _frames(actions, action)))
    return np.array(parts)[:, :2]


def _frames(actions: Actions, action: int) -> Array:
    """Return the path of an action. Shape (T, 3)."""
    result: Array = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]].astype(float)
    return result


def actions_until(actions: Actions, states: Array) -> Array:
    """Return how many actions lead from each state to one of the given ones, at least; at most ``NO_WAY``. (S,)."""
    choices = slice(0, actions.choice_count)
    owners = np.repeat(np.arange(actions.state_count), np.diff(actions.offsets))
    ends = np.asarray(actions.next, np.int64)[choices]
    found = np.full(actions.state_count, NO_WAY)
    found[states] = 0
    while True:
        nearer = found.copy()
        np.minimum.at(nearer, owners, np.minimum(found[ends] + 1, NO_WAY))
        if np.array_equal(nearer, found):
            return found
        found = nearer

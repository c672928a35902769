"""The rests of the policies of a run, and from which states they can be entered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.resting import NO_WAY

if TYPE_CHECKING:
    from crowdsim.policy.actions import Actions
    from crowdsim.policy.policy import Policy


def rest_rows(policies: Sequence[Policy], starts: dict[str, Array]) -> tuple[Array, Array]:
    """Return the rests of all policies, and how their states lead to them; see ``Model``.

    Args:
        policies: The policies.
        starts: First state and first action of each in the run, and the numbers of all.
    """
    rows = [np.zeros((0, 3), np.int64)]
    if all(policy.rests is None for policy in policies):
        return rows[0].astype(np.int32), np.zeros((0, 3), np.int32)
    ways = np.tile([-1, 0, NO_WAY], (int(starts["state"][-1]), 1))
    for number, policy in enumerate(policies):
        rests = policy.rests
        if rests is None:
            continue
        action, state, before = int(starts["action"][number]), int(starts["state"][number]), sum(map(len, rows))
        ways[state + rests.state, 0], ways[state + rests.state, 1] = action + rests.enter, before + rests.row
        until = actions_until(policy.actions, rests.state)
        ways[state : state + len(until), 2] = until
        rows.append(np.column_stack([action + rests.hold, action + rests.leave, before + rests.next]).astype(np.int64))
    return np.concatenate(rows).astype(np.int32), ways.astype(np.int32)


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

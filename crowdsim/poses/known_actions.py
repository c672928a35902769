"""Actions of a take held against the policies that have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from crowdsim.array_checks import ArrayFault
from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.errors import TakeError

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

AnyTake = TypeVar("AnyTake", bound=TakeData)


def action_counts(policies: Sequence[Policy], indices: Array) -> Array:
    """Return how many actions there are for each avatar, of policies with these indices (N,). Shape (N,), int64."""
    return np.array([len(policy.graph.action_first) for policy in policies], np.int64)[indices]


def with_known_actions(take: AnyTake, policies: Sequence[Policy]) -> AnyTake:
    """Return a take whose actions are all among those of its policies.

    Actions on disk are checked as they are read.

    Raises:
        TakeError: One is not.
    """
    counts = action_counts(policies, np.asarray(take.cast.policies))
    if not isinstance(take.action, np.ndarray):
        return replace(take, action=take.action.limited(counts))
    try:
        check_actions(np.asarray(take.action), counts)
    except ArrayFault as fault:
        raise TakeError(f"take {take.scenario!r}: {fault}") from None
    return take


def check_actions(action: Array, counts: Array) -> None:
    """Hold the actions that avatars do against how many there are.

    Args:
        action: Actions. Shape (T, N).
        counts: How many actions each avatar's policy has. Shape (N,).

    Raises:
        ArrayFault: There is no such action.
    """
    if action.size and int(action.max()) >= int(counts.min()):
        wrong = action >= counts
        if wrong.any():
            row, column = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
            what = f"holds {action[row, column]} at [{row}, {column}]"
            raise ArrayFault("action", f"{what}, expected one of the {counts[column]} actions of the avatar's policy")

"""Actions of a take held against the policies that have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from crowdsim.array_checks import ArrayFault
from crowdsim.core.types import Array
from crowdsim.errors import TakeError
from crowdsim.take.checks import check_actions
from crowdsim.take.data import TakeData
from crowdsim.take.lazy_arrays import StoredColumn

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
    if isinstance(take.action, StoredColumn):
        return replace(take, action=take.action.limited(counts))
    try:
        check_actions(np.asarray(take.action), counts)
    except ArrayFault as fault:
        raise TakeError(f"take {take.scenario!r}: {fault}") from None
    return take

"""What transitions cost, since they are visible: an amount for each, and the weight times how visible it is."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from crowdsim.core.types import Array
from crowdsim.policy.terms.term import Term


class TransitionTerm(Term):
    """What a transition costs: its weight times how visible it is (``Actions.costs``), and an amount for each one."""

    kind: Literal["transition"]
    each: float = Field(default=0.0, ge=0.0, description="What each transition costs however good it is.")

    def of_actions(self, actions: Any) -> Array:
        """Return what each action earns: nothing, less the price of the transition that it begins with. Shape (A,)."""
        costs = np.asarray(actions.costs, dtype=float)
        return -(self.weight * costs + self.each * (costs > 0.0))

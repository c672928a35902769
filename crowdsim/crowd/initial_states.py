"""The states in which avatars begin."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Model
from crowdsim.crowd.model import entry_actions
from crowdsim.crowd.random import Purpose, uniform


def first_actions(seed: int, stances: Array, model: Model, numbers: Array, policy: Array, calm: bool = False) -> Array:
    """Return an action for each avatar that ends in a state drawn from its policy's, if possible in its stance.

    Where they are to be ``calm``, these are states that an action without strikes follows.
    """
    entries = entry_actions(model)
    drawn = uniform(seed, Purpose.START, numbers)
    wanted = stances[numbers]
    action = np.empty(len(numbers), np.int32)
    starts = model.policies["states"]
    if calm:
        owners = np.repeat(np.arange(len(entries)), np.diff(model.offsets))
        calm_ones = owners[np.diff(model.actions["strikes"]) == 0]
        entries = np.where(np.isin(np.arange(len(entries)), calm_ones), entries, -1)
    for p, stance in np.unique(np.stack([policy, wanted], axis=1), axis=0):
        states = np.arange(starts[p], starts[p + 1])
        states = states[entries[states] >= 0]
        if stance > 0:
            own_stance = states[model.stances[states, stance - 1] == 0]
            states = own_stance if len(own_stance) else states
        own = (policy == p) & (wanted == stance)
        action[own] = entries[states[(drawn[own] * len(states)).astype(np.int64)]]
    return action

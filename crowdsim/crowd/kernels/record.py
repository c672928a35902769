"""What the take keeps of each avatar."""

import math

from crowdsim.crowd.kernels.layout import ACTION, ACTIONS, HEADING, LENGTH, NUMBER, OPPONENT, PHASE, POLICY, X, Z
from crowdsim.jit import kernel


@kernel(inline=True)
def write_record(model, avatars, record, row, first, last):
    """Write what the take keeps of avatars ``first`` to ``last`` into a row of the record, by number."""
    whole, real = avatars.whole, avatars.real
    actions, policies = model.actions, model.policies
    for i in range(first, last):
        n = whole[NUMBER, i]
        action = whole[ACTION, i]
        heading = real[HEADING, i]
        record.whole[0, row, n] = action - policies[whole[POLICY, i], ACTIONS]
        record.real[0, row, n] = min(real[PHASE, i], actions[action, LENGTH])
        record.real[1, row, n] = real[X, i]
        record.real[2, row, n] = real[Z, i]
        record.real[3, row, n] = heading - 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
        record.whole[1, row, n] = whole[OPPONENT, i]

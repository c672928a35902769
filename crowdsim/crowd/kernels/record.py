"""What the take keeps of each avatar."""

import math

from crowdsim.jit import kernel


@kernel(inline=True)
def write_record(model, avatars, record, row, first, last):
    """Write what the take keeps of avatars ``first`` to ``last`` into a row of the record, by number."""
    for i in range(first, last):
        n, motion = avatars.number[i], avatars.motion[i]
        record.action[row, n] = motion.action - model.policies[avatars.policy[i]].actions
        record.action_frame[row, n] = min(motion.phase, model.actions[motion.action].length)
        record.x[row, n] = avatars.x[i]
        record.z[row, n] = avatars.z[i]
        heading = avatars.heading[i]
        record.heading[row, n] = heading - 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
        record.opponent[row, n] = avatars.opponent[i]

"""Legs of avatars where their actions end, and whether they meet; slow and plain."""

from functools import lru_cache

import numpy as np
from naive_ground import compose
from naive_policy import move_of
from naive_separation import distance

from crowdsim.crowd.kernels.vetoes.crossed_legs import APART, WITHIN
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics


@lru_cache(maxsize=1000)
def legs(one, action):
    """Knee and sole of both legs, seen from the ground frame in which an action ends [m]. Shape (2, 2, 3)."""
    database, body = one.policy.database, one.policy.database.body
    frame = int(one.policy.graph.state_frames[one.policy.actions.next[action]]) * database.stride
    positions, rotations = forward_kinematics(
        database.skeleton, database.root_positions[frame, None], database.rotations[frame, None]
    )
    points = np.zeros((2, 2, 3))
    for leg, side in enumerate(("left", "right")):
        foot = body.roles[f"{side}_foot"]
        points[leg, 0] = positions[0, body.roles[f"{side}_knee"]]
        sole = body.sole_offsets[leg].mean(axis=0)
        points[leg, 1] = positions[0, foot] + quaternion.rotate(rotations[0, foot].astype(float), sole)
    return ground.to_local(database.ground[frame], points) * one.scale


def crosses_legs(one, action, mine, near):
    """Whether an action ends with a leg in one of a neighbour that has ended its own action."""
    end = compose(mine, move_of(one.policy.actions, action) * [one.scale, one.scale, 1.0])
    own = ground.to_world(end, legs(one, action))
    for other in near:
        its = other.end()
        if np.hypot(*(its - end)[:2]) <= WITHIN:
            their = ground.to_world(its, legs(other, other.action))
            least = APART * 0.5 * (one.scale + other.scale)
            if any(distance(*leg, *another) < least for leg in own for another in their):
                return True
    return False

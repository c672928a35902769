"""A slow, obvious search for how a trunk leans: joint by joint with scipy's rotations, for one strike."""

import numpy as np
from scipy.spatial.transform import Rotation

MOST_TURNS = np.radians([14.0, 14.0, 16.0])


def shortened(vector, most):
    """The vector, no longer than that."""
    size = np.linalg.norm(vector)
    return vector if size <= most else vector * (most / size)


def lean(base, levers, fist, target, goal, compliance):
    """Return the turns of three joints, and how far the pelvis goes, that bring a shoulder to a distance of its wrist.

    Args:
        base: The lowest joint [m]. Shape (3,).
        levers: From each joint to the next one, the last to the shoulder [m]. Shape (3, 3).
        fist: From the wrist to the fist [m]. Shape (3,).
        target: Where the fist has to be [m]. Shape (3,).
        goal: Distance of the wrist from the shoulder [m].
        compliance: How readily each joint turns. Shape (3,).
    """
    turns, move, goes = np.zeros((3, 3)), np.zeros(3), False
    for done in range(10):
        spins = [Rotation.from_rotvec(turn) for turn in turns]
        hang = [None, None, spins[2].apply(levers[2])]
        hang[1] = spins[1].apply(levers[1] + hang[2])
        hang[0] = spins[0].apply(levers[0] + hang[1])
        wrist = target - (spins[0] * spins[1] * spins[2]).apply(fist)
        gap = wrist - (base + hang[0] + move)
        way = gap / np.linalg.norm(gap)
        ways = [way, spins[0].inv().apply(way), (spins[0] * spins[1]).inv().apply(way)]
        pulls = [np.cross(hang[k], ways[k]) for k in range(3)]
        lack = np.linalg.norm(gap) - goal
        step = lack / (sum(compliance[k] * pulls[k] @ pulls[k] for k in range(3)) + 0.02)
        for k in range(3):
            turns[k] = shortened(turns[k] + step * compliance[k] * pulls[k], MOST_TURNS[k])
        goes = goes or (done >= 4 and abs(lack) > 0.003)
        if goes:
            move = shortened(move + step * 0.02 * way, 0.09)
    return turns, move

"""Compiled leans of trunks: the least turns of lower spine, chest and collar that bring a shoulder to a distance."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.quaternions import from_vector, rotate, unrotate
from crowdsim.jit import kernel

PELVIS = 0.02
"""How readily the pelvis goes [m2], where turns do not do."""
MOST_TURNS = (math.radians(14.0), math.radians(14.0), math.radians(16.0))
MOST_SHIFT = 0.09
ROUNDS, ENOUGH = (4, 10), 0.003
"""Rounds after which the pelvis goes too where as much is lacking [m], and all of them."""


class Reaches(NamedTuple):
    """Strikes for which trunks lean; E of them.

    Attributes:
        bases: The lowest of the joints that lean [m]. Shape (E, 3).
        levers: What hangs on each joint up to the next one, from the lowest to the shoulder [m]. Shape (E, 3, 3).
        fists: From the wrist to the fist, as far as the trunk carries it along [m]. Shape (E, 3).
        targets: Where the fist has to be [m]. Shape (E, 3).
        goals: How far the wrist then is from the shoulder [m]. Shape (E,).
        compliance: How readily each joint turns; 0 for those that are missing. Shape (E, 3).
    """

    bases: NDArray[Any]
    levers: NDArray[Any]
    fists: NDArray[Any]
    targets: NDArray[Any]
    goals: NDArray[Any]
    compliance: NDArray[Any]


@kernel(inline=True)
def _size(x, y, z):
    """Return the length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@kernel(inline=True)
def _shorten(vector, most):
    """Make a vector no longer than that, in place."""
    part = min(1.0, most / max(_size(vector[0], vector[1], vector[2]), 1e-12))
    for k in range(3):
        vector[k] *= part


@kernel
def _hang(reaches, e, turns, spins, hangs):
    """Write the rotation of each joint, and what hangs on it, turned by it and by all above it."""
    x, y, z = 0.0, 0.0, 0.0
    for up in range(3):
        k = 2 - up
        spins[k, 0], spins[k, 1], spins[k, 2], spins[k, 3] = from_vector(turns[k, 0], turns[k, 1], turns[k, 2])
        lever = reaches.levers[e, k]
        x, y, z = rotate(spins[k], lever[0] + x, lever[1] + y, lever[2] + z)
        hangs[k, 0], hangs[k, 1], hangs[k, 2] = x, y, z


@kernel
def _way_to_target(reaches, e, spins, hangs, move):
    """Return the direction from the shoulder to where the wrist has to be, and how far that is [m]."""
    fist, target, base = reaches.fists[e], reaches.targets[e], reaches.bases[e]
    x, y, z = rotate(spins[2], fist[0], fist[1], fist[2])
    x, y, z = rotate(spins[1], x, y, z)
    x, y, z = rotate(spins[0], x, y, z)
    x = target[0] - x - (base[0] + hangs[0, 0] + move[0])
    y = target[1] - y - (base[1] + hangs[0, 1] + move[1])
    z = target[2] - z - (base[2] + hangs[0, 2] + move[2])
    far = max(_size(x, y, z), 1e-9)
    return (x / far, y / far, z / far), far


@kernel
def _pull(reaches, e, spins, hangs, way, pulls):
    """Write about which vectors turns of each joint bring the shoulder along a way; return the sum of what they do."""
    gain = 0.0
    x, y, z = way
    for k in range(3):
        hang, pull = hangs[k], pulls[k]
        pull[0], pull[1], pull[2] = hang[1] * z - hang[2] * y, hang[2] * x - hang[0] * z, hang[0] * y - hang[1] * x
        gain += reaches.compliance[e, k] * (pull[0] * pull[0] + pull[1] * pull[1] + pull[2] * pull[2])
        x, y, z = unrotate(spins[k], x, y, z)
    return gain


@kernel(allocates=True)
def lean_trunks(first, stop, reaches, turns, moves):
    """Find how trunks lean for strikes.

    Args:
        first: First strike.
        stop: One past the last.
        reaches: The strikes, a ``Reaches``; those without a finite goal are passed over.
        turns: Out: rotation vectors of lower spine, chest and collar in the world [rad]. Shape (E, 3, 3).
        moves: Out: how far the pelvis goes [m]. Shape (E, 3).
    """
    spins, hangs, pulls = np.empty((3, 4)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(first, stop):
        turn, move, goes = turns[e], moves[e], False
        turn[:], move[:] = 0.0, 0.0
        if not math.isfinite(reaches.goals[e]):
            continue
        for done in range(ROUNDS[1]):
            _hang(reaches, e, turn, spins, hangs)
            way, far = _way_to_target(reaches, e, spins, hangs, move)
            lack = far - reaches.goals[e]
            step = lack / (_pull(reaches, e, spins, hangs, way, pulls) + PELVIS)
            goes = goes or (done >= ROUNDS[0] and abs(lack) > ENOUGH)
            for k in range(3):
                for axis in range(3):
                    turn[k, axis] += step * reaches.compliance[e, k] * pulls[k, axis]
                _shorten(turn[k], MOST_TURNS[k])
            if goes:
                for axis in range(3):
                    move[axis] += step * PELVIS * way[axis]
                _shorten(move, MOST_SHIFT)

"""Compiled kicks: feet that are carried onto what they hit, by the leg and the pelvis."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import AFTER, BEFORE, LOWER, MIDDLE, UPPER
from crowdsim.poses.kernels.feet import KNEE_LEAST
from crowdsim.poses.kernels.fists import LEAN
from crowdsim.poses.kernels.limbs import World, bend_limb, distance_between, excess, pose_chain, reach_of


class CarriedFeet(NamedTuple):
    """Kicks that landed, by attacker's column and time; E kicks of n avatars.

    Attributes:
        starts: Kicks of column i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        times: When [s]. Shape (E,).
        feet: 0 left, 1 right. Shape (E,).
        shifts: How far the foot has to be carried then [m]. Shape (E, 3).
        spans: How long before and after it [s]. Shape (E, 2).
        moves: How far the pelvis goes then [m]. Shape (E, 3).
        struck: Upper arms that feet land on, as of ``Landings``. Shape (E,).
    """

    starts: NDArray[Any]
    times: NDArray[Any]
    feet: NDArray[Any]
    shifts: NDArray[Any]
    spans: NDArray[Any]
    moves: NDArray[Any]
    struck: NDArray[Any]


class Asked(NamedTuple):
    """What legs and pelvis of a pose are asked to do.

    Attributes:
        shifts: How far feet are carried [m]. Shape (2, 3).
        move: How far the pelvis goes [m]. Shape (3,).
        goals: Where ankles belong [m]. Shape (2, 3).
    """

    shifts: NDArray[np.float64]
    move: NDArray[np.float64]
    goals: NDArray[np.float64]


@kernel
def _weigh_kicks(kicks, n, time, within, asked):
    """Write how far feet and pelvis are carried at a time; return whether they are at all."""
    asked.shifts[:] = 0.0
    asked.move[:] = 0.0
    carried = False
    for k in range(kicks.starts[n], kicks.starts[n + 1]):
        apart = time - kicks.times[k]
        if abs(apart) > within:
            continue
        side = BEFORE if apart < 0.0 else AFTER
        shift = minimum_jerk(1.0 - abs(apart) / kicks.spans[k, side])
        move = minimum_jerk(1.0 - abs(apart) / LEAN)
        carried = carried or shift > 0.0 or move > 0.0
        for j in range(3):
            asked.shifts[kicks.feet[k], j] += shift * kicks.shifts[k, j]
            asked.move[j] += move * kicks.moves[k, j]
    return carried


@kernel
def _carry_pose(legs, sizes, root, pose, world, asked):
    """Move the pelvis of one pose, and bend its legs so that ankles are where they were, or are carried to."""
    pose_chain(legs, sizes, root, pose, world)
    positions = world.positions
    for foot in range(2):
        for k in range(3):
            asked.goals[foot, k] = positions[legs.joints[foot, LOWER], k] + asked.shifts[foot, k]
    for k in range(3):
        root[k] += asked.move[k]
        for j in range(legs.parents.shape[0]):
            positions[j, k] += asked.move[k]
    for foot in range(2):
        p, q = positions[legs.joints[foot, UPPER]], positions[legs.joints[foot, MIDDLE]]
        r, goal = positions[legs.joints[foot, LOWER]], asked.goals[foot]
        target = goal[0], goal[1], goal[2]
        if distance_between(r, target) == 0.0:
            continue
        a, b, wanted = distance_between(p, q), distance_between(q, r), distance_between(p, target)
        longest = reach_of(a, b, KNEE_LEAST)
        distance = wanted - excess(distance_between(p, r), wanted, longest, 0.002 * (a + b))
        bend_limb(legs, foot, pose, world, target, distance)


@kernel(allocates=True)
def carry_feet(first, stop, moments, kicks, sizes, legs, within, poses):
    """Carry feet onto what they kick, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        kicks: A ``Kicks``.
        sizes: Sizes of bones by column, see ``Rows``. Shape (n, 3).
        legs: A ``motion.Limbs``.
        within: Time beyond which kicks are left out [s].
        poses: Changed, a ``Posed``.
    """
    joints, times = legs.parents.shape[0], moments.times
    world = World(np.empty((joints, 3)), np.empty((joints, 4)))
    asked = Asked(np.empty((2, 3)), np.empty(3), np.empty((2, 3)))
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = moments.columns[i]
        for t in range(times.shape[0]):
            time = times[t, 0 if shared else i]
            if math.isfinite(poses.roots[t, i, 0]) and _weigh_kicks(kicks, n, time, within, asked):
                _carry_pose(legs, sizes[n], poses.roots[t, i], poses.rotations[t, i], world, asked)

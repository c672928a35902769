"""Compiled bending of limbs that give way to other bodies."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import LOWER, MIDDLE, UPPER
from crowdsim.poses.kernels.feet import KNEE_LEAST
from crowdsim.poses.kernels.fists import point_arm, strikes_around
from crowdsim.poses.kernels.foot_plants import foot_freedom
from crowdsim.poses.kernels.limb_bounds import LIMBS
from crowdsim.poses.kernels.limb_moves import END, JOINT, MOVED
from crowdsim.poses.kernels.limbs import (
    World,
    bend_limb,
    distance_between,
    excess,
    pose_chain,
    pose_side,
    reach_of,
    swivel_limb,
)
from crowdsim.poses.kernels.splines import spline_weights

FIST_LANDS, FOOT_LANDS = 0.06, 0.25
"""How long before and after a strike its fist or foot is on its way undeflected [s], partly."""
_ARM_STRAIGHT, _LEG_STRAIGHT = 0.15, 0.08
"""Distance of elbows and knees from the straight line below which limbs hardly swivel [m]: a fist may pass a body in a
fraction of the time that a foot takes, and the arm would roll around."""


class Deflections(NamedTuple):
    """How far limbs of n avatars are deflected at the times of a grid, and when they strike.

    Attributes:
        moves: How far the middle and the end of each limb go [m], ``Offsets`` of shape (R, n, 4, 2, 3).
        creeps: How far feet go that are planted [m], ``Offsets`` of shape (S, n, 2, 3).
        starts: Strikes of column i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        times: When [s]. Shape (E,).
        limbs: Of left and right hand, left and right foot. Shape (E,).
    """

    moves: Any
    creeps: Any
    starts: Array
    times: Array
    limbs: Array


@kernel(inline=True)
def _smooth(found, row, n, weights, first, stop, sums):
    """Write weighted sums of some numbers of an avatar in a row and in those around it."""
    away, last = weights.shape[0] // 2, found.shape[0] - 1
    for k in range(first, stop):
        sums[k] = found[row, n, k] * weights[away]
    for j in range(away):
        before, after = found[max(row - away + j, 0), n], found[min(row + away - j, last), n]
        for k in range(first, stop):
            sums[k] += (np.float64(before[k]) + np.float64(after[k])) * weights[j]


@kernel(allocates=True)
def smooth_moves(first, stop, found, rows, limbs, feet, columns, moves):
    """Smooth how far limbs go, and feet by other weights, along the frames of a grid; its ends repeat.

    Args:
        first: First of the avatars.
        stop: One past the last.
        found: How far limbs go, numbers of 4 x 2 x 3 [m]. Shape (R, n, 24), float32.
        rows: Those that are asked for, ascending; those around them are there. Shape (S,).
        limbs: Weights of a row and of those before and after it, symmetric. Shape (2 k + 1,).
        feet: Likewise, no more of them.
        columns: Where each avatar is written. Shape (n,).
        moves: Written, where any is not 0 [m]. Shape (S, n or more, 24), float32.
    """
    numbers, ends = found.shape[2], MOVED * 3
    away, sums = limbs.shape[0] // 2, np.empty(numbers)
    for n in range(first, stop):
        ahead = until = 0
        for s in range(rows.shape[0]):
            # Rows before ``ahead`` are known, and where there is nothing around a row nothing is written.
            while ahead < found.shape[0] and ahead <= rows[s] + away:
                if found[ahead, n].any():
                    until = ahead + away + 1
                ahead += 1
            if rows[s] >= until:
                continue
            _smooth(found, rows[s], n, limbs, 0, numbers, sums)
            for limb in range(2, LIMBS):
                _smooth(found, rows[s], n, feet, limb * ends + 3 * END, limb * ends + 3 * END + 3, sums)
            moves[s, columns[n]] = sums


@kernel
def _moves_at(offsets, time, n, moves):
    """Write how far limbs of an avatar are deflected at a time, by a B-spline."""
    clock = time * offsets.rate - offsets.first
    before, last = math.floor(clock), offsets.values.shape[0] - 1
    weights = spline_weights(clock - before)
    moves[:] = 0.0
    for k in range(4):
        row = offsets.values[min(max(before - 1 + k, 0), last), n]
        for limb in range(LIMBS):
            for point in range(MOVED):
                for j in range(3):
                    moves[limb, point, j] += weights[k] * row[limb, point, j]


@kernel
def _creep_at(offsets, time, n, foot, free, move):
    """Mix into the move of a foot, as far as it is not ``free``, how far planted feet go; by a B-spline."""
    clock = time * offsets.rate - offsets.first
    before, last = math.floor(clock), offsets.values.shape[0] - 1
    weights = spline_weights(clock - before)
    for j in range(3):
        creep = 0.0
        for k in range(4):
            creep += weights[k] * offsets.values[min(max(before - 1 + k, 0), last), n, foot, j]
        move[j] = free * move[j] + (1.0 - free) * creep


@kernel
def _is_moved(offsets, time, n, seen, until):
    """Return whether the spline of an avatar is not 0 at a time; times ascend from call to call.

    Args:
        offsets: The ``Offsets``.
        time: The time [s].
        n: Column of the avatar.
        seen: How many rows earlier calls have looked at; 0 at first.
        until: One past the last of these rows that is not 0.

    Returns:
        Whether it is not 0, and ``seen`` and ``until`` for the next call.
    """
    before, last = math.floor(time * offsets.rate - offsets.first), offsets.values.shape[0] - 1
    while seen <= min(max(before + 2, 0), last):
        if offsets.values[seen, n].any():
            until = seen + 1
        seen += 1
    return until > min(max(before - 1, 0), last), seen, until


@kernel
def _freedom(deflections, first, stop, time, limb):
    """Return how free a hand or foot is of some strikes."""
    free, lands = 1.0, FIST_LANDS if limb < 2 else FOOT_LANDS
    for strike in range(first, stop):
        if deflections.limbs[strike] == limb:
            free = min(free, 1.0 - minimum_jerk(1.0 - abs(time - deflections.times[strike]) / lands))
    return free


@kernel
def _bend_arm(arms, hand, sizes, pose, world, moves, free):
    """Move a wrist, and swivel the elbow, as far as they are deflected."""
    elbow, wrist = world.positions[arms.joints[hand, MIDDLE]], world.positions[arms.joints[hand, LOWER]]
    goal = elbow[0] + moves[JOINT, 0], elbow[1] + moves[JOINT, 1], elbow[2] + moves[JOINT, 2]
    target = wrist[0] + free * moves[END, 0], wrist[1] + free * moves[END, 1], wrist[2] + free * moves[END, 2]
    point_arm(arms, hand, pose, world, target)
    pose_side(arms, hand, sizes, pose, world)
    swivel_limb(arms, hand, pose, world, goal, _ARM_STRAIGHT)


@kernel
def _bend_leg(legs, foot, sizes, pose, world, moves):
    """Move an ankle as far as its leg reaches, and swivel the knee, as far as they are deflected."""
    hip, knee = world.positions[legs.joints[foot, UPPER]], world.positions[legs.joints[foot, MIDDLE]]
    ankle = world.positions[legs.joints[foot, LOWER]]
    if moves[END].any():
        target = ankle[0] + moves[END, 0], ankle[1] + moves[END, 1], ankle[2] + moves[END, 2]
        a, b, wanted = distance_between(hip, knee), distance_between(knee, ankle), distance_between(hip, target)
        over = excess(distance_between(hip, ankle), wanted, reach_of(a, b, KNEE_LEAST), 0.002 * (a + b))
        # Where the leg is stretched already it still comes as close as it is asked to.
        bend_limb(legs, foot, pose, world, target, wanted - max(over, 0.0))
        pose_side(legs, foot, sizes, pose, world)
    if moves[JOINT].any():
        goal = knee[0] + moves[JOINT, 0], knee[1] + moves[JOINT, 1], knee[2] + moves[JOINT, 2]
        swivel_limb(legs, foot, pose, world, goal, _LEG_STRAIGHT)


@kernel(allocates=True)
def bend_limbs(first, stop, moments, deflections, plants, sizes, arms, legs, poses):
    """Deflect limbs of poses, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        deflections: A ``Deflections``.
        plants: When feet are planted, a ``FootPlants``.
        sizes: Sizes of bones by column, see ``Rows``. Shape (n, 3).
        arms: A ``motion.Limbs``.
        legs: Likewise.
        poses: Rotations are changed, a ``Posed``.
    """
    joints, times = arms.parents.shape[0], moments.times
    world, moves = World(np.empty((joints, 3)), np.empty((joints, 4))), np.empty((LIMBS, MOVED, 3))
    at = np.zeros(2, np.int64)
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = moments.columns[i]
        at[:] = 0
        seen = until = crept = creeps_until = 0
        low, last = deflections.starts[n], deflections.starts[n + 1]
        for t in range(times.shape[0]):
            time, root, pose = times[t, 0 if shared else i], poses.roots[t, i], poses.rotations[t, i]
            moved, seen, until = _is_moved(deflections.moves, time, n, seen, until)
            creeps, crept, creeps_until = _is_moved(deflections.creeps, time, n, crept, creeps_until)
            if not (moved or creeps) or not math.isfinite(root[0]):
                continue
            low, high = strikes_around(deflections.times, low, last, time, FOOT_LANDS)
            _moves_at(deflections.moves, time, n, moves)
            # A limb that bends leaves the joints above it, and those of the other one, where they are.
            if moves[:2].any():
                pose_chain(arms, sizes[n], root, pose, world)
            for hand in range(2):
                if moves[hand].any():
                    free = _freedom(deflections, low, high, time, hand)
                    _bend_arm(arms, hand, sizes[n], pose, world, moves[hand], free)
            posed = False
            for foot in range(2):
                if not creeps and not moves[2 + foot].any():
                    continue
                move, kicks = moves[2 + foot, END], _freedom(deflections, low, high, time, 2 + foot)
                free, at[foot] = foot_freedom(plants, n, foot, at[foot], time)
                _creep_at(deflections.creeps, time, n, foot, free, move)
                for k in range(3):
                    move[k] *= kicks
                if moves[2 + foot].any():
                    if not posed:
                        pose_chain(legs, sizes[n], root, pose, world)
                        posed = True
                    _bend_leg(legs, foot, sizes[n], pose, world, moves[2 + foot])

"""Compiled strikes: fists that are carried onto what they hit.

A fist is carried by a bump over time; for what an arm that eases into its longest reach does not give, the trunk leans
by a longer one.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import multiply, rotate, rotate_by_vector
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import AFTER, BEFORE, LOWER, MIDDLE, TRUNK, UPPER
from crowdsim.poses.kernels.feet import KNEE_LEAST
from crowdsim.poses.kernels.limbs import (
    World,
    bend_axis,
    bend_limb,
    distance_between,
    excess,
    flexion_at,
    pose_chain,
    reach_of,
    shortest_rotation,
    solve_bend,
)

ELBOW_LEAST = math.radians(4.0)
"""Flexion that an elbow keeps at the least when it is stretched to reach something [rad]."""
FOLDED = math.radians(145.0)
"""Flexion towards which elbows go at the most to bring a fist near [rad]."""
_ROUNDS = 3
"""Steps in which the bend of an arm is found that brings its fist to its place."""
_SLOWS = 0.1
"""How far before the arm that stops it a fist begins to be carried back [m]."""
_AWAY = 2.0
"""How far targets go away from a shoulder, of what they are nearer than an arm's shortest reach."""
_OUT = 2
"""Capsules that a fist is brought out of, one after another: those of trunk and head meet."""
MOTION = 0.08
"""Time before and after a strike between which what it hits is taken to move evenly [s]."""
_STAYS, _LEAVES = 0.06, 0.2
"""How long before and after a strike its fist does not go beyond the surface that it touches, wholly and partly [s]."""
_ROUND = 0.03
"""Depth that is left of a great one, and over which less is left of it [m]."""
LEAN = 0.34
"""How long before and after a strike the trunk leans for it [s]."""
JOINTS = 4
"""Joints that lean: lower spine, chest, left and right collar."""
PELVIS = 4
"""Row of a lean that holds how far the pelvis goes, behind those of the joints."""


class Landings(NamedTuple):
    """Strikes that landed, by attacker's column and time; E strikes of n avatars.

    Attributes:
        starts: Strikes of column i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        times: When [s]. Shape (E,).
        hands: 0 left, 1 right. Shape (E,).
        shifts: How far the fist has to be carried then [m]. Shape (E, 3).
        spans: How long before and after it, at the most ``LEAN`` [s]. Shape (E, 2).
        goals: Where that brings the fist [m]. Shape (E, 3).
        stopped: Whether an arm of the victim stops it. Shape (E,), bool.
        stops: What they do not go into, see ``stops.find_stops``. Shape (E, 3, K, 9) [m].
        rotations: Rotation vectors of the joints that lean then, see ``trunk_assist.Leans``. Shape (E, 4, 3).
        moves: How far the pelvis goes then [m]. Shape (E, 3).
        struck: Upper arms that fists land on: twice the avatar's number, and 1 more for the right one; -1 for other
            parts. Shape (E,).
    """

    starts: NDArray[Any]
    times: NDArray[Any]
    hands: NDArray[Any]
    shifts: NDArray[Any]
    spans: NDArray[Any]
    goals: NDArray[Any]
    stopped: NDArray[Any]
    stops: NDArray[Any]
    rotations: NDArray[Any]
    moves: NDArray[Any]
    struck: NDArray[Any]


class Arms(NamedTuple):
    """What the two arms and the trunk of a pose are asked to do.

    Attributes:
        shifts: How far fists are carried [m]. Shape (2, 3).
        weights: Weight of strikes. Shape (2,).
        targets: Positions of the fists before the trunk leans [m]. Shape (2, 3).
        wrists: Likewise of the wrists. Shape (2, 3).
        ankles: Positions of the ankles [m]. Shape (2, 3).
        lean: Rotation vectors of the joints that lean, and how far the pelvis goes. Shape (5, 3).
    """

    shifts: NDArray[np.float64]
    weights: NDArray[np.float64]
    targets: NDArray[np.float64]
    wrists: NDArray[np.float64]
    ankles: NDArray[np.float64]
    lean: NDArray[np.float64]


@kernel(inline=True)
def _weight(landings, strike, time):
    """Return the weight of a strike at a time."""
    apart = time - landings.times[strike]
    span = landings.spans[strike, BEFORE] if apart < 0.0 else landings.spans[strike, AFTER]
    return minimum_jerk(1.0 - abs(apart) / span)


@kernel(inline=True)
def strikes_around(times, low, last, time, within):
    """Return the first of strikes ``low`` to ``last`` that are around a time [s], and one past the last of these.

    Args:
        times: When each is, ascending from ``low`` on [s]. Shape (E,).
        low: A strike before which all are too early.
        last: One past the last strike.
        time: The time; a later one than those for which ``low`` was found.
        within: How far off they may be; some further ones may be among them.
    """
    within += 1e-6
    while low < last and times[low] < time - within:
        low += 1
    high = low
    while high < last and times[high] <= time + within:
        high += 1
    return low, high


@kernel
def _weigh_strikes(landings, first, stop, time, weights):
    """Write the weight of some strikes of both hands at a time; return whether there are any."""
    weights[:] = 0.0
    for strike in range(first, stop):
        weights[landings.hands[strike]] += _weight(landings, strike, time)
    return weights[0] > 0.0 or weights[1] > 0.0


@kernel
def _share_of_stop(fist, goal, shift):
    """Return the share of its shift by which a fist that an arm stops is carried back: less, the further it is from it.

    The whole shift, which is what it takes at the strike, would push a fist that sets out through its own shoulder.
    """
    size = math.sqrt(shift[0] ** 2 + shift[1] ** 2 + shift[2] ** 2)
    beyond = 0.0
    for k in range(3):
        beyond += (goal[k] - fist[k]) * shift[k]
    share = min(max((beyond / max(size, 1e-9) + _SLOWS) / (size + _SLOWS), 0.0), 1.0)
    return share * share * (2.0 - share)


@kernel
def _sum_shifts(landings, first, stop, time, asked):
    """Write how far both fists are carried at a time by some strikes, from where they are."""
    asked.shifts[:] = 0.0
    for strike in range(first, stop):
        weight, hand = _weight(landings, strike, time), landings.hands[strike]
        if weight > 0.0:
            if landings.stopped[strike]:
                weight *= _share_of_stop(asked.targets[hand], landings.goals[strike], landings.shifts[strike])
            for k in range(3):
                asked.shifts[hand, k] += weight * landings.shifts[strike, k]
    for strike in range(first, stop):
        apart = time - landings.times[strike]
        leaves = min(_LEAVES, landings.spans[strike, BEFORE] if apart < 0.0 else landings.spans[strike, AFTER])
        if abs(apart) < leaves:
            hand, stays = landings.hands[strike], min(_STAYS, 0.5 * leaves)
            weight = minimum_jerk((leaves - abs(apart)) / (leaves - stays))
            for _ in range(_OUT):
                for points, further in ((asked.targets, 0.0), (asked.wrists, 1.0)):
                    _stop_point(
                        points[hand], landings.stops[strike], further, apart / MOTION, weight, asked.shifts[hand]
                    )


@kernel
def _stop_point(fist, stops, further, moved, weight, shift):
    """Add to the shift of a fist what brings it out of the capsule that it is deepest in, by a weight.

    With ``further`` 1 it is its wrist that is brought out. ``moved`` is how far the capsules have gone from where they
    are at the strike to where they are after it, negative to where they are before it.
    """
    then = 2 if moved > 0.0 else 0
    deepest, x, y, z, far = -math.inf, 0.0, 0.0, 0.0, 1.0
    for stop in range(stops.shape[1]):
        here, there = stops[1, stop], stops[then, stop]
        along = square = 0.0
        for k in range(3):
            start = here[k] + abs(moved) * (there[k] - here[k])
            axis = here[3 + k] + abs(moved) * (there[3 + k] - here[3 + k]) - start
            along += (fist[k] + shift[k] - start) * axis
            square += axis * axis
        along = min(max(along / max(square, 1e-12), 0.0), 1.0)
        out = _out_of(fist, shift, here, there, abs(moved), along, 0), _out_of(fist, shift, here, there, abs(moved),
              along, 1), _out_of(fist, shift, here, there, abs(moved), along, 2)  # fmt: skip
        distance = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
        depth = here[6] + along * (here[7] - here[6]) + further * here[8] - distance
        if depth > deepest:
            deepest, far = depth, max(distance, 1e-6)
            x, y, z = out
    if deepest > 0.0:
        go = weight * deepest * deepest / (deepest + _ROUND) / far
        shift[0] += go * x
        shift[1] += go * y
        shift[2] += go * z


@kernel(inline=True)
def _out_of(fist, shift, here, there, moved, along, k):
    """Return one coordinate of the way to a fist from a point of a capsule that has moved."""
    start, end = here[k] + moved * (there[k] - here[k]), here[3 + k] + moved * (there[3 + k] - here[3 + k])
    return fist[k] + shift[k] - start - along * (end - start)


@kernel
def _lean_at(landings, first, stop, time, within, lean):
    """Write how a trunk leans at a time for some strikes; return whether it does at all.

    Bumps that overlap do not add: between strikes one lean passes into the other.
    """
    lean[:] = 0.0
    rest, whole = 1.0, 0.0
    for strike in range(first, stop):
        apart = abs(time - landings.times[strike])
        weight = minimum_jerk(1.0 - apart / LEAN)
        if weight > 0.0 and apart <= within:
            rest *= 1.0 - weight
            square = weight * weight
            whole += square
            for k in range(JOINTS):
                for j in range(3):
                    lean[k, j] += square * landings.rotations[strike, k, j]
            for j in range(3):
                lean[PELVIS, j] += square * landings.moves[strike, j]
    if whole <= 0.0:
        return False
    share = (1.0 - rest) / whole
    for k in range(JOINTS + 1):
        for j in range(3):
            lean[k, j] *= share
    return True


@kernel
def move_over_feet(legs, sizes, root, pose, world, move, ankles):
    """Move the root over feet that stay where they are.

    Args:
        legs: A ``motion.Limbs``.
        sizes: Sizes of bones, see ``Rows``. Shape (3,).
        root: Changed [m]. Shape (3,).
        pose: Rotations of joints, changed. Shape (J, 4).
        world: Scratch space, a ``World``.
        move: How far [m]. Shape (3,).
        ankles: Scratch space. Shape (2, 3).
    """
    pose_chain(legs, sizes, root, pose, world)
    positions = world.positions
    for foot in range(2):
        for k in range(3):
            ankles[foot, k] = positions[legs.joints[foot, LOWER], k]
    for j in range(legs.parents.shape[0]):
        for k in range(3):
            positions[j, k] += move[k]
    for k in range(3):
        root[k] += move[k]
    for foot in range(2):
        p = positions[legs.joints[foot, UPPER]]
        q, r = positions[legs.joints[foot, MIDDLE]], positions[legs.joints[foot, LOWER]]
        longest = reach_of(distance_between(p, q), distance_between(q, r), KNEE_LEAST)
        target = ankles[foot, 0], ankles[foot, 1], ankles[foot, 2]
        wanted = distance_between(p, target)
        distance = wanted - excess(distance_between(p, r), wanted, longest, 0.002 * longest)
        bend_limb(legs, foot, pose, world, target, distance)


@kernel
def _note_fists(arms, scale, world, targets, wrists):
    """Write the positions of both fists, and of the wrists behind them."""
    for hand in range(2):
        end, o = arms.joints[hand, LOWER], arms.points[hand, 0]
        x, y, z = rotate(world.rotations[end], o[0] * scale, o[1] * scale, o[2] * scale)
        targets[hand, 0] = world.positions[end, 0] + x
        targets[hand, 1] = world.positions[end, 1] + y
        targets[hand, 2] = world.positions[end, 2] + z
        for k in range(3):
            wrists[hand, k] = world.positions[end, k]


@kernel(inline=True)
def _away_from_shoulder(p, r, target, shortest, now):
    """Return a target that is as it is where an arm can fold that far, and else further along its way to the wrist.

    Right at the shoulder the smallest way of a target would swing the arm around.
    """
    more = _AWAY * (shortest - distance_between(p, target)) / max(now, 1e-6)
    if more <= 0.0:
        return target
    return target[0] + more * (r[0] - p[0]), target[1] + more * (r[1] - p[1]), target[2] + more * (r[2] - p[2])


@kernel
def point_arm(arms, hand, pose, world, target):
    """Bend an arm so that its wrist goes to a target, and less the nearer that is to its longest and shortest reach.

    Returns:
        The rotation of the forearm.
    """
    p, q = world.positions[arms.joints[hand, UPPER]], world.positions[arms.joints[hand, MIDDLE]]
    r = world.positions[arms.joints[hand, LOWER]]
    a, b, now = distance_between(p, q), distance_between(q, r), distance_between(p, r)
    longest, shortest = reach_of(a, b, ELBOW_LEAST), reach_of(a, b, FOLDED)
    wanted = distance_between(p, target)
    distance = wanted - excess(now, wanted, longest, 0.004 * (a + b))
    distance += excess(-now, -wanted, -shortest, 0.01 * (a + b))
    target = _away_from_shoulder(p, r, target, shortest, now)
    return bend_limb(arms, hand, pose, world, target, distance)


@kernel
def _carry_fist(arms, hand, scale, weight, pose, world, asked):
    """Bend an arm so that its fist goes where it is to be carried; as far as it is free to, it follows the trunk.

    The wrist keeps its rotation: the hand turns with the forearm, and where that takes the fist is found step by step.
    """
    end = arms.joints[hand, LOWER]
    r, o, wrist = world.positions[end], arms.points[hand, 0], pose[end]
    kept = wrist[0], wrist[1], wrist[2], wrist[3]
    fist, shift = asked.targets[hand], asked.shifts[hand]
    x, y, z = rotate(world.rotations[end], o[0] * scale, o[1] * scale, o[2] * scale)
    goal = (
        r[0] + x + weight * (fist[0] - r[0] - x) + shift[0],
        r[1] + y + weight * (fist[1] - r[1] - y) + shift[1],
        r[2] + z + weight * (fist[2] - r[2] - z) + shift[2],
    )
    turned = x, y, z
    for _ in range(_ROUNDS):
        target = goal[0] - turned[0], goal[1] - turned[1], goal[2] - turned[2]
        turned = rotate(point_arm(arms, hand, pose, world, target), x, y, z)
    for k in range(4):
        wrist[k] = kept[k]


@kernel
def swing_forearms(low, high, shoulders, elbows, wrists, hinges, behind, goals, out):
    """Write how forearms of arms ``low`` to ``high`` turn, and hands with them, where fists go to goals.

    Args:
        low: First arm.
        high: One past the last.
        shoulders: Position of each shoulder [m]. Shape (n, 3).
        elbows: Likewise of the elbow. Shape (n, 3).
        wrists: Likewise of the wrist. Shape (n, 3).
        hinges: Axes about which elbows bend, unit. Shape (n, 3).
        behind: Ways from fists to wrists [m]. Shape (n, 3).
        goals: Where fists go [m]. Shape (n, 3).
        out: Rotations in the world, written. Shape (n, 4).
    """
    for n in range(low, high):
        p, q, r = shoulders[n], elbows[n], wrists[n]
        u, v = (q[0] - p[0], q[1] - p[1], q[2] - p[2]), (r[0] - q[0], r[1] - q[1], r[2] - q[2])
        a, b, x, y, z = distance_between(p, q), distance_between(q, r), behind[n, 0], behind[n, 1], behind[n, 2]
        axis, flexion = (
            bend_axis(u, v, a, b, (hinges[n, 0], hinges[n, 1], hinges[n, 2])),
            flexion_at(a, b, distance_between(p, r)),
        )
        turn = 1.0, 0.0, 0.0, 0.0
        for _ in range(_ROUNDS):
            turned = rotate(turn, x, y, z)
            way = goals[n, 0] + turned[0] - p[0], goals[n, 1] + turned[1] - p[1], goals[n, 2] + turned[2] - p[2]
            wanted = flexion_at(a, b, math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]))
            wanted = min(max(wanted, min(ELBOW_LEAST, flexion)), max(FOLDED, flexion))
            bend, reached = solve_bend(u, v, a, b, axis, flexion, wanted - flexion)
            turn = multiply(shortest_rotation(reached, way)[0], bend)
        for k in range(4):
            out[n, k] = turn[k]


@kernel
def _lean_pose(legs, leaning, sizes, root, pose, world, asked):
    """Lean the trunk of one pose."""
    lean = asked.lean
    if lean[PELVIS, 0] != 0.0 or lean[PELVIS, 1] != 0.0 or lean[PELVIS, 2] != 0.0:
        move_over_feet(legs, sizes, root, pose, world, lean[PELVIS], asked.ankles)
    for k in range(JOINTS):
        if leaning[k] >= 0:
            rotate_by_vector(pose[leaning[k]], lean[k, 0], lean[k, 1], lean[k, 2])


@kernel
def _carry_both(arms, sizes, root, pose, world, asked):
    """Carry the fists of one pose."""
    pose_chain(arms, sizes, root, pose, world)
    for hand in range(2):
        weight = min(asked.weights[hand], 1.0)
        if weight > 0.0:
            _carry_fist(arms, hand, sizes[TRUNK], weight, pose, world, asked)


@kernel(allocates=True)
def carry_fists(first, stop, moments, landings, sizes, arms, legs, leaning, within, poses):
    """Carry fists onto what they hit, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        landings: A ``Landings``.
        sizes: Sizes of bones by column, see ``Rows``. Shape (n, 3).
        arms: A ``motion.Limbs``.
        legs: Likewise.
        leaning: Joints that lean, see ``trunk_assist.leaning_joints``. Shape (4,).
        within: Time beyond which the trunk does not lean for a strike [s].
        poses: Changed, a ``Posed``.
    """
    joints, times = arms.parents.shape[0], moments.times
    world = World(np.empty((joints, 3)), np.empty((joints, 4)))
    pair = (2, 3)
    asked = Arms(np.empty(pair), np.empty(2), np.empty(pair), np.empty(pair), np.empty(pair), np.empty((JOINTS + 1, 3)))
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = moments.columns[i]
        low, last = landings.starts[n], landings.starts[n + 1]
        for t in range(times.shape[0]):
            time = times[t, 0 if shared else i]
            low, high = strikes_around(landings.times, low, last, time, LEAN)
            if low == high or not math.isfinite(poses.roots[t, i, 0]):
                continue
            root, pose = poses.roots[t, i], poses.rotations[t, i]
            leans = _lean_at(landings, low, high, time, within, asked.lean)
            strikes = _weigh_strikes(landings, low, high, time, asked.weights)
            if strikes:
                pose_chain(arms, sizes[n], root, pose, world)
                _note_fists(arms, sizes[n, TRUNK], world, asked.targets, asked.wrists)
                _sum_shifts(landings, low, high, time, asked)
            if leans:
                _lean_pose(legs, leaning, sizes[n], root, pose, world, asked)
            if strikes:
                _carry_both(arms, sizes[n], root, pose, world, asked)

"""Compiled foot plants: legs that keep planted feet in their place, and soles above the floor.

The pelvis goes down a little, and evenly, for a leg that would be overstretched. It goes aside, over the feet, where
the trunk gives way to others.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.quaternions import mix, mix_like, rotate, rotate_about_y
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import HEADING, LEG, LOWER, MIDDLE, UPPER, X, Z
from crowdsim.poses.kernels.foot_shifts import Instant, add_shift, weigh_plants
from crowdsim.poses.kernels.limbs import (
    World,
    bend_limb,
    distance_between,
    excess,
    pose_chain,
    reach_of,
    soft_ramp,
)
from crowdsim.poses.kernels.splines import spline_at, spline_of

WIDE = 0.97
"""How far from a transition feet move for it [s]."""
FREE, MOST = 0.4, 0.6
"""How far feet are moved from where blends have them before they are moved less, and at the most [m]."""
DOWN, UP = 0.1, 0.01
"""Furthest that the pelvis goes down, and up where a leg is longer than it has to be [m]."""
KNEE_LEAST = math.radians(4.0)
"""Flexion that a knee keeps at the least when it is stretched to hold a foot [rad]."""
SLACK = 0.03
"""Share of a leg's length over which it begins to be short."""
FLOOR, UNDER = 0.00003, 0.0003
"""Height over which soles ease onto the floor, and how far they may be under it, as planted feet in capture are [m]."""


class Legs(NamedTuple):
    """What the two legs of a pose are asked to do.

    Attributes:
        goals: Where ankles belong [m]. Shape (2, 3).
        weights: Weight of foot plants. Shape (2,).
        lengths: Distance from hip to ankle in the blended pose [m]. Shape (2,).
        longest: Longest such distance [m]. Shape (2,).
        plants: First foot plant that is not over. Shape (2,).
        shift: Shift of a foot [m]. Shape (3,).
        rotations: Rotation of a foot and of its toes, by the plant before and by the one after. Shape (2, 2, 4).
        turns: Room of ``add_shift``. Shape (2, 2, 4).
        changes: Likewise. Shape (2, 9).
    """

    goals: NDArray[np.float64]
    weights: NDArray[np.float64]
    lengths: NDArray[np.float64]
    longest: NDArray[np.float64]
    plants: NDArray[np.int64]
    shift: NDArray[np.float64]
    rotations: NDArray[np.float64]
    turns: NDArray[np.float64]
    changes: NDArray[np.float64]


@kernel(inline=True)
def _find_own_rotations(motion, now, foot, heading, toe, asked):
    """Write the captured rotations of a foot in the world and of its toes, twice."""
    here, there = motion.feet[now.frame, foot], motion.feet[now.following, foot]
    c, d = math.cos(0.5 * heading), math.sin(0.5 * heading)
    q = asked.rotations[0, 0]
    q[0], q[1], q[2], q[3] = rotate_about_y(c, d, mix(here, there, now.part))
    if toe >= 0:
        q = asked.rotations[0, 1]
        here, there = motion.rotations[now.frame, toe], motion.rotations[now.following, toe]
        q[0], q[1], q[2], q[3] = mix(here, there, now.part)
    for part in range(2):
        for k in range(4):
            asked.rotations[1, part, k] = asked.rotations[0, part, k]


@kernel
def _limit_shift(shift, scale):
    """Shorten a shift in place: where transitions pile up feet come along before legs get out of shape."""
    way = math.sqrt(shift[0] * shift[0] + shift[1] * shift[1] + shift[2] * shift[2]) / scale
    if way > FREE:
        kept = (FREE + (MOST - FREE) * math.tanh((way - FREE) / (MOST - FREE))) / way
        for k in range(3):
            shift[k] *= kept


@kernel(inline=True)
def _hold_foot(footing, now, foot, weights, ground, legs, pose, world, asked):
    """Write where a planted foot belongs, and rotate it and its toes in the pose.

    ``weights`` are the plants before and after the time, each followed by its weight, and the share of the one after in
    the rotation.
    """
    motion, shift, scale, firm = footing.motion, asked.shift, now.scale, asked.weights[foot]
    one, before, other, after, turn = weights
    end, toe, o = legs.joints[foot, LOWER], legs.toes[foot], legs.holds[foot]
    ankle, turned = world.positions[end], world.rotations[end]
    x, y, z = rotate(turned, o[0] * scale, o[1] * scale, o[2] * scale)
    hold_x, hold_y, hold_z = ankle[0] + x, ankle[1] + y, ankle[2] + z
    _find_own_rotations(motion, now, foot, ground[HEADING], toe, asked)
    shift[:] = 0.0
    for k in range(2):
        plant, weight = (one, before) if k == 0 else (other, after)
        if weight > 0.0 or 0.0 < turn < 1.0:
            add_shift(footing, now, foot, plant, weight, shift, asked.rotations[k], asked.turns, asked.changes)
    here, there, rest = motion.holds[now.frame, foot], motion.holds[now.following, foot], 1.0 - now.part
    x = (here[0] * rest + there[0] * now.part) * scale
    y = (here[1] * rest + there[1] * now.part) * scale
    z = (here[2] * rest + there[2] * now.part) * scale
    cos, sin = math.cos(ground[HEADING]), math.sin(ground[HEADING])
    shift[0] += firm * (ground[X] + x * cos + z * sin - hold_x)
    shift[1] += firm * (y - hold_y)
    shift[2] += firm * (ground[Z] - x * sin + z * cos - hold_z)
    _limit_shift(shift, scale)
    hold_x, hold_y, hold_z = hold_x + shift[0], hold_y + shift[1], hold_z + shift[2]
    for k in range(2 if toe >= 0 else 1):
        q = asked.rotations[0, k]
        q[0], q[1], q[2], q[3] = mix_like(q, asked.rotations[1, k], turn)
    turned[0], turned[1], turned[2], turned[3] = mix(turned, asked.rotations[0, 0], firm)
    if toe >= 0:
        q = pose[toe]
        q[0], q[1], q[2], q[3] = mix(q, asked.rotations[0, 1], firm)
    x, y, z = rotate(turned, o[0] * scale, o[1] * scale, o[2] * scale)
    goal = asked.goals[foot]
    goal[0], goal[1], goal[2] = hold_x - x, hold_y - y, hold_z - z


@kernel
def _lift_sole(legs, foot, scale, world, goal):
    """Lift the goal of an ankle so that no sole is under the floor: heel and ball ease onto it."""
    turned, lowest = world.rotations[legs.joints[foot, LOWER]], math.inf
    for point in range(2):
        o = legs.points[foot, point]
        lowest = min(lowest, rotate(turned, o[0] * scale, o[1] * scale, o[2] * scale)[1])
    lowest += goal[1] + UNDER * scale
    if lowest < 20.0 * FLOOR * scale:
        goal[1] += FLOOR * scale * soft_ramp(-lowest / (FLOOR * scale))


@kernel
def _measure_lack(legs, foot, world, asked):
    """Write how long a leg is and can be; return how far the pelvis would have to go down for its goal [m]."""
    upper = world.positions[legs.joints[foot, UPPER]]
    middle = world.positions[legs.joints[foot, MIDDLE]]
    ankle, goal = world.positions[legs.joints[foot, LOWER]], asked.goals[foot]
    a, b = distance_between(upper, middle), distance_between(middle, ankle)
    asked.lengths[foot] = distance_between(upper, ankle)
    asked.longest[foot] = reach_of(a, b, KNEE_LEAST)
    wanted = distance_between(upper, goal)
    over = excess(asked.lengths[foot], wanted, asked.longest[foot], SLACK * (a + b))
    return over * wanted / max(upper[1] - goal[1], 0.5 * wanted)


@kernel
def _reach_goals(legs, pose, world, asked):
    """Bend both legs so that ankles reach their goals."""
    for foot in range(2):
        upper, ankle = world.positions[legs.joints[foot, UPPER]], world.positions[legs.joints[foot, LOWER]]
        goal = asked.goals[foot]
        target = goal[0], goal[1], goal[2]
        gap = abs(target[0] - ankle[0]) + abs(target[1] - ankle[1]) + abs(target[2] - ankle[2])
        if asked.weights[foot] == 0.0 and gap < 1e-7:
            continue
        wanted = distance_between(upper, target)
        longest = asked.longest[foot]
        distance = wanted - excess(asked.lengths[foot], wanted, longest, 0.001 * longest)
        bend_limb(legs, foot, pose, world, target, distance)


@kernel
def _move_pelvis(legs, x, y, z, root, world):
    """Move the pelvis, and the legs with it."""
    root[0] += x
    root[1] += y
    root[2] += z
    for foot in range(2):
        for k in range(3):
            position = world.positions[legs.joints[foot, k]]
            position[0] += x
            position[1] += y
            position[2] += z


@kernel(inline=True)
def _plant_pose(footing, now, until, ground, push, low, legs, root, pose, world, asked, reaches):
    """Bring the planted feet of one pose to where they belong, if it ``reaches`` for that.

    Foot plants are known ``until`` a time [s]; after it they go on as they are then. The pelvis goes aside by ``push``
    and down by ``low``, and as far as is left of a leg that is too short. Returns how far that is.
    """
    pose_chain(legs, now.sizes, root, pose, world)
    lack, moves = 0.0, now.last > now.first or now.sizes[LEG] != now.scale
    for foot in range(2):
        one, before, other, after, turn, asked.plants[foot] = weigh_plants(
            footing.plants, now.column, foot, asked.plants[foot], min(now.time, until)
        )
        # Away from transitions feet are where they are captured, if legs are as long as that.
        held = before + after
        asked.weights[foot] = held if moves else 0.0
        for k in range(3):
            asked.goals[foot, k] = world.positions[legs.joints[foot, LOWER], k]
        if asked.weights[foot] > 0.0:
            _hold_foot(footing, now, foot, (one, before, other, after, turn), ground, legs, pose, world, asked)
        # Away from foot plants a foot goes along with the pelvis.
        asked.goals[foot, 0] += (1.0 - held) * push[0]
        asked.goals[foot, 1] -= (1.0 - held) * low
        asked.goals[foot, 2] += (1.0 - held) * push[1]
        _lift_sole(legs, foot, now.scale, world, asked.goals[foot])
    _move_pelvis(legs, push[0], -low, push[1], root, world)
    for foot in range(2):
        lack += _measure_lack(legs, foot, world, asked)
    room = max(DOWN * now.scale - low, 0.001) if lack > 0.0 else UP * now.scale
    drop = room * math.tanh(lack / room)
    if reaches:
        _move_pelvis(legs, 0.0, -drop, 0.0, root, world)
        _reach_goals(legs, pose, world, asked)
    return drop


@kernel(allocates=True)
def plant_feet(first, stop, moments, playback, rows, pushes, lows, footing, legs, reaches, drops, poses):
    """Bring planted feet to where they belong, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        playback: Where they are then, a ``Playback``.
        rows: The control frames, a ``Rows``.
        pushes: How far pelvises go aside, x and z [m], an ``Offsets``.
        lows: How far they go down [m], likewise.
        footing: A ``Footing``.
        legs: A ``motion.Limbs``.
        reaches: Whether legs reach for that; if not, poses are of no further use, only ``drops`` are.
        drops: Written: how far pelvises go down beyond that [m]. Shape (T, n).
        poses: Changed, a ``Posed``.
    """
    joints, times, transitions = legs.parents.shape[0], moments.times, footing.transitions
    world = World(np.empty((joints, 3)), np.empty((joints, 4)))
    asked = Legs(
        np.empty((2, 3)), np.empty(2), np.empty(2), np.empty(2), np.empty(2, np.int64), np.empty(3),
        np.empty((2, 2, 4)), np.empty((2, 2, 4)), np.empty((2, 9)),
    )  # fmt: skip
    shared, until = times.shape[1] == 1, (rows.first + rows.phase.shape[0] - 1) / rows.rate
    for i in range(first, stop):
        n = moments.columns[i]
        pace = rows.speeds[n] * footing.motion.rate
        begin, stop_at = transitions.starts[n], transitions.starts[n + 1]
        asked.plants[:] = 0
        for t in range(playback.frames.shape[0]):
            frame = playback.frames[t, i]
            if frame < 0:
                continue
            time = times[t, 0 if shared else i]
            while begin < stop_at and transitions.times[begin] <= time - WIDE:
                begin += 1
            high = middle = begin
            while high < stop_at and transitions.times[high] < time + WIDE:
                high += 1
            while middle < high and (transitions.times[middle] - time) * rows.rate <= 1e-9:
                middle += 1
            part = playback.fractions[t, i]
            following = frame + 1 if part > 0.0 else frame
            now = Instant(n, time, frame, following, part, rows.scales[n], rows.sizes[n], pace, begin, middle, high)
            push, low = spline_at(pushes, time, n), spline_of(lows, time, n)
            root, pose = poses.roots[t, i], poses.rotations[t, i]
            drops[t, i] = _plant_pose(
                footing, now, until, playback.ground[t, i], push, low, legs, root, pose, world, asked, reaches
            )

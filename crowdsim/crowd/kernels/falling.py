"""Where avatars fall and stagger: the way the blow sends them, where there is room, as their motion leads into it."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.mathematics import atan2
from crowdsim.crowd.kernels.arena import outside
from crowdsim.crowd.kernels.fall_clearance import roomiest
from crowdsim.crowd.kernels.kd_queries import box_distance
from crowdsim.crowd.kernels.layout import FALLS, STANDS_UP
from crowdsim.crowd.kernels.lying import axis_of, from_axis, is_on_floor
from crowdsim.crowd.kernels.positions import course_of, position_of
from crowdsim.jit import kernel

LIKE = 1.0  # directions of falls are alike that differ by no more from the nearest one to the blow's [rad]
FURTHEST_ASIDE = 2.0  # how much further aside a body falls at the most where there is no room [rad]
ASIDE = 0.1  # how much a radian aside counts, beside the square of the room that lacks [m2]
ASTRAY, FAR_ASTRAY = 3.0, 3  # how much an action from the avatar's stance counts likewise, and how many do
UNLIKE = 0.02  # how much the gap between poses and motion counts
SHOWN, LATELY = 0.06, 450.0  # how much it counts that another has fallen so, and after how many frames half as much
BESIDE, NEARBY = 0.3, 5.0  # how much more it counts of one that is so near [m]
GRAIN = 1048576.0  # parts of one
LASTS = 2.0  # how much motion in a control frame counts beside poses
STAGGERS_BY, APART = 0.7, 0.6  # how far from the axis of a body others stagger, and from where others go [m]
OFF = 1.0  # how much a metre counts that a stagger leads further than the blow pushes, or less far


@kernel(inline=True)
def part_of(model, fall, kind):
    """Return the action of a kind that belongs to a fall."""
    for row in range(model.falls.shape[0]):
        if model.falls[row].kind == kind and model.falls[row].fall == fall:
            return model.falls[row].action
    return -1


@kernel(inline=True)
def pick_fall(model, avatars, world, frame, own, kind, push, left, shown, observed, q):
    """Return the row of ``Model.falls`` that costs least: a fall or stagger where the last blow leads; -1 for none.

    It leads where the blow does, or further aside where there is more room; no stagger leads onto others or out of the
    arena, and it goes as far as the blow pushes the avatar, ``push`` [m]. It leads to the avatar's stance, and begins
    like the playback frame in which the avatar leaves its action, ``left``. ``shown`` (rows,), or (0,), is what each
    costs because it has been shown near by or lately.
    """
    falls = model.falls
    policy, stance = avatars.policy[own], 0
    if avatars.conditions.shape[0] > 0:
        stance = int(avatars.conditions[avatars.number[own]].stance)
    fight = avatars.fight[own]
    blow = atan2(np.float64(fight.hit_x), np.float64(fight.hit_z)) - avatars.heading[own]
    nearest = math.inf
    for row in range(falls.shape[0]):
        if falls[row].policy == policy and falls[row].kind == kind:
            nearest = min(nearest, _apart(falls[row].direction, blow))
    found, least = -1, math.inf
    for row in range(falls.shape[0]):
        if falls[row].policy != policy or falls[row].kind != kind:
            continue
        cost = _unfit(model, avatars, world, frame, own, row, blow, nearest, push, observed, q)
        if cost >= least:
            continue
        cost += ASTRAY * min(_astray(model, row, stance), FAR_ASTRAY)
        cost += UNLIKE * _unlike(model, avatars, own, row, left)
        if shown.shape[0] > 0:
            cost += shown[falls[row].twin]
        if cost < least:
            found, least = row, cost
    return found


@kernel
def shown_anywhere(model, avatars, frame, out_costs):
    """Write what it costs to fall as others have fallen, or the avatar itself: more of those of late.

    That is for the first row of each captured fall; ``out_costs`` is of shape (rows of ``Model.falls``,).
    """
    out_costs[:] = 0.0
    for number in range(avatars.conditions.shape[0]):
        note_fall(model, avatars, frame, number, SHOWN, 1.0, out_costs)


@kernel(inline=True)
def note_fall(model, avatars, frame, number, counts, times, out_costs):
    """Add ``times`` what the last fall of an avatar counts: ``counts`` at once, and half as much after ``LATELY``.

    That is a whole number of parts, so that sums do not depend on the order of avatars.
    """
    other = avatars.conditions[number]
    if other.fell > 0.0:
        shows = model.falls[int(other.fell) - 1].twin
        of_late = LATELY / (LATELY + frame - other.fell_frame)
        out_costs[shows] += times * math.floor(counts * of_late * GRAIN + 0.5) / GRAIN


@kernel
def shown_before(model, avatars, frame, own, tree, anywhere, stack, out_costs):
    """Write what ``shown_anywhere`` writes, which is ``anywhere``, and more for falls of those near an avatar.

    ``tree`` is fitted to where avatars are.
    """
    for row in range(out_costs.shape[0]):
        out_costs[row] = anywhere[row]
    x, z = position_of(avatars, own)
    count, leaves = tree.xs.shape[0], 1 << tree.depth
    stack[0] = held = 1
    while held > 0:
        held -= 1
        node = stack[held]
        if box_distance(tree.boxes, node, x, z) >= NEARBY * NEARBY:
            continue
        if node < leaves:
            stack[held], stack[held + 1] = 2 * node + 1, 2 * node
            held += 2
            continue
        leaf = node - leaves
        for i in range((leaf * count) >> tree.depth, ((leaf + 1) * count) >> tree.depth):
            dx, dz = tree.xs[i] - x, tree.zs[i] - z
            if dx * dx + dz * dz < NEARBY * NEARBY:
                note_fall(model, avatars, frame, tree.number[i], BESIDE, 1.0, out_costs)


@kernel(inline=True)
def last_frame(model, avatars, own):
    """Return the playback frame in which an avatar's action ends."""
    action = model.actions[avatars.motion[own].action]
    return action.origin + action.length * model.policies[avatars.policy[own]].stride


@kernel
def _unlike(model, avatars, own, row, left):
    """Return how far the pose in which an avatar leaves its action, and its motion, are from the start of a fall.

    That is the sum of squares over head, trunk, elbows and fists, and over how far these move in a control frame [m2].
    """
    bodies, arms, ground = model.bodies, model.arms, model.ground
    stride = model.policies[avatars.policy[own]].stride
    before, entered = max(left - stride, 0), model.actions[model.falls[row].action].origin
    own_x, own_z = _way(ground, before, left)
    its_x, its_z = _way(ground, entered, entered + stride)
    gap = 0.0
    for k in range(bodies.shape[1] + arms.shape[1]):
        points, point = (bodies, k) if k < bodies.shape[1] else (arms, k - bodies.shape[1])
        for axis in range(3):
            here, there = points[left, point, axis], points[entered, point, axis]
            moved = (here - points[before, point, axis]) - (points[entered + stride, point, axis] - there)
            moved += (own_x - its_x) * (axis == 0) + (own_z - its_z) * (axis == 2)
            gap += (here - there) ** 2 + (LASTS * moved) ** 2
    return gap


@kernel(inline=True)
def _way(ground, before, after):
    """Return how far a ground transform goes between frames, seen from the first: x, z [m]."""
    cos, sin = cos_sin(ground[before].heading)
    dx, dz = ground[after].x - ground[before].x, ground[after].z - ground[before].z
    return dx * cos - dz * sin, dx * sin + dz * cos


@kernel
def _unfit(model, avatars, world, frame, own, row, blow, nearest, push, observed, q):
    """Return how unfit a fall or stagger is: how far it leads aside from a blow, and how little room there is.

    And of a stagger how much further it goes than the blow pushes, or less far.
    """
    aside = _apart(model.falls[row].direction, blow) - nearest
    if aside > FURTHEST_ASIDE:
        return math.inf
    unfit = ASIDE * max(aside - LIKE, 0.0)
    if model.falls[row].kind != FALLS:
        if aside > LIKE or _has_no_room(model, avatars, world, own, row, observed, q):
            return math.inf
        move, size = model.moves[model.falls[row].action], np.float64(avatars.playback[own].scale)
        return unfit + OFF * abs(size * math.sqrt(move.x * move.x + move.z * move.z) - push)
    return unfit + roomiest(model, avatars, world, frame, own, row, observed, q)[0]


@kernel(inline=True)
def _has_no_room(model, avatars, world, own, row, observed, q):
    """Return whether a stagger leads out of the arena, into others, or close to the axis of a body on the floor.

    Where an avatar is nearer to that already, the stagger leads away.
    """
    x, z = position_of(avatars, own)
    size, move = np.float64(avatars.playback[own].scale), model.moves[model.falls[row].action]
    cos, sin = cos_sin(avatars.heading[own])
    dx, dz = size * (move.x * cos + move.z * sin), size * (move.z * cos - move.x * sin)
    if outside(world.arena, x + dx, z + dz) > outside(world.arena, x, z):
        return True
    found = False
    for m in range(observed.counts[q]):
        j = np.int64(observed.neighbours[q, m])
        if avatars.team[j] < 0 and is_on_floor(avatars, j):
            axis = axis_of(model, avatars, j)
            near = min(from_axis(axis, x + 0.5 * dx, z + 0.5 * dz), from_axis(axis, x + dx, z + dz))
            found |= near < min(STAGGERS_BY, from_axis(axis, x, z))
        else:
            way = course_of(avatars, j)
            near = min(from_axis(way, x + 0.5 * dx, z + 0.5 * dz), from_axis(way, x + dx, z + dz))
            found |= near < min(APART, from_axis(way, x, z))
    return found


@kernel(inline=True)
def _astray(model, row, stance):
    """Return how many actions from a stance a stagger ends, or an avatar gets up after a fall; 0 for any stance."""
    if stance == 0:
        return 0
    action = np.int64(model.falls[row].action)
    if model.falls[row].kind == FALLS:
        action = np.int64(part_of(model, row, STANDS_UP))
    return np.int64(model.stances[model.actions[action].next, stance - 1])


@kernel(inline=True)
def _apart(one, other):
    """Return the angle between two directions [rad]."""
    turn = one - other
    return abs(turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5))

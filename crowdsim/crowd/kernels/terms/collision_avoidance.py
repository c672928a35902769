"""Collision avoidance: what actions cost that end, or pass, inside a neighbour or outside the arena.

And what actions are worth more that step back after a strong hit.
"""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.arena import may_leave, outside
from crowdsim.crowd.kernels.intents import NEARBY
from crowdsim.crowd.kernels.layout import (
    ACTION,
    BACK,
    DISC,
    END_COST,
    END_X,
    END_Z,
    GAP,
    HALT_X,
    HALT_Z,
    HEADING,
    HIT_FRAME,
    HIT_X,
    HIT_Z,
    LENGTH,
    MOVE_X,
    MOVE_Z,
    NEXT,
    NEXT_OPPONENT,
    NUMBER,
    OPPONENT,
    OUTSIDE_COST,
    PATH_COST,
    PHASE,
    POLICY,
    SCALE,
    SPACE,
    SPEED,
    TEAM,
    WIDTH,
    Axis,
    X,
    Z,
)
from crowdsim.crowd.kernels.lying import axis_of, from_axis, is_on_floor
from crowdsim.crowd.kernels.sole_contact import treads_on
from crowdsim.crowd.kernels.tables import whole_lanes
from crowdsim.jit import kernel

HALTED = 0.75  # where bodies meet while they halt, over where they do at the end of actions
LYING, PASSING = 0.75, 0.5  # how far from the axis of a body on the floor others should end, and pass it [m]
ON_BODY = 2.0  # what it costs to end there, over the cost of ending in a body that stands
IN_PASSING, ON_APPROACH = 0.5, 0.15  # instead of that, for those whose opponent is far away, or not near
STEPS_OVER = 0.05  # what it costs to be halfway there
TREADS = 0.125  # what it costs to end with a sole at its surface
FAR = 2.5  # distance of an opponent from which on it is far away [m]
ON_FLOOR = -1.0  # instead of the frames that are left of an action, of bodies on the floor
BYSTANDERS = 0.66  # how much of the gap and of the cost counts for those whom an avatar does not fight
STAGGER, STEP = 8, 0.3  # for how long a strong hit counts [control frames], and how long a step back should be [m]


@kernel(inline=True)
def avoid_collisions(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions that end, or pass, inside a neighbour or outside the arena; or do not step back."""
    whole, real, work = avatars.whole, avatars.real, scratch.work
    worst = work[3]
    state = model.actions[whole[ACTION, own], NEXT]
    furthest = model.reaches[state] * real[SCALE, own] + 1e-6  # moves are single numbers
    close = 0
    if world.crowding[END_COST] > 0.0 or world.crowding[PATH_COST] > 0.0:
        close = _list_close(model, avatars, world.crowding, own, observed, q, furthest, scratch.near)
    leaves = may_leave(world.arena, real[X, own], real[Z, own], furthest)
    staggers = now.frame - real[HIT_FRAME, own] <= STAGGER and real[HIT_X, own] ** 2 + real[HIT_Z, own] ** 2 >= 1.0
    if close == 0 and not leaves and not staggers:
        return
    lanes = _find_ends(model, avatars, own, work)
    for m in range(np.uint64(close)):
        if scratch.near[m, 5] == ON_FLOOR:
            _add_lying(model, avatars, own, scratch.near, m, work)
        else:
            _add_neighbour(world.crowding, scratch.near, m, lanes, work)
    if leaves:
        x, z, cost = real[X, own], real[Z, own], world.crowding[OUTSIDE_COST]
        for k in range(lanes):
            worst[k] += cost * outside(world.arena, x + work[0, k], z + work[1, k])
    if staggers:
        _step_back(real, world.crowding[BACK], own, lanes, work)
    for k in range(lanes):
        scratch.values[q, k] -= worst[k]


@kernel(inline=True)
def _list_close(model, avatars, crowding, own, observed, q, furthest, near):
    """List in ``near`` the neighbours that an avatar may collide with; return how many there are.

    A row is the position seen from the avatar, the displacement to the end of the action, the distance at which bodies
    meet, the frames that are left of the action, what it costs to end in the middle, and to pass there, and where it
    can halt, seen from the avatar. Of a body on the floor it is the head, the displacement to the feet, the distance
    from the axis, ``ON_FLOOR``, what it costs to end there, to be there halfway, and to tread on it, and its slot.
    """
    whole, real = avatars.whole, avatars.real
    x, z, width = real[X, own], real[Z, own], real[WIDTH, own]
    own_space = model.sizes[whole[POLICY, own], SPACE]
    close = 0
    for m in range(observed.counts[q]):
        j = observed.neighbours[q, m]
        ax, az = real[X, j] - x, real[Z, j] - z
        wx, wz = real[END_X, j] - real[X, j], real[END_Z, j] - real[Z, j]
        space = 0.5 * (own_space + model.sizes[whole[POLICY, j], SPACE])
        if whole[NUMBER, j] != whole[NEXT_OPPONENT, own] and whole[OPPONENT, j] != whole[NUMBER, own]:
            space *= BYSTANDERS
        room = crowding[DISC] * (width + real[WIDTH, j]) + crowding[GAP] * space
        end_cost, path_cost = crowding[END_COST] * space, crowding[PATH_COST]
        if whole[TEAM, j] < 0 and is_on_floor(avatars, j):
            close += _list_lying(model, avatars, crowding, own, j, furthest, near[close])
            continue
        hx, hz = real[HALT_X, j] - x, real[HALT_Z, j] - z
        # Point of its path at which the neighbour is nearest to the position of the avatar now.
        towards, moved = -(ax * wx + az * wz), wx * wx + wz * wz
        t = min(towards / moved, 1.0) if towards > 0.0 else 0.0
        nx, nz = ax + t * wx, az + t * wz
        near[close, 0], near[close, 1], near[close, 2], near[close, 3], near[close, 4] = ax, az, wx, wz, room
        near[close, 6], near[close, 7] = end_cost, path_cost
        near[close, 8], near[close, 9] = hx, hz
        near[close, 5] = (model.actions[whole[ACTION, j], LENGTH] - real[PHASE, j]) / real[SPEED, j]
        reach = room + furthest + math.sqrt((hx - ax - wx) ** 2 + (hz - az - wz) ** 2)
        close += nx * nx + nz * nz < reach * reach
    return close


@kernel(inline=True)
def _list_lying(model, avatars, crowding, own, j, furthest, row):
    """Write a body on the floor to a row of ``near``, its head and its axis; return whether an avatar may get there."""
    x, z = avatars.real[X, own], avatars.real[Z, own]
    axis = axis_of(model, avatars, j)
    row[0], row[1], row[2], row[3] = axis.x - x, axis.z - z, axis.to_x - axis.x, axis.to_z - axis.z
    opponent = avatars.whole[NEXT_OPPONENT, own]
    share, room, cost = ON_BODY, LYING, crowding[END_COST]
    if opponent >= 0:
        i = avatars.slot_of[opponent]
        dx, dz = avatars.real[X, i] - x, avatars.real[Z, i] - z
        square = dx * dx + dz * dz
        if square > NEARBY * NEARBY:
            share, room = IN_PASSING if square > FAR * FAR else ON_APPROACH, PASSING
    row[4], row[5] = room * avatars.real[SCALE, j], ON_FLOOR
    row[6], row[7], row[8], row[9] = share * cost, STEPS_OVER * cost, TREADS * cost, j
    return from_axis(axis, x, z) < row[4] + furthest


@kernel(inline=True)
def _find_ends(model, avatars, own, work):
    """Write where each of an avatar's next actions ends, seen from it: x, z and frames; and 0, the cost so far.

    And where the body can halt after each. Returns how many lanes they fill.
    """
    whole, real, actions, moves, halts = avatars.whole, avatars.real, model.actions, model.moves, model.halts
    ends_x, ends_z, frames, worst, halts_x, halts_z = work[0], work[1], work[2], work[3], work[4], work[5]
    scale, speed = real[SCALE, own], real[SPEED, own]
    cos, sin = cos_sin(real[HEADING, own])
    cos, sin = cos * scale, sin * scale
    done = min(real[PHASE, own] - actions[whole[ACTION, own], LENGTH], speed)
    state = actions[whole[ACTION, own], NEXT]
    offset = model.offsets[state]
    n = model.offsets[state + 1] - offset
    for k in range(np.uint64(n)):
        action = np.uint64(offset) + k
        ex, ez = moves[action, MOVE_X], moves[action, MOVE_Z]
        ends_x[k], ends_z[k] = ex * cos + ez * sin, ez * cos - ex * sin
        hx, hz = halts[action, 0], halts[action, 1]
        halts_x[k], halts_z[k] = hx * cos + hz * sin, hz * cos - hx * sin
        frames[k] = actions[action, LENGTH]
    lanes = np.uint64(whole_lanes(n))
    for k in range(lanes):
        frames[k] = max(frames[k] - done, 0.0) / speed
        worst[k] = 0.0
    return lanes


@kernel(inline=True)
def _add_neighbour(crowding, near, m, lanes, work):
    """Raise the cost of actions that end, or pass, inside a neighbour to what that costs."""
    ends_x, ends_z, frames, worst, halts_x, halts_z = work[0], work[1], work[2], work[3], work[4], work[5]
    end_cost, path_cost = near[m, 6], near[m, 7]
    ax, az, wx, wz, room, left = near[m, 0], near[m, 1], near[m, 2], near[m, 3], near[m, 4], near[m, 5]
    halt_x, halt_z = near[m, 8], near[m, 9]
    # Bodies that halt meet nearer to one another: their distance counts for so much more.
    per_room, halted = 1.0 / room, 1.0 / (HALTED * HALTED)
    # No branch, since it cannot be predicted which neighbours come too near.
    for k in range(lanes):
        share = frames[k] / left if frames[k] < left else 1.0
        dx, dz = share * wx - ends_x[k], share * wz - ends_z[k]
        bx, bz = ax + dx, az + dz
        # From the end of the action to where both have come to a halt.
        ux, uz = halt_x - halts_x[k] - bx, halt_z - halts_z[k] - bz
        onwards, moved = -(bx * ux + bz * uz), ux * ux + uz * uz
        t = onwards / moved if onwards < moved else 1.0
        t = t if onwards > 0.0 else 0.0
        nx, nz = bx + t * ux, bz + t * uz
        nearest = min(bx * bx + bz * bz, halted * (nx * nx + nz * nz))
        at_end = end_cost * (1.0 - math.sqrt(nearest) * per_room)
        # Point of their straight paths at which the two are nearest, seen from the avatar.
        towards, moved = -(ax * dx + az * dz), dx * dx + dz * dz
        t = towards / moved if towards < moved else 1.0
        nx, nz = ax + t * dx, az + t * dz
        on_way = path_cost * (1.0 - math.sqrt(nx * nx + nz * nz) * per_room)
        worst[k] = max(max(worst[k], at_end), on_way if towards > 0.0 else 0.0)


@kernel(inline=True)
def _add_lying(model, avatars, own, near, m, work):
    """Raise the cost of actions that end on a body on the floor, or are over it halfway, to what that costs.

    Soles that come onto it, or end near it, add to that.
    """
    ends_x, ends_z, worst = work[0], work[1], work[3]
    room, end_cost, path_cost = near[m, 4], near[m, 6], near[m, 7]
    state = model.actions[avatars.whole[ACTION, own], NEXT]
    offset = model.offsets[state]
    for k in range(np.uint64(model.offsets[state + 1] - offset)):
        x, z = ends_x[k], ends_z[k]
        at_end = end_cost * (1.0 - _share_of(near, m, x, z, room) ** 2)
        on_way = path_cost * (1.0 - _share_of(near, m, 0.5 * x, 0.5 * z, room) ** 2)
        cost = max(max(at_end, on_way), 0.0)
        cost += near[m, 8] * treads_on(model, avatars, own, np.uint64(offset) + k, int(near[m, 9]))
        worst[k] = max(worst[k], cost)


@kernel(inline=True)
def _share_of(near, m, x, z, room):
    """Return how far a point is from the axis of a body on the floor, over ``room``."""
    ax, az, wx, wz = near[m, 0], near[m, 1], near[m, 2], near[m, 3]
    return from_axis(Axis(ax, az, ax + wx, az + wz), x, z) / room


@kernel(inline=True)
def _step_back(real, back, own, lanes, work):
    """Lower the cost of actions that lead away from the last hit."""
    x, z = real[HIT_X, own], real[HIT_Z, own]
    strength = math.sqrt(x * x + z * z)
    x, z = back * x / strength, back * z / strength
    for k in range(lanes):
        along = work[0, k] * x + work[1, k] * z
        work[3, k] -= min(along, 2.0 * back * STEP - along)

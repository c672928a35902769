"""Collision avoidance: what actions cost that end, or pass, inside a neighbour, an obstacle or outside the arena.

And what actions are worth more that lead where a hit pushes the avatar.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.arena import may_leave, outside
from crowdsim.crowd.kernels.intents import NEARBY
from crowdsim.crowd.kernels.layout import Axis
from crowdsim.crowd.kernels.lying import axis_of, from_axis, is_on_floor
from crowdsim.crowd.kernels.positions import end_of, position_of
from crowdsim.crowd.kernels.sole_contact import treads_on
from crowdsim.crowd.kernels.tables import whole_lanes
from crowdsim.crowd.kernels.travelling import travels
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import cell_at, may_be_near, part_gap, stands, way_gap

HALTED = 0.75  # where bodies meet while they halt, over where they do at the end of actions
LYING, PASSING = 0.75, 0.5  # how far from the axis of a body on the floor others should end, and pass it [m]
ON_BODY = 2.0  # what it costs to end there, over the cost of ending in a body that stands
ALONG = 0.5  # how much more for a metre to the nearer of head and feet, where one gets off without stepping over it
IN_PASSING, ON_APPROACH = 0.5, 0.15  # instead of that, for those whose opponent is far away, or not near
STEPS_OVER = 0.05  # what it costs to be halfway there
TREADS = 0.125  # what it costs to end with a sole at its surface
FAR = 2.5  # distance of an opponent from which on it is far away [m]
ON_FLOOR = -1.0  # instead of the frames that are left of an action, of bodies on the floor
BYSTANDERS = 0.66  # how much of the gap and of the cost counts for those whom an avatar does not fight
BEFORE = 0.42  # how far from obstacles actions should end, for a scale of 1 [m]
STRIKES = 1.2  # how far strikes reach at most, for a scale of 1 [m]
THROUGH, AGAINST = 60.0, 8.0  # what a metre costs that is beyond that, and a strike that ends in an obstacle
PUSHED, STEP = 12, 0.22  # for how long a hit pushes [control frames], and how far a strong one does [m]
LIGHT, FURTHEST = 0.5, 0.4  # strength from which on a hit pushes, and how far it does at the most [m]


class Ends(NamedTuple):
    """Where each of an avatar's next actions ends, seen from it, padded to whole lanes.

    Attributes:
        x: Position [m].
        z: Likewise.
        frames: Control frames until then.
        cost: What neighbours and the arena make it cost so far.
        halt_x: Where the body can halt after it [m].
        halt_z: Likewise.
        lanes: Number of entries.
    """

    x: Any
    z: Any
    frames: Any
    cost: Any
    halt_x: Any
    halt_z: Any
    lanes: Any


@kernel(inline=True)
def avoid_collisions(model, avatars, world, now, own, observed, q, scratch):
    """Lower the values of actions that end, or pass, inside others, obstacles or no arena; or withstand a push."""
    state = model.actions[avatars.motion[own].action].next
    furthest = model.reaches[state] * avatars.playback[own].scale + 1e-6  # moves are single numbers
    close = 0
    if world.crowding.end_cost > 0.0 or world.crowding.path_cost > 0.0:
        close = _list_close(model, avatars, world.crowding, own, observed, q, furthest, scratch.near)
    x, z = position_of(avatars, own)
    leaves = may_leave(world.arena, x, z, furthest) and not travels(avatars, own)
    pushed = world.crowding.back > 0.0 and push_left(avatars, now.frame, own) > 0.0
    before = BEFORE * avatars.playback[own].scale
    walled = world.places.parts.shape[0] > 0 and may_be_near(world.places, x, z, furthest + before)
    if close == 0 and not leaves and not pushed and not walled:
        return
    ends = _find_ends(model, avatars, own, scratch.work)
    for m in range(np.uint64(close)):
        if scratch.near[m].frames == ON_FLOOR:
            _add_lying(model, avatars, own, scratch.near, m, ends)
        else:
            _add_neighbour(scratch.near, m, ends)
    if leaves:
        cost = world.crowding.outside_cost
        for k in range(ends.lanes):
            ends.cost[k] += cost * outside(world.arena, x + ends.x[k], z + ends.z[k])
    if walled:
        _add_obstacles(model, avatars, world.places, now.frame, own, furthest, ends)
    if pushed:
        _give_way(avatars, world.crowding.back, now.frame, own, ends)
    for k in range(ends.lanes):
        scratch.values[q, k] -= ends.cost[k]


@kernel(inline=True)
def _list_close(model, avatars, crowding, own, observed, q, furthest, near):
    """List in ``near`` the neighbours that an avatar may collide with; return how many there are.

    A record is the position seen from the avatar, the displacement to the end of the action, the distance at which
    bodies meet, the frames that are left of the action, what it costs to end in the middle, and to pass there, and
    where it can halt, seen from the avatar. Of a body on the floor it is the head, the displacement to the feet, the
    distance from the axis, ``ON_FLOOR``, what it costs to end there, to be there halfway, and to tread on it, and its
    slot.
    """
    motion = avatars.motion
    x, z = position_of(avatars, own)
    width = np.float64(motion[own].width)
    own_space = model.sizes[avatars.policy[own]].space
    close = 0
    for m in range(observed.counts[q]):
        j = np.int64(observed.neighbours[q, m])
        ax, az = avatars.x[j] - x, avatars.z[j] - z
        end_x, end_z = end_of(avatars, j)
        wx, wz = end_x - avatars.x[j], end_z - avatars.z[j]
        space = 0.5 * (own_space + model.sizes[avatars.policy[j]].space)
        if avatars.number[j] != avatars.fight[own].next_opponent and avatars.opponent[j] != avatars.number[own]:
            space *= BYSTANDERS
        room = crowding.disc * (width + motion[j].width) + crowding.gap * space
        end_cost, path_cost = crowding.end_cost * space, crowding.path_cost
        if avatars.team[j] < 0 and is_on_floor(avatars, j):
            close += _list_lying(model, avatars, crowding, own, j, furthest, near, close)
            continue
        hx, hz = motion[j].halt_x - x, motion[j].halt_z - z
        # Point of its path at which the neighbour is nearest to the position of the avatar now.
        towards, moved = -(ax * wx + az * wz), wx * wx + wz * wz
        t = min(towards / moved, 1.0) if towards > 0.0 else 0.0
        nx, nz = ax + t * wx, az + t * wz
        found = near[close]
        found.x, found.z, found.way_x, found.way_z, found.room = ax, az, wx, wz, room
        found.end_cost, found.path_cost, found.halt_x, found.halt_z = end_cost, path_cost, hx, hz
        # One that decides now may be a whole frame beyond its end, which would stand for ``ON_FLOOR``.
        found.frames = max((model.actions[motion[j].action].length - motion[j].phase) / motion[j].speed, 0.0)
        reach = room + furthest + math.sqrt((hx - ax - wx) ** 2 + (hz - az - wz) ** 2)
        close += nx * nx + nz * nz < reach * reach
    return close


@kernel(inline=True)
def _list_lying(model, avatars, crowding, own, j, furthest, near, m):
    """Write a body on the floor to record ``m`` of ``near``; return whether an avatar may get there."""
    x, z = position_of(avatars, own)
    axis = axis_of(model, avatars, j)
    found = near[m]
    found.x, found.z, found.way_x, found.way_z = axis.x - x, axis.z - z, axis.to_x - axis.x, axis.to_z - axis.z
    opponent = avatars.fight[own].next_opponent
    share, room, cost = ON_BODY, LYING, crowding.end_cost
    if opponent >= 0:
        i = avatars.slot_of[opponent]
        dx, dz = avatars.x[i] - x, avatars.z[i] - z
        square = dx * dx + dz * dz
        if square > NEARBY * NEARBY:
            share, room = IN_PASSING if square > FAR * FAR else ON_APPROACH, PASSING
    found.room, found.frames = room * avatars.playback[j].scale, ON_FLOOR
    found.end_cost, found.path_cost, found.step_cost, found.slot = share * cost, STEPS_OVER * cost, TREADS * cost, j
    return from_axis(axis, x, z) < found.room + furthest


@kernel(inline=True)
def _find_ends(model, avatars, own, work):
    """Return where each of an avatar's next actions ends, and where the body can halt after it; they cost 0 so far."""
    motion = avatars.motion
    actions, moves, halts = model.actions, model.moves, model.halts
    ends_x, ends_z, frames, cost, halts_x, halts_z = work[0], work[1], work[2], work[3], work[4], work[5]
    scale, speed = np.float64(avatars.playback[own].scale), np.float64(motion[own].speed)
    cos, sin = cos_sin(avatars.heading[own])
    cos, sin = cos * scale, sin * scale
    done = min(motion[own].phase - actions[motion[own].action].length, speed)
    state = actions[motion[own].action].next
    offset = model.offsets[state]
    n = model.offsets[state + 1] - offset
    for k in range(np.uint64(n)):
        action = np.uint64(offset) + k
        ex, ez = moves[action].x, moves[action].z
        ends_x[k], ends_z[k] = ex * cos + ez * sin, ez * cos - ex * sin
        hx, hz = halts[action].x, halts[action].z
        halts_x[k], halts_z[k] = hx * cos + hz * sin, hz * cos - hx * sin
        frames[k] = actions[action].length
    lanes = np.uint64(whole_lanes(n))
    for k in range(lanes):
        frames[k] = max(frames[k] - done, 0.0) / speed
        cost[k] = 0.0
    return Ends(ends_x, ends_z, frames, cost, halts_x, halts_z, lanes)


@kernel(inline=True)
def _add_neighbour(near, m, ends):
    """Raise the cost of actions that end, or pass, inside a neighbour to what that costs."""
    ends_x, ends_z, frames, cost, halts_x, halts_z, lanes = ends
    other = near[m]
    ax, az, wx, wz, room, left = other.x, other.z, other.way_x, other.way_z, other.room, other.frames
    end_cost, path_cost, halt_x, halt_z = other.end_cost, other.path_cost, other.halt_x, other.halt_z
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
        cost[k] = max(max(cost[k], at_end), on_way if towards > 0.0 else 0.0)


@kernel(inline=True)
def _add_lying(model, avatars, own, near, m, ends):
    """Raise the cost of actions that end on a body on the floor, or are over it halfway, to what that costs.

    Soles that come onto it, or end near it, add to that.
    """
    body = near[m]
    state = model.actions[avatars.motion[own].action].next
    offset = model.offsets[state]
    for k in range(np.uint64(model.offsets[state + 1] - offset)):
        x, z = ends.x[k], ends.z[k]
        at_end = body.end_cost * (1.0 - _share_of(near, m, x, z) ** 2) * (1.0 + ALONG * _from_ends(near, m, x, z))
        on_way = body.path_cost * (1.0 - _share_of(near, m, 0.5 * x, 0.5 * z) ** 2)
        cost = max(max(at_end, on_way), 0.0)
        cost += body.step_cost * treads_on(model, avatars, own, np.uint64(offset) + k, int(body.slot))
        ends.cost[k] = max(ends.cost[k], cost)


@kernel(inline=True)
def _add_obstacles(model, avatars, places, frame, own, furthest, ends):
    """Raise the cost of actions that end or halt in or close before obstacles, lead through them, or strike them."""
    x, z = position_of(avatars, own)
    size = np.float64(avatars.playback[own].scale)
    state = model.actions[avatars.motion[own].action].next
    offset = model.offsets[state]
    before = BEFORE * size
    far = max(furthest + before, STRIKES * size)
    cos, sin = cos_sin(avatars.heading[own])
    cos, sin = cos * size, sin * size
    cell = cell_at(places.grid, x, z)
    for m in range(places.offsets[cell], places.offsets[cell + 1]):
        if places.gaps[m] > far:
            break
        part = places.parts[places.listed[m]]
        if not stands(part, frame):
            continue
        gap, nx, nz = part_gap(part, x, z)
        if gap > far:
            continue
        first, last = model.actions[offset].strikes, model.actions[model.offsets[state + 1]].strikes
        for s in range(first, last if gap < STRIKES * size else first):
            reach = model.strikes[s]
            dx, dz = reach.x * cos + reach.z * sin, reach.z * cos - reach.x * sin
            if gap + dx * nx + dz * nz < 0.0 and part.height > reach.y * size:
                ends.cost[int(reach.owner)] += AGAINST * (way_gap(part, x, z, x + dx, z + dz, 0.0) < 0.0)
        spare = gap - min(before, gap)
        for k in range(np.uint64(model.offsets[state + 1] - offset)):
            nearest = min(ends.x[k] * nx + ends.z[k] * nz, ends.halt_x[k] * nx + ends.halt_z[k] * nz)
            if spare + nearest >= 0.0:
                continue
            lack = max(0.0, _lack(part, x, z, gap, nx, nz, ends.x[k], ends.z[k], before))
            lack = max(lack, _lack(part, x, z, gap, nx, nz, 0.5 * ends.x[k], 0.5 * ends.z[k], before))
            lack = max(lack, _lack(part, x, z, gap, nx, nz, ends.halt_x[k], ends.halt_z[k], HALTED * before))
            ends.cost[k] += THROUGH * lack


@kernel(inline=True)
def _lack(part, x, z, gap, nx, nz, dx, dz, before):
    """Return how far a way from (x, z) by (dx, dz) ends beyond where it should before a part [m].

    Where it ends further from the part than it begins, nothing lacks.
    """
    lack = min(before, gap) - gap - dx * nx - dz * nz
    if lack <= 0.0:
        return 0.0
    return lack if way_gap(part, x, z, x + dx, z + dz, before) < before else 0.0


@kernel(inline=True)
def _share_of(near, m, x, z):
    """Return how far a point is from the axis of a body on the floor, over the room that it has."""
    body = near[m]
    return from_axis(Axis(body.x, body.z, body.x + body.way_x, body.z + body.way_z), x, z) / body.room


@kernel(inline=True)
def _from_ends(near, m, x, z):
    """Return how far along the axis of a body on the floor a point is from the nearer end of it [m], 0 beyond both."""
    body = near[m]
    length = max(math.sqrt(body.way_x * body.way_x + body.way_z * body.way_z), 1e-6)
    along = ((x - body.x) * body.way_x + (z - body.z) * body.way_z) / length
    return max(min(along, length - along), 0.0)


@kernel(inline=True)
def push_left(avatars, frame, own):
    """Return how far the last hit still pushes an avatar [m]: by the square of its strength, less as time passes."""
    fight = avatars.fight[own]
    x, z = np.float64(fight.hit_x), np.float64(fight.hit_z)
    since, square = frame - fight.hit_frame, x * x + z * z
    if since > PUSHED or square < LIGHT * LIGHT:
        return 0.0
    return min(STEP * square, FURTHEST) * (1.0 - since / (PUSHED + 1.0))


@kernel(inline=True)
def _give_way(avatars, back, frame, own, ends):
    """Lower the cost of actions that lead as far as the last hit pushes, along its way."""
    x, z = np.float64(avatars.fight[own].hit_x), np.float64(avatars.fight[own].hit_z)
    strength = math.sqrt(x * x + z * z)
    x, z, far = back * x / strength, back * z / strength, back * push_left(avatars, frame, own)
    for k in range(ends.lanes):
        along = ends.x[k] * x + ends.z[k] * z
        ends.cost[k] -= min(along, 2.0 * far - along)

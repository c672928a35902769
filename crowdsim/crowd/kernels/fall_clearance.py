"""Room for bodies that fall: how much of it lacks where one would lie, and how it slides to where there is more."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.mathematics import atan2
from crowdsim.core.segments import square_between
from crowdsim.crowd.kernels.layout import DROPS, FROM_START, LEFT, RIGHT, RISING, Axis
from crowdsim.crowd.kernels.lying import (
    axes_apart,
    axis_after,
    axis_of,
    floor_transform,
    from_axis,
    is_on_floor,
    placed,
    seen_from,
)
from crowdsim.crowd.kernels.positions import end_of, position_of
from crowdsim.crowd.kernels.sole_contact import sole_gap
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import cell_at, part_gap, stands, way_gap

PARTS = 4096.0  # parts of a square metre
SIDE_BY_SIDE = 1.0  # how far apart the axes of bodies should be that lie [m]
STANDS_BY = 0.5  # how far from the axis of a body others should stand [m]
FREE = 0.05  # how far apart bodies that lie should be at the least, and soles from them [m]
WALLS = 0.25  # how far from obstacles the axis of a body that lies should end [m]
FIRMLY = 20.0  # how much the square of what lacks to that counts, beside the square of other room
SLIDES, WAYS = 0.4, 8  # how far a body slides at the most that falls beside others [m], and in how many directions


@kernel
def crowded(model, avatars, own, row, dx, dz, observed, q):
    """Return how little room there is after a fall that ends further on by (dx, dz) [m].

    The square of the room that lacks is a whole number of parts, so that sums do not depend on the order of neighbours.
    """
    motion, size = avatars.motion, np.float64(avatars.playback[own].scale)
    cos, sin = cos_sin(avatars.heading[own])
    cos, sin = cos * size, sin * size
    x, z = avatars.x[own] + dx, avatars.z[own] + dz
    axis = axis_after(model, row, FROM_START, x, z, cos, sin)
    move = model.moves[model.falls[row].action]
    x, z = x + move.x * cos + move.z * sin, z + move.z * cos - move.x * sin
    lies = (x, z, avatars.heading[own] + atan2(move.sin, move.cos), size)
    lacks = 0.0
    for m in range(observed.counts[q]):
        j = np.int64(observed.neighbours[q, m])
        if avatars.team[j] < 0 and is_on_floor(avatars, j):
            apart = axes_apart(axis, axis_of(model, avatars, j))
            lacks += _squared(1.0, SIDE_BY_SIDE - apart)
            if apart < SIDE_BY_SIDE and avatars.conditions[avatars.number[j]].standing != RISING:
                lacks += _squared(FIRMLY, FREE - _body_gap(model, avatars, row, lies, j))
        elif avatars.team[j] < 0 and avatars.conditions[avatars.number[j]].standing == DROPS:
            lacks += _squared(1.0, SIDE_BY_SIDE - axes_apart(axis, _axis_soon(avatars, axis, size, j)))
        else:
            apart = from_axis(axis, motion[j].end_x, motion[j].end_z)
            lacks += _squared(0.5, STANDS_BY - apart)
            if apart < SIDE_BY_SIDE:
                lacks += _squared(FIRMLY, FREE - _soles_gap(model, avatars, row, lies, j))
    return lacks / PARTS


@kernel(inline=True)
def _axis_soon(avatars, axis, size, j):
    """Return about where an avatar will lie that was knocked down and has not begun to fall: where the blow sends it.

    It lies like a body of a size along an axis.
    """
    dx, dz, fight = axis.to_x - axis.x, axis.to_z - axis.z, avatars.fight[j]
    hit_x, hit_z = np.float64(fight.hit_x), np.float64(fight.hit_z)
    length = math.sqrt(dx * dx + dz * dz) * avatars.playback[j].scale / size
    share = length / max(math.sqrt(hit_x * hit_x + hit_z * hit_z), 1e-9)
    x, z = end_of(avatars, j)
    return Axis(x + share * hit_x, z + share * hit_z, x, z)


@kernel(inline=True)
def _squared(share, lack):
    """Return how much room that lacks [m] counts, in parts."""
    return math.floor(share * PARTS * max(lack, 0.0) ** 2)


@kernel
def _body_gap(model, avatars, row, lies, j):
    """Return how far a body that lies after a fall, at x, z and turn and of a size, is from another that lies [m].

    It is negative where they are in one another, and at most ``FREE``.
    """
    one, other = model.fall_capsules[row], model.fall_capsules[int(avatars.conditions[avatars.number[j]].fall)]
    x, z, turn = floor_transform(model, avatars, j)
    unit = np.float64(avatars.playback[j].scale)
    stands, gap = seen_from((x, z, turn, unit), lies), FREE / unit
    size = stands[4]
    for i in range(one.shape[0]):
        own = one[i]
        start, end = placed(own.x, own.y, own.z, stands), placed(own.to_x, own.to_y, own.to_z, stands)
        x, y, z = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), 0.5 * (start[2] + end[2])
        for k in range(other.shape[0]):
            to = other[k]
            dx, dy = 0.5 * (to.x + to.to_x) - x, 0.5 * (to.y + to.to_y) - y
            dz = 0.5 * (to.z + to.to_z) - z
            reach = to.bound + own.bound * size + gap
            if dx * dx + dy * dy + dz * dz < reach * reach:
                far = math.sqrt(square_between(start, end, (to.x, to.y, to.z), (to.to_x, to.to_y, to.to_z)))
                gap = min(gap, far - to.radius - own.radius * size)
    return gap * unit


@kernel(inline=True)
def _soles_gap(model, avatars, row, lies, j):
    """Return how far a body that lies after a fall is from the soles of an avatar at the end of its action [m].

    It is at most ``FREE``.
    """
    action = avatars.motion[j].action
    frame = model.actions[action].origin + model.actions[action].length * model.policies[avatars.policy[j]].stride
    x, z = end_of(avatars, j)
    turn = avatars.playback[j].base_turn + model.ground[frame].heading
    there = (x, z, turn, np.float64(avatars.playback[j].scale))
    stands, capsules, most = seen_from(lies, there), model.fall_capsules[row], FREE / lies[3]
    left = sole_gap(model.soles, capsules, frame, LEFT, stands, most)
    return lies[3] * min(left, sole_gap(model.soles, capsules, frame, RIGHT, stands, most))


@kernel
def hemmed_in(model, avatars, world, frame, own, row, dx, dz):
    """Return how far a body would lie in obstacles after a fall that ends further on by (dx, dz): the square [m2]."""
    places, size = world.places, avatars.playback[own].scale
    x, z = position_of(avatars, own)
    cell = cell_at(places.grid, x, z)
    if cell < 0:
        return 0.0
    cos, sin = cos_sin(avatars.heading[own])
    axis = axis_after(model, row, FROM_START, x + dx, z + dz, cos * size, sin * size)
    lacks = 0.0
    for k in range(places.offsets[cell], places.offsets[cell + 1]):
        part = places.parts[places.listed[k]]
        if stands(part, frame):
            gap, nx, nz = part_gap(part, x, z)
            for px, pz in ((axis.x, axis.z), (axis.to_x, axis.to_z), (x + dx, z + dz)):
                depth = WALLS * size - gap - (px - x) * nx - (pz - z) * nz
                if depth > 0.0 and way_gap(part, x, z, px, pz, WALLS * size) < WALLS * size:
                    lacks += _squared(FIRMLY, depth)
    return lacks / PARTS


@kernel
def slide(model, avatars, world, frame, own, row, observed, q):
    """Choose how far a body slides while it falls: to the place with the most room, or nowhere if none has more."""
    _, avatars.slides[own].x, avatars.slides[own].z = roomiest(model, avatars, world, frame, own, row, observed, q)


@kernel
def roomiest(model, avatars, world, frame, own, row, observed, q):
    """Return how little room there is after a fall where the most is that a body slides to, and how far x, z [m]."""
    walled = world.places.parts.shape[0] > 0
    least, x, z = crowded(model, avatars, own, row, 0.0, 0.0, observed, q), 0.0, 0.0
    if walled:
        least += hemmed_in(model, avatars, world, frame, own, row, 0.0, 0.0)
    if least == 0.0:
        return least, x, z
    for way in range(2 * WAYS):
        # Half the distance in every direction first, then the whole: among equals the shorter slide counts.
        far = SLIDES if way >= WAYS else 0.5 * SLIDES
        cos, sin = cos_sin(2.0 * math.pi * way / WAYS)
        lacks = crowded(model, avatars, own, row, far * sin, far * cos, observed, q)
        if walled:
            lacks += hemmed_in(model, avatars, world, frame, own, row, far * sin, far * cos)
        if lacks < least:
            least, x, z = lacks, far * sin, far * cos
    return least, x, z

"""Room for bodies that fall: how much of it lacks where one would lie, and how it slides to where there is more."""

import math

from crowdsim.core.angles import cos_sin
from crowdsim.core.segments import square_between
from crowdsim.crowd.kernels.layout import (
    ACTION,
    BASE_TURN,
    DROPS,
    END_X,
    END_Z,
    FALL,
    FALL_ACTION,
    HEADING,
    HIT_X,
    HIT_Z,
    LENGTH,
    MOVE_COS,
    MOVE_SIN,
    MOVE_X,
    MOVE_Z,
    NUMBER,
    ORIGIN,
    POLICY,
    RISING,
    SCALE,
    SLIDE_X,
    SLIDE_Z,
    STANDING,
    STRIDE,
    TEAM,
    Axis,
    X,
    Z,
)
from crowdsim.crowd.kernels.lying import (
    FROM_START,
    axes_apart,
    axis_after,
    axis_of,
    floor_transform,
    from_axis,
    is_on_floor,
    placed,
    seen_from,
)
from crowdsim.crowd.kernels.sole_contact import BOUND, LEFT, RADIUS, RIGHT, sole_gap
from crowdsim.jit import kernel

PARTS = 4096.0  # parts of a square metre
SIDE_BY_SIDE = 1.0  # how far apart the axes of bodies should be that lie [m]
STANDS_BY = 0.5  # how far from the axis of a body others should stand [m]
FREE = 0.05  # how far apart bodies that lie should be at the least, and soles from them [m]
FIRMLY = 20.0  # how much the square of what lacks to that counts, beside the square of other room
SLIDES, WAYS = 0.4, 8  # how far a body slides at the most that falls beside others [m], and in how many directions


@kernel
def crowded(model, avatars, own, row, dx, dz, observed, q):
    """Return how little room there is after a fall that ends further on by (dx, dz) [m].

    The square of the room that lacks is a whole number of parts, so that sums do not depend on the order of neighbours.
    """
    whole, real, size = avatars.whole, avatars.real, avatars.real[SCALE, own]
    cos, sin = cos_sin(real[HEADING, own])
    cos, sin = cos * size, sin * size
    x, z = real[X, own] + dx, real[Z, own] + dz
    axis = axis_after(model, row, FROM_START, x, z, cos, sin)
    move = model.moves[model.falls[row, FALL_ACTION]]
    x, z = x + move[MOVE_X] * cos + move[MOVE_Z] * sin, z + move[MOVE_Z] * cos - move[MOVE_X] * sin
    lies = (x, z, real[HEADING, own] + math.atan2(move[MOVE_SIN], move[MOVE_COS]), size)
    lacks = 0.0
    for m in range(observed.counts[q]):
        j = observed.neighbours[q, m]
        if whole[TEAM, j] < 0 and is_on_floor(avatars, j):
            apart = axes_apart(axis, axis_of(model, avatars, j))
            lacks += _squared(1.0, SIDE_BY_SIDE - apart)
            if apart < SIDE_BY_SIDE and avatars.conditions[whole[NUMBER, j], STANDING] != RISING:
                lacks += _squared(FIRMLY, FREE - _body_gap(model, avatars, row, lies, j))
        elif whole[TEAM, j] < 0 and avatars.conditions[whole[NUMBER, j], STANDING] == DROPS:
            lacks += _squared(1.0, SIDE_BY_SIDE - axes_apart(axis, _axis_soon(avatars, axis, size, j)))
        else:
            apart = from_axis(axis, real[END_X, j], real[END_Z, j])
            lacks += _squared(0.5, STANDS_BY - apart)
            if apart < SIDE_BY_SIDE:
                lacks += _squared(FIRMLY, FREE - _soles_gap(model, avatars, row, lies, j))
    return lacks / PARTS


@kernel(inline=True)
def _axis_soon(avatars, axis, size, j):
    """Return about where an avatar will lie that was knocked down and has not begun to fall: where the blow sends it.

    It lies like a body of a size along an axis.
    """
    real = avatars.real
    length = math.hypot(axis.to_x - axis.x, axis.to_z - axis.z) * real[SCALE, j] / size
    share = length / max(math.hypot(real[HIT_X, j], real[HIT_Z, j]), 1e-9)
    x, z = real[END_X, j], real[END_Z, j]
    return Axis(x + share * real[HIT_X, j], z + share * real[HIT_Z, j], x, z)


@kernel(inline=True)
def _squared(share, lack):
    """Return how much room that lacks [m] counts, in parts."""
    return math.floor(share * PARTS * max(lack, 0.0) ** 2)


@kernel
def _body_gap(model, avatars, row, lies, j):
    """Return how far a body that lies after a fall, at x, z and turn and of a size, is from another that lies [m].

    It is negative where they are in one another, and at most ``FREE``.
    """
    one, other = model.fall_capsules[row], model.fall_capsules[int(avatars.conditions[avatars.whole[NUMBER, j], FALL])]
    x, z, turn = floor_transform(model, avatars, j)
    unit = avatars.real[SCALE, j]
    stands, gap = seen_from((x, z, turn, unit), lies), FREE / unit
    size = stands[4]
    for i in range(one.shape[0]):
        start, end = placed(one[i, 0], one[i, 1], one[i, 2], stands), placed(one[i, 3], one[i, 4], one[i, 5], stands)
        x, y, z = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), 0.5 * (start[2] + end[2])
        for k in range(other.shape[0]):
            to = other[k]
            dx, dy, dz = 0.5 * (to[0] + to[3]) - x, 0.5 * (to[1] + to[4]) - y, 0.5 * (to[2] + to[5]) - z
            reach = to[BOUND] + one[i, BOUND] * size + gap
            if dx * dx + dy * dy + dz * dz < reach * reach:
                far = math.sqrt(square_between(start, end, (to[0], to[1], to[2]), (to[3], to[4], to[5])))
                gap = min(gap, far - to[RADIUS] - one[i, RADIUS] * size)
    return gap * unit


@kernel(inline=True)
def _soles_gap(model, avatars, row, lies, j):
    """Return how far a body that lies after a fall is from the soles of an avatar at the end of its action [m].

    It is at most ``FREE``.
    """
    whole, real, action = avatars.whole, avatars.real, avatars.whole[ACTION, j]
    frame = model.actions[action, ORIGIN] + model.actions[action, LENGTH] * model.policies[whole[POLICY, j], STRIDE]
    there = (real[END_X, j], real[END_Z, j], real[BASE_TURN, j] + model.ground[frame, 2], real[SCALE, j])
    stands, capsules, most = seen_from(lies, there), model.fall_capsules[row], FREE / lies[3]
    left = sole_gap(model.soles, capsules, frame, LEFT, stands, most)
    return lies[3] * min(left, sole_gap(model.soles, capsules, frame, RIGHT, stands, most))


@kernel
def slide(model, avatars, own, row, observed, q):
    """Choose how far a body slides while it falls: to the place with the most room, or nowhere if none has more."""
    _, avatars.real[SLIDE_X, own], avatars.real[SLIDE_Z, own] = roomiest(model, avatars, own, row, observed, q)


@kernel
def roomiest(model, avatars, own, row, observed, q):
    """Return how little room there is after a fall where the most is that a body slides to, and how far x, z [m]."""
    least, x, z = crowded(model, avatars, own, row, 0.0, 0.0, observed, q), 0.0, 0.0
    if least == 0.0:
        return least, x, z
    for way in range(2 * WAYS):
        # Half the distance in every direction first, then the whole: among equals the shorter slide counts.
        far = SLIDES if way >= WAYS else 0.5 * SLIDES
        cos, sin = cos_sin(2.0 * math.pi * way / WAYS)
        lacks = crowded(model, avatars, own, row, far * sin, far * cos, observed, q)
        if lacks < least:
            least, x, z = lacks, far * sin, far * cos
    return least, x, z

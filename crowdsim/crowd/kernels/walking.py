"""Walks of avatars that stand at ease without an opponent: when one starts to walk, and whether its way is free."""

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.random import uniform
from crowdsim.crowd.kernels.arena import outside
from crowdsim.crowd.kernels.layout import RESTS, Axis
from crowdsim.crowd.kernels.lying import axis_of, from_axis, is_on_floor
from crowdsim.crowd.kernels.positions import course_of, position_of, way_between
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import gap_at

SETS_OFF = 0.2  # share of the pieces at ease behind which an avatar walks off, where it can
CLEAR, BESIDE = 0.8, 0.5  # how far a walk keeps from other avatars, and from bodies that lie [m]
WALLS = 0.5  # how far it keeps from obstacles [m]
NEARER = 0.1  # how much nearer it may come to a body beside which it begins [m]


@kernel(inline=True)
def sets_off(model, avatars, world, own, piece):
    """Return whether walks begin at the end of a piece, and the avatar draws that it takes one."""
    return model.rests[piece].first_walk < model.rests[piece].end_walk and _drawn(avatars, world, own) < SETS_OFF


@kernel(inline=True)
def free_walk(model, avatars, world, now, own, piece):
    """Return the row of ``Model.walks`` by which an avatar walks off from a piece of its rest; -1 where none is free.

    Of several that are free it is the first one from a drawn one on.
    """
    first, last = model.rests[piece].first_walk, model.rests[piece].end_walk
    count = last - first
    start = int(_drawn(avatars, world, own) / SETS_OFF * count)
    for k in range(count):
        walk = first + (start + k) % count
        if is_free(model, avatars, world, now, own, walk):
            return walk
    return -1


@kernel(inline=True)
def _drawn(avatars, world, i):
    """Return an avatar's draw of this decision."""
    return uniform(world.streams.choice, np.int64(avatars.number[i]), np.int64(avatars.fight[i].decisions))


@kernel
def is_free(model, avatars, world, now, own, walk):
    """Return whether a walk stays in the arena, before obstacles, and clear of all others wherever these will be.

    From a body on the floor that is nearer at the start it only leads away.
    Where an avatar of a lower number that is near may set off in the same frame, no way is free.
    """
    motion, points = avatars.motion, model.walk_points[walk]
    x, z = position_of(avatars, own)
    size = np.float64(avatars.playback[own].scale)
    cos, sin = cos_sin(avatars.heading[own])
    cos, sin = cos * size, sin * size
    count = points.shape[0]
    for k in range(count):
        px, pz = points[k, 0], points[k, 1]
        wx, wz = x + px * cos + pz * sin, z + pz * cos - px * sin
        if outside(world.arena, wx, wz) > 0.0 or gap_at(world.places, now.frame, wx, wz) < WALLS * size:
            return False
    reach = model.walks[walk].reach * size + CLEAR
    for j in range(now.present):
        if j == own:
            continue
        clear = CLEAR
        if avatars.team[j] < 0 and is_on_floor(avatars, j):
            here = axis_of(model, avatars, j)
            then, clear = here, min(BESIDE, from_axis(here, x, z) - NEARER)
        else:
            here = course_of(avatars, j)
            then = Axis(here.to_x, here.to_z, np.float64(motion[j].halt_x), np.float64(motion[j].halt_z))
            if _may_go_first(model, avatars, world, own, j, 2.0 * reach):
                return False
        if min(from_axis(here, x, z), from_axis(then, x, z)) > reach:
            continue
        for k in range(count):
            px, pz = points[k, 0], points[k, 1]
            wx, wz = x + px * cos + pz * sin, z + pz * cos - px * sin
            if min(from_axis(here, wx, wz), from_axis(then, wx, wz)) < clear:
                return False
    return True


@kernel(inline=True)
def _may_go_first(model, avatars, world, own, j, reach):
    """Return whether another avatar that rests, is near and has a lower number, draws in this frame that it sets off.

    What it has decided in this frame is not read: others may be deciding at the same time.
    """
    other = avatars.motion[j]
    if avatars.number[j] > avatars.number[own] or other.phase < model.actions[other.action].length:
        return False
    row = avatars.conditions[avatars.number[j]]
    if row.does != RESTS or row.mode == RESTS or _drawn(avatars, world, j) >= SETS_OFF:
        return False
    dx, dz = way_between(avatars, own, j)
    return dx * dx + dz * dz < reach * reach

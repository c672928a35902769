"""Confinement: where a body would be in an obstacle, its root slides along that."""

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.easing import minimum_jerk
from crowdsim.crowd.kernels.bases import base_at
from crowdsim.crowd.kernels.interpolation import ground_at
from crowdsim.crowd.kernels.layout import LIMB_ROOM, PELVIS, TRUNK_ROOM
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import REACH, cell_at, part_gap, stands, way_gap

CLEARANCE = 0.3  # how far the ground transform of a body keeps from obstacles, for a scale of 1 [m]
PASSES = 3  # how often all obstacles near are gone through
AHEAD = 6  # how far ahead in its action an avatar makes up for obstacles that it is going to be in [control frames]
FURTHEST = 64  # how far ahead it looks for them at the most [control frames]
LATE, BLENDS = 0.2, 3.0  # how far fists may be in as an action begins [m], and for how long, as it blends with the last
LAST_FIST = PELVIS + 2
NEAR = 1.6  # how near obstacles are that a body may reach in ``AHEAD`` frames, for a scale of 1 [m]
ROUNDING = 1e-5  # errors of phases in single precision add up to less until they are looked at again [control frames]
TOUCHING = 1e-5  # clearance that bodies may lack, since positions are rounded to single precision [m]
ROOT_PASSES = 12  # how often at most they are then once more, for the ground transform alone


@kernel(inline=True)
def confine(model, avatars, world, frame, i):
    """Move an avatar, and its action as a whole, out of the obstacles that its body is in, or is going to be in.

    What its action is going to lack is made up in equal steps until then.
    """
    motion, places = avatars.motion, world.places
    if motion[i].phase + AHEAD * motion[i].speed > avatars.free[i]:
        cell = cell_at(places.grid, *position_of(avatars, i))
        if cell >= 0 and places.clear[cell] < NEAR * avatars.playback[i].scale:
            _confine(model, avatars, places, frame, i)


@kernel
def _confine(model, avatars, places, frame, i):
    """Move an avatar near obstacles, see ``confine``; what was found to be free before is not looked at again.

    What comes after ``AHEAD`` frames is only looked at until it is in obstacles.
    """
    motion, length = avatars.motion, model.actions[avatars.motion[i].action].length
    phase, speed = np.float64(motion[i].phase), np.float64(motion[i].speed)
    if phase > avatars.free[i]:
        _move(avatars, i, _find_push(model, avatars, places, frame, i, 0, base_at(model, avatars, i)))
    base, free = base_at(model, avatars, i), phase
    most, step_x, step_z = 0.0, 0.0, 0.0
    for ahead in range(1, FURTHEST + 1):
        if phase + (ahead - 1) * speed >= length:
            free = whole(length, speed)
            break
        if phase + ahead * speed > avatars.free[i]:
            push_x, push_z = _find_push(model, avatars, places, frame, i, ahead, base)
            push_x, push_z = push_x / (ahead + 1), push_z / (ahead + 1)
            square = push_x * push_x + push_z * push_z
            if ahead > AHEAD and square > 0.0:
                break
            if square > most:
                most, step_x, step_z = square, push_x, push_z
        if ahead >= AHEAD and most > 0.0:
            break
        free = phase + ahead * speed + ROUNDING
    if most > 0.0:
        _move(avatars, i, (step_x, step_z))
        # A step beside one obstacle may lead into another.
        _move(avatars, i, _find_push(model, avatars, places, frame, i, 0, base_at(model, avatars, i)))
    else:
        avatars.free[i] = free


@kernel(inline=True)
def is_clear(model, avatars, places, i, action, base_x, base_z, cos, sin):
    """Return whether the octagon around an action is in no obstacle; by where that is based (``bases.base_of``).

    Parts are convex: each lies wholly beyond the line through its nearest point, perpendicular to the way there.
    """
    if avatars.conditions.shape[0] > 0 and (avatars.slides[i].x != 0.0 or avatars.slides[i].z != 0.0):
        return False
    span = model.spans[action]
    far = span[8] * np.float64(avatars.playback[i].scale)
    if far > REACH:
        return False
    middle_x, middle_z = 0.5 * (span[0] - span[1]), 0.5 * (span[2] - span[3])
    x, z = base_x + middle_x * cos + middle_z * sin, base_z - middle_x * sin + middle_z * cos
    cell = cell_at(places.grid, x, z)
    if cell >= 0:
        for k in range(places.offsets[cell], places.offsets[cell + 1]):
            if places.gaps[k] >= far:
                break
            gap, nx, nz = part_gap(places.parts[places.listed[k]], x, z)
            right, ahead = nz * sin - nx * cos, -nx * sin - nz * cos
            if gap < furthest_along(span, right, ahead) - middle_x * right - middle_z * ahead:
                return False
    return True


@kernel(inline=True)
def furthest_along(span, right, ahead):
    """Return a bound of how far an octagon (``Model.spans``) reaches along a vector, times the length of that."""
    wide, deep = abs(right), abs(ahead)
    side = span[int(right < 0.0)] if wide > deep else span[2 + int(ahead < 0.0)]
    return abs(wide - deep) * side + min(wide, deep) * span[4 + 2 * int(right < 0.0) + int(ahead < 0.0)]


@kernel(inline=True)
def whole(length, speed):
    """Return ``Avatars.free`` for an action that is in no obstacle from beginning to end."""
    return length + (AHEAD + 1) * speed


@kernel(inline=True)
def _find_push(model, avatars, places, frame, i, ahead, base):
    """Return how far an avatar must go so that its body is in no obstacle, some control frames on in its action.

    ``base`` says where the action is based now (``bases.base_at``).
    """
    motion, playback, slides = avatars.motion, avatars.playback, avatars.slides
    length, size, push = model.actions[motion[i].action].length, np.float64(playback[i].scale), (0.0, 0.0)
    done = min(np.float64(motion[i].phase) + ahead * motion[i].speed, length)
    shown = model.actions[motion[i].action].origin + done * model.policies[avatars.policy[i]].stride
    gx, gz, turned = ground_at(model.ground, shown)
    x, z = base[0] + gx * base[2] + gz * base[3], base[1] - gx * base[3] + gz * base[2]
    if avatars.conditions.shape[0] > 0 and (slides[i].x != 0.0 or slides[i].z != 0.0):
        left = minimum_jerk(done / length) - minimum_jerk(min(motion[i].phase, length) / length)
        x, z = x + left * slides[i].x, z + left * slides[i].z
    cell = cell_at(places.grid, x, z)
    if cell >= 0:
        far = max(model.extents[int(shown)], CLEARANCE) * size
        if places.clear[cell] < far:
            heading, spare = playback[i].base_turn + turned, LATE * max(1.0 - done / BLENDS, 0.0)
            push = _push_out(model.outlines[int(shown)], places, frame + ahead, cell, x, z, heading, size, far, spare)
    return push


@kernel
def _push_out(outline, places, frame, cell, from_x, from_z, heading, size, far, spare):
    """Return how far a body that has an outline goes out of the obstacles that a cell lists and that are near [m].

    Its fists may be in obstacles by what is ``spare``.
    """
    moved_x, moved_z = 0.0, 0.0
    for attempt in range(PASSES + ROOT_PASSES):
        still = True
        for k in range(places.offsets[cell], places.offsets[cell + 1]):
            if places.gaps[k] >= far + abs(moved_x) + abs(moved_z):
                break
            part = places.parts[places.listed[k]]
            x, z = from_x + moved_x, from_z + moved_z
            gap, nx, nz = part_gap(part, x, z)
            if gap >= far or not stands(part, frame):
                continue
            push = max(CLEARANCE * size - gap, TOUCHING)
            if attempt < PASSES:
                push = _find_depth(outline, part, x, z, gap, nx, nz, heading, size, spare, push)
            if push > TOUCHING:
                moved_x, moved_z, still = moved_x + push * nx, moved_z + push * nz, False
        if still:
            break
    return moved_x, moved_z


@kernel(inline=True)
def _move(avatars, i, way):
    """Move an avatar and its action, if at all."""
    moved_x, moved_z = way
    if moved_x == 0.0 and moved_z == 0.0:
        return
    avatars.free[i] = -1.0
    avatars.x[i] += moved_x
    avatars.z[i] += moved_z
    motion = avatars.motion[i]
    motion.end_x += moved_x
    motion.end_z += moved_z
    motion.halt_x += moved_x
    motion.halt_z += moved_z


@kernel(inline=True)
def _find_depth(outline, part, x, z, gap, nx, nz, heading, size, spare, least):
    """Return how far a body at (x, z) must go along (nx, nz) until its points have room before a part, or ``least``."""
    cos, sin = cos_sin(heading)
    cos, sin = cos * size, sin * size
    # The points are seen from the body, as is the way that it goes.
    right, ahead = nx * cos - nz * sin, nx * sin + nz * cos
    for p in range(outline.shape[0]):
        px, py, pz = outline[p, 0], outline[p, 1], outline[p, 2]
        room = (TRUNK_ROOM if p <= PELVIS else LIMB_ROOM) * size
        depth = room - gap - px * right - pz * ahead
        depth -= spare * size if PELVIS < p <= LAST_FIST else 0.0
        to_x, to_z = x + px * cos + pz * sin, z + pz * cos - px * sin
        if depth > least and py * size <= part.height and way_gap(part, x, z, to_x, to_z, room) < room:
            least = depth
    return least


@kernel
def confine_all(model, avatars, world, frame, present):
    """Move all avatars that are present out of obstacles, see ``confine``."""
    for i in range(present):
        confine(model, avatars, world, frame, i)

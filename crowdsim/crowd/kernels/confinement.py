"""Confinement: where a body would be in an obstacle, its root slides along that."""

from crowdsim.core.angles import cos_sin
from crowdsim.core.easing import minimum_jerk
from crowdsim.crowd.kernels.bases import base_at
from crowdsim.crowd.kernels.interpolation import ground_at
from crowdsim.crowd.kernels.layout import LIMB_ROOM, PELVIS, TRUNK_ROOM
from crowdsim.crowd.kernels.prefetch import prefetch
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import cell_at, part_gap, stands, way_gap

CLEARANCE = 0.3  # how far the ground transform of a body keeps from obstacles, for a scale of 1 [m]
PASSES = 3  # how often all obstacles near are gone through
AHEAD = 6  # how far ahead in its action an avatar looks whether it is going to be in obstacles [control frames]
LATE, BLENDS = 0.2, 3.0  # how far fists may be in as an action begins [m], and for how long, as it blends with the last
LAST_FIST = PELVIS + 2
NEAR = 1.6  # how near obstacles are that a body may reach until then, for a scale of 1 [m]
ROOT_PASSES = 12  # how often at most they are then once more, for the ground transform alone


@kernel(inline=True)
def confine(model, avatars, world, frame, i):
    """Move an avatar, and its action as a whole, out of the obstacles that its body is in, or is going to be in.

    What its action is going to lack is made up in equal steps until then.
    """
    places, size = world.places, avatars.playback[i].scale
    cell = cell_at(places.grid, avatars.x[i], avatars.z[i])
    if cell >= 0 and places.clear[cell] < NEAR * size:
        _confine(model, avatars, places, frame, i)


@kernel(allocates=False)
def _confine(model, avatars, places, frame, i):
    """Move an avatar near obstacles, see ``confine``; what was found to be free a frame ago is not looked at again."""
    phase, speed = avatars.motion[i].phase, avatars.motion[i].speed
    if phase > avatars.free[i]:
        _move(avatars, i, _find_push(model, avatars, places, frame, i, 0))
    most, step_x, step_z = 0.0, 0.0, 0.0
    for ahead in range(1, AHEAD + 1):
        if phase + (ahead - 1) * speed >= _length(model, avatars, i):
            break
        if phase + ahead * speed <= avatars.free[i]:
            continue
        push_x, push_z = _find_push(model, avatars, places, frame, i, ahead)
        push_x, push_z = push_x / (ahead + 1), push_z / (ahead + 1)
        square = push_x * push_x + push_z * push_z
        if square > most:
            most, step_x, step_z = square, push_x, push_z
    if most > 0.0:
        _move(avatars, i, (step_x, step_z))
        # A step beside one obstacle may lead into another.
        _move(avatars, i, _find_push(model, avatars, places, frame, i, 0))
    else:
        avatars.free[i] = phase + AHEAD * speed + 1e-9
        prefetch_outline(model, avatars, i, avatars.motion[i].action, phase + (AHEAD + 1) * speed)


@kernel(inline=True)
def prefetch_outline(model, avatars, i, action, phase):
    """Prefetch what says where a body is some frames into an action."""
    shown = int(phase * model.policies[avatars.policy[i]].stride)
    shown = min(shown, model.actions[action].length * model.policies[avatars.policy[i]].stride)
    shown += model.actions[action].origin
    prefetch(model.ground, shown)
    prefetch(model.extents, shown)
    prefetch(model.outlines, shown)
    prefetch(model.outlines, shown + 1)  # the end of what is longer than a line


@kernel(inline=True)
def _length(model, avatars, i):
    return model.actions[avatars.motion[i].action].length


@kernel(inline=True)
def _find_push(model, avatars, places, frame, i, ahead):
    """Return how far an avatar must go so that its body is in no obstacle, some control frames on in its action."""
    motion, playback, slides = avatars.motion, avatars.playback, avatars.slides
    length, size, push = _length(model, avatars, i), playback[i].scale, (0.0, 0.0)
    done = min(motion[i].phase + ahead * motion[i].speed, length)
    shown = model.actions[motion[i].action].origin + done * model.policies[avatars.policy[i]].stride
    x, z, heading = avatars.x[i], avatars.z[i], avatars.heading[i]
    if ahead > 0:
        gx, gz, turned = ground_at(model.ground, shown)
        base_x, base_z, cos, sin = base_at(model, avatars, i)
        x, z = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
        heading = playback[i].base_turn + turned
        if avatars.conditions.shape[0] > 0:  # only avatars that may fall have a slide
            left = minimum_jerk(done / length) - minimum_jerk(min(motion[i].phase, length) / length)
            x, z = x + left * slides[i].x, z + left * slides[i].z
    cell = cell_at(places.grid, x, z)
    if cell >= 0:
        far = max(model.extents[int(shown)], CLEARANCE) * size
        if places.clear[cell] < far:
            spare = LATE * max(1.0 - done / BLENDS, 0.0)
            push = _push_out(model.outlines[int(shown)], places, frame + ahead, cell, x, z, heading, size, far, spare)
    return push


@kernel(allocates=False)
def _push_out(outline, places, frame, cell, from_x, from_z, heading, size, far, spare):
    """Return how far a body that has an outline goes out of the obstacles that a cell lists and that are near [m].

    Its fists may be in obstacles by what is ``spare``.
    """
    cos, sin = cos_sin(heading)
    cos, sin = cos * size, sin * size
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
            push = CLEARANCE * size - gap
            for p in range(outline.shape[0] if attempt < PASSES else 0):
                point = outline[p]
                dx, dz = point[0] * cos + point[2] * sin, point[2] * cos - point[0] * sin
                room = (TRUNK_ROOM if p <= PELVIS else LIMB_ROOM) * size
                depth = _depth(part, x, z, gap, nx, nz, dx, point[1] * size, dz, room)
                push = max(push, depth - spare * size if PELVIS < p <= LAST_FIST else depth)
            if push > 1e-9:
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
def _depth(part, x, z, gap, nx, nz, dx, y, dz, room):
    """Return how far a body at (x, z) must go along (nx, nz) until its point (dx, dz) has room before a part [m]."""
    depth = room - gap - dx * nx - dz * nz
    if depth <= 0.0 or y > part.height:
        return 0.0
    return depth if way_gap(part, x, z, x + dx, z + dz) < room else 0.0


@kernel(allocates=False)
def confine_all(model, avatars, world, frame, present):
    """Move all avatars that are present out of obstacles, see ``confine``."""
    for i in range(present):
        confine(model, avatars, world, frame, i)

"""Confinement: where a body would be in an obstacle, its root slides along that."""

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.layout import LIMB_ROOM, PELVIS, TRUNK_ROOM
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import cell_at, is_beyond, part_gap, stands, way_gap

CLEARANCE = 0.3  # how far the ground transform of a body keeps from obstacles, for a scale of 1 [m]
PASSES = 3  # how often all obstacles near are gone through
ROOT_PASSES = 12  # how often at most they are then once more, for the ground transform alone


@kernel(inline=True)
def confine(model, avatars, world, frame, i):
    """Move an avatar, and its action as a whole, out of the obstacles that its body is in."""
    places = world.places
    cell = cell_at(places.grid, avatars.x[i], avatars.z[i])
    if cell >= 0:
        action = avatars.motion[i].action
        done = min(avatars.motion[i].phase, model.actions[action].length)
        shown = int(model.actions[action].origin + done * model.policies[avatars.policy[i]].stride)
        far = max(model.extents[shown], CLEARANCE) * avatars.playback[i].scale
        if places.clear[cell] < far:
            _push_out(model.outlines[shown], avatars, places, frame, i, cell, far)


@kernel(allocates=False)
def _push_out(outline, avatars, places, frame, i, cell, far):
    """Move an avatar whose body has an outline out of the obstacles that a cell lists and that are nearer than far."""
    size = avatars.playback[i].scale
    cos, sin = cos_sin(avatars.heading[i])
    cos, sin = cos * size, sin * size
    moved_x, moved_z = 0.0, 0.0
    for attempt in range(PASSES + ROOT_PASSES):
        still = True
        for k in range(places.offsets[cell], places.offsets[cell + 1]):
            part = places.parts[places.listed[k]]
            x, z = avatars.x[i] + moved_x, avatars.z[i] + moved_z
            if is_beyond(part, x, z, far):
                continue
            gap, nx, nz = part_gap(part, x, z)
            if gap >= far or not stands(part, frame):
                continue
            push = CLEARANCE * size - gap
            for p in range(outline.shape[0] if attempt < PASSES else 0):
                point = outline[p]
                dx, dz = point[0] * cos + point[2] * sin, point[2] * cos - point[0] * sin
                room = (TRUNK_ROOM if p <= PELVIS else LIMB_ROOM) * size
                push = max(push, _depth(part, x, z, gap, nx, nz, dx, point[1] * size, dz, room))
            if push > 1e-9:
                moved_x, moved_z, still = moved_x + push * nx, moved_z + push * nz, False
        if still:
            break
    if moved_x != 0.0 or moved_z != 0.0:
        avatars.x[i] += moved_x
        avatars.z[i] += moved_z
        avatars.playback[i].base_x += moved_x
        avatars.playback[i].base_z += moved_z
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

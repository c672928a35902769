"""Noticing: an avatar that has knocked another down keeps facing it, guard up, and steps back from it.

That lasts for a while, or, if it has no other opponent, until the other gets up; in a rectangular arena it goes to a
neutral corner then. A hit ends it.
"""

import math

from crowdsim.crowd.kernels.layout import FALLING, FIGHTS, LYING, NOTICES, RECTANGLE, Target
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel

FACES = 27.0  # how long an avatar with other opponents faces the one that it has knocked down [control frames]
STAYS = 8.0  # how long it stays where it is before it steps back [control frames]
KEEPS = 2.2  # how far it steps back [m]
FIGHTING = 0.9  # distance at which an opponent makes it neither approach nor step back [m]
RETREAT = 0.45  # distance at which an opponent makes it step back [m]
CORNER = 0.8  # how far from the sides of the arena the middle of a neutral corner is, and how near it goes to that [m]


@kernel(inline=True)
def noticed(avatars, now, own, opponent):
    """Return the number of the avatar on the floor that an avatar faces instead of its ``opponent``, or -1."""
    row = avatars.conditions[avatars.number[own]]
    other = int(row.felled) - 1
    if other < 0 or row.mode != FIGHTS or avatars.fight[own].hit_frame > row.felled_frame:
        return -1
    if now.frame - row.felled_frame > FACES and opponent != -1:
        return -1
    lies = FALLING <= avatars.conditions[other].standing <= LYING
    return other if lies and avatars.slot_of[other] < now.present else -1


@kernel(inline=True)
def see_fallen(avatars, world, now, own, target):
    """Decide that an avatar faces one on the floor, whose head is the target; return where it sees that therefore."""
    row = avatars.conditions[avatars.number[own]]
    row.does_next = NOTICES
    x, z = position_of(avatars, own)
    dx, dz = target.x - x, target.z - z
    far = max(math.sqrt(dx * dx + dz * dz), 1e-9)
    dx, dz, height = dx / far, dz / far, 1.5 * avatars.playback[own].scale
    near = FIGHTING
    since, arena = now.frame - row.felled_frame, world.arena
    if STAYS < since <= FACES and far < KEEPS:
        near = RETREAT
    elif since > FACES and arena.kind == RECTANGLE:
        # The corner that is furthest from the fallen; it steps back towards it.
        side = arena.half_x - CORNER if target.x < arena.x else CORNER - arena.half_x
        end = arena.half_z - CORNER if target.z < arena.z else CORNER - arena.half_z
        cx, cz = arena.x + side - x, arena.z + end - z
        away = math.sqrt(cx * cx + cz * cz)
        if away > CORNER:
            near = RETREAT
            dx, dz = dx - cx / away, dz - cz / away
            length = max(math.sqrt(dx * dx + dz * dz), 1e-9)
            dx, dz = dx / length, dz / length
    elif since > FACES and far < KEEPS:
        near = RETREAT
    return Target(x + near * dx, height, z + near * dz, 0.0, 0.0, target.lasts)

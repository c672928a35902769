"""Opponents behind obstacles: others that are seen come first, and ways lead around."""

import math

from crowdsim.crowd.kernels.layout import Target
from crowdsim.crowd.kernels.positions import position_of, way_between
from crowdsim.jit import kernel
from crowdsim.places.kernels.distance import ANY_HEIGHT, is_way_free
from crowdsim.places.kernels.routes import first_corner

EYES = 1.5  # height over which others are seen, for a scale of 1 [m]
LOOKED_AT = 400  # in crowds of up to so many everyone is looked at, in larger ones neighbours alone
FURTHER = 2.0  # how many times as far away as a hidden opponent one may be that is seen, and 1 m more
WALKS = 0.22  # how far a straight way to an opponent keeps from obstacles [m]


@kernel(inline=True)
def is_hidden(avatars, world, frame, own, x, z):
    """Return whether an obstacle is between an avatar and a point that it looks at."""
    height = EYES * avatars.playback[own].scale
    own_x, own_z = position_of(avatars, own)
    return not is_way_free(world.places, frame, own_x, own_z, x, z, 0.0, height)


@kernel(inline=True)
def prefer_seen(avatars, world, now, own, opponent, observed, q):
    """Return the number of an avatar's opponent, and whether the straight way to it is free.

    Instead of one that is hidden it is the nearest other that is seen, if that is not much further away.
    """
    skip, places = avatars.skip[own], world.places
    if opponent < 0 or avatars.slot_of[opponent] >= now.present:
        return opponent, False
    slot = avatars.slot_of[opponent]
    x, z = position_of(avatars, own)
    to_x, to_z = position_of(avatars, slot)
    if is_way_free(places, now.frame, x, z, to_x, to_z, WALKS, ANY_HEIGHT):
        return opponent, True
    if skip == -2 or not is_hidden(avatars, world, now.frame, own, to_x, to_z):
        return opponent, False
    return _nearest_seen(avatars, world, now, own, opponent, observed, q), False


@kernel
def _nearest_seen(avatars, world, now, own, opponent, observed, q):
    """Return the number of the nearest opponent that is seen, if that is not much further away than a hidden one."""
    skip = avatars.skip[own]
    dx, dz = way_between(avatars, own, avatars.slot_of[opponent])
    best = (FURTHER * math.sqrt(dx * dx + dz * dz) + 1.0) ** 2
    found, near = opponent, observed.counts[q]
    # The opponent so far and neighbours first, since one that is seen leaves few others to be looked at.
    old = avatars.opponent[own]
    if old >= 0 and old != opponent and avatars.slot_of[old] < now.present:
        j = avatars.slot_of[old]
        dx, dz = way_between(avatars, own, j)
        square = dx * dx + dz * dz
        is_open = j != own and avatars.team[j] != skip and avatars.team[j] >= 0
        if is_open and square < best and not is_hidden(avatars, world, now.frame, own, *position_of(avatars, j)):
            best, found = square, old
    for m in range(near + (now.present if now.present <= LOOKED_AT else 0)):
        j = observed.neighbours[q, m] if m < near else m - near
        if j == own or avatars.team[j] == skip or avatars.team[j] < 0:
            continue
        dx, dz = way_between(avatars, own, j)
        square = dx * dx + dz * dz
        nearer = square < best or (square == best and avatars.number[j] < found)
        if nearer and not is_hidden(avatars, world, now.frame, own, *position_of(avatars, j)):
            best, found = square, avatars.number[j]
    return found


@kernel
def way_to(places, frame, x, z, target):
    """Return a target where it is, or as far from (x, z) as the way around obstacles is, where that leads first."""
    if is_way_free(places, frame, x, z, target.x, target.z, WALKS, ANY_HEIGHT):
        return target
    corner, length = first_corner(places, frame, x, z, target.x, target.z)
    if corner < 0 or length == math.inf:
        return target
    dx, dz = places.corners[corner, 0] - x, places.corners[corner, 1] - z
    share = length / max(math.sqrt(dx * dx + dz * dz), 1e-9)
    return Target(x + share * dx, target.y, z + share * dz, 0.0, 0.0, target.lasts)

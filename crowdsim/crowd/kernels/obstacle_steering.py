"""Ways around bodies on the floor, for avatars whose opponents are beyond these."""

import math

import numpy as np

from crowdsim.crowd.kernels.layout import Target
from crowdsim.crowd.kernels.lying import axis_of, is_on_floor
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel

BEYOND = 0.45  # how far beyond head and feet of a body a way still leads over it [m]
AROUND = 0.65  # how far beyond them ways around it lead [m]
SOON = 2.5  # how far away the way meets bodies that count [m]
BODIES = 2  # how many bodies, one after another, a way leads around


@kernel
def go_around(model, avatars, own, target, observed, q):
    """Return a target where it is, or as far away, but in the direction of the way around the first body before it."""
    x, z = position_of(avatars, own)
    dx, dz = target.x - x, target.z - z
    far = math.sqrt(dx * dx + dz * dz)
    for _ in range(BODIES):
        first, to_x, to_z = 1.0, 0.0, 0.0
        for m in range(observed.counts[q]):
            j = np.int64(observed.neighbours[q, m])
            if avatars.team[j] < 0 and is_on_floor(avatars, j):
                share, px, pz = _way_around(axis_of(model, avatars, j), avatars.playback[j].scale, x, z, dx, dz)
                if share < first and share * far <= SOON:
                    first, to_x, to_z = share, px, pz
        if first == 1.0:
            break
        way = max(math.sqrt(to_x * to_x + to_z * to_z), 1e-6)
        dx, dz = to_x * far / way, to_z * far / way
    return Target(x + dx, target.y, z + dz, target.vx, target.vz, target.lasts)


@kernel
def _way_around(axis, size, x, z, dx, dz):
    """Return at which share of a way (dx, dz) from (x, z) it crosses a body's axis, and where it should lead instead.

    The share is infinite where it does not cross. Of the ways by head and by feet it is the shorter one that counts.
    """
    ax, az = axis.to_x - axis.x, axis.to_z - axis.z
    length = max(math.sqrt(ax * ax + az * az), 1e-6)
    ax, az = ax / length, az / length
    px, pz = axis.x - x, axis.z - z
    across = dx * az - dz * ax
    if across == 0.0:
        return math.inf, 0.0, 0.0
    share, along = (px * az - pz * ax) / across, (px * dz - pz * dx) / across
    if share <= 0.0 or along < -BEYOND * size or along > length + BEYOND * size:
        return math.inf, 0.0, 0.0
    hx, hz = px - AROUND * size * ax, pz - AROUND * size * az
    fx, fz = px + (length + AROUND * size) * ax, pz + (length + AROUND * size) * az
    by_head = math.sqrt(hx * hx + hz * hz) + math.sqrt((dx - hx) ** 2 + (dz - hz) ** 2)
    by_feet = math.sqrt(fx * fx + fz * fz) + math.sqrt((dx - fx) ** 2 + (dz - fz) ** 2)
    if by_head < by_feet:
        return share, hx, hz
    return share, fx, fz

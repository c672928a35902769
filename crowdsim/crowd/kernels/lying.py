"""Where bodies lie: the axis from head to feet on the floor, and how near it is to others."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.bases import base_at
from crowdsim.crowd.kernels.layout import FALLING, FROM_END, RISING, Axis
from crowdsim.crowd.kernels.positions import end_of
from crowdsim.jit import kernel


@kernel(inline=True)
def is_on_floor(avatars, j):
    """Return whether an avatar falls, lies or gets up."""
    if avatars.conditions.shape[0] == 0:
        return False
    return FALLING <= avatars.conditions[avatars.number[j]].standing <= RISING


@kernel(inline=True)
def axis_after(model, fall, seen_from, x, z, cos, sin):
    """Return where a body lies after a fall, seen from a position; ``cos`` and ``sin`` are times the body's size.

    The position is that at the start of the fall (``FROM_START``), or at its end (``FROM_END``).
    """
    axis = model.fall_axes[fall, seen_from]
    head_x, head_z = x + axis.x * cos + axis.z * sin, z - axis.x * sin + axis.z * cos
    return Axis(head_x, head_z, x + axis.to_x * cos + axis.to_z * sin, z - axis.to_x * sin + axis.to_z * cos)


@kernel(inline=True)
def floor_transform(model, avatars, j):
    """Return the ground transform of an avatar on the floor where it lies, or will lie: x, z [m] and turn [rad]."""
    motion, playback = avatars.motion, avatars.playback
    ground = model.ground
    action = motion[j].action
    frame = model.actions[action].origin
    if avatars.conditions[avatars.number[j]].standing == RISING:
        base_x, base_z, cos, sin = base_at(model, avatars, j)
        gx, gz = ground[frame].x, ground[frame].z
        x, z = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
    else:
        frame += model.actions[action].length * model.policies[avatars.policy[j]].stride
        x, z = end_of(avatars, j)
    return x, z, playback[j].base_turn + ground[frame].heading


@kernel(inline=True)
def seen_from(body, other):
    """Return where another body is, in units in which a body is of size 1; both by x, z [m], turn [rad] and size.

    That is x, z, cosine and sine of its turn times its size, and its size.
    """
    x, z, turn, unit = body
    dx, dz, size = other[0] - x, other[1] - z, other[3] / unit
    cos, sin = cos_sin(turn)
    own_cos, own_sin = cos_sin(other[2] - turn)
    return (dx * cos - dz * sin) / unit, (dx * sin + dz * cos) / unit, own_cos * size, own_sin * size, size


@kernel(inline=True)
def placed(x, y, z, stands):
    """Return where a point of a body is that is somewhere, as ``seen_from`` returns it."""
    at_x, at_z, cos, sin, size = stands
    return at_x + x * cos + z * sin, y * size, at_z - x * sin + z * cos


@kernel(inline=True)
def axis_of(model, avatars, j):
    """Return where an avatar lies, or will lie; of one that gets up, from there to where it will stand."""
    row = avatars.conditions[avatars.number[j]]
    x, z, turn = floor_transform(model, avatars, j)
    cos, sin = cos_sin(turn)
    size = np.float64(avatars.playback[j].scale)
    axis = axis_after(model, int(row.fall), FROM_END, x, z, cos * size, sin * size)
    if row.standing == RISING:
        x, z = end_of(avatars, j)
        return Axis(0.5 * (axis.x + axis.to_x), 0.5 * (axis.z + axis.to_z), x, z)
    return axis


@kernel(inline=True)
def from_axis(axis, x, z):
    """Return how far a point is from an axis [m]."""
    wx, wz = axis.to_x - axis.x, axis.to_z - axis.z
    dx, dz = x - axis.x, z - axis.z
    share = min(max((dx * wx + dz * wz) / max(wx * wx + wz * wz, 1e-12), 0.0), 1.0)
    dx, dz = dx - share * wx, dz - share * wz
    return math.sqrt(dx * dx + dz * dz)


@kernel(inline=True)
def axes_apart(one, other):
    """Return how far two axes are from one another [m]; 0 where they cross."""
    wx, wz, vx, vz = one.to_x - one.x, one.to_z - one.z, other.to_x - other.x, other.to_z - other.z
    dx, dz = other.x - one.x, other.z - one.z
    across = wx * vz - wz * vx
    if across != 0.0:
        s, t = (dx * vz - dz * vx) / across, (dx * wz - dz * wx) / across
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            return 0.0
    least = min(from_axis(one, other.x, other.z), from_axis(one, other.to_x, other.to_z))
    return min(least, min(from_axis(other, one.x, one.z), from_axis(other, one.to_x, one.to_z)))

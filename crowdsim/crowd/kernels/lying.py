"""Where bodies lie: the axis from head to feet on the floor, and how near it is to others."""

import math

from crowdsim.core.angles import cos_sin
from crowdsim.crowd.kernels.layout import (
    ACTION,
    BASE_COS,
    BASE_SIN,
    BASE_TURN,
    BASE_X,
    BASE_Z,
    END_X,
    END_Z,
    FALL,
    FALLING,
    LENGTH,
    NUMBER,
    ORIGIN,
    POLICY,
    RISING,
    SCALE,
    STANDING,
    STRIDE,
    Axis,
)
from crowdsim.jit import kernel

FROM_START, FROM_END = 0, 4  # columns of ``Model.fall_axes``: seen from the first frame of a fall, and from its last


@kernel(inline=True)
def is_on_floor(avatars, j):
    """Return whether an avatar falls, lies or gets up."""
    if avatars.conditions.shape[0] == 0:
        return False
    return FALLING <= avatars.conditions[avatars.whole[NUMBER, j], STANDING] <= RISING


@kernel(inline=True)
def axis_after(model, fall, column, x, z, cos, sin):
    """Return where a body lies after a fall, seen from a position; ``cos`` and ``sin`` are times the body's size."""
    axes = model.fall_axes
    hx, hz, fx, fz = axes[fall, column], axes[fall, column + 1], axes[fall, column + 2], axes[fall, column + 3]
    return Axis(x + hx * cos + hz * sin, z - hx * sin + hz * cos, x + fx * cos + fz * sin, z - fx * sin + fz * cos)


@kernel(inline=True)
def floor_transform(model, avatars, j):
    """Return the ground transform of an avatar on the floor where it lies, or will lie: x, z [m] and turn [rad]."""
    whole, real, ground = avatars.whole, avatars.real, model.ground
    action = whole[ACTION, j]
    frame = model.actions[action, ORIGIN]
    if avatars.conditions[whole[NUMBER, j], STANDING] == RISING:
        cos, sin = real[BASE_COS, j], real[BASE_SIN, j]
        gx, gz = ground[frame, 0], ground[frame, 1]
        x, z = real[BASE_X, j] + gx * cos + gz * sin, real[BASE_Z, j] - gx * sin + gz * cos
    else:
        frame += model.actions[action, LENGTH] * model.policies[whole[POLICY, j], STRIDE]
        x, z = real[END_X, j], real[END_Z, j]
    return x, z, real[BASE_TURN, j] + ground[frame, 2]


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
    real, row = avatars.real, avatars.conditions[avatars.whole[NUMBER, j]]
    x, z, turn = floor_transform(model, avatars, j)
    cos, sin = cos_sin(turn)
    size = real[SCALE, j]
    axis = axis_after(model, int(row[FALL]), FROM_END, x, z, cos * size, sin * size)
    if row[STANDING] == RISING:
        return Axis(0.5 * (axis.x + axis.to_x), 0.5 * (axis.z + axis.to_z), real[END_X, j], real[END_Z, j])
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

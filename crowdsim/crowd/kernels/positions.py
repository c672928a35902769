"""Positions of avatars, which are stored in single precision, in the double precision in which kernels compute."""

import numpy as np

from crowdsim.crowd.kernels.layout import Axis
from crowdsim.jit import kernel


@kernel(inline=True)
def position_of(avatars, i):
    """Return the position of an avatar: x and z [m]."""
    return np.float64(avatars.x[i]), np.float64(avatars.z[i])


@kernel(inline=True)
def way_between(avatars, i, j):
    """Return how far avatar ``j`` is from avatar ``i``, along x and z [m]."""
    return np.float64(avatars.x[j]) - avatars.x[i], np.float64(avatars.z[j]) - avatars.z[i]


@kernel(inline=True)
def end_of(avatars, i):
    """Return where the action of an avatar ends: x and z [m]."""
    return np.float64(avatars.motion[i].end_x), np.float64(avatars.motion[i].end_z)


@kernel(inline=True)
def course_of(avatars, i):
    """Return the line from where an avatar is to where its action ends."""
    x, z = position_of(avatars, i)
    end_x, end_z = end_of(avatars, i)
    return Axis(x, z, end_x, end_z)

"""Ground transforms (x, z, heading) and points, one at a time and in plain numbers.

For vectors as short as these, each call of numpy takes longer than all of it.
"""

import math

import numpy as np


def compose(a, b):
    """The place b, given in the frame of a, in the frame that a is given in. Shapes (3,)."""
    x, z, heading = map(float, a)
    along_x, along_z, turn = map(float, b)
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([x + along_x * cos + along_z * sin, z - along_x * sin + along_z * cos, heading + turn])


def inverse(a):
    """The ground transform that undoes a. Shape (3,)."""
    x, z, heading = map(float, a)
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([-(x * cos - z * sin), -(x * sin + z * cos), -heading])


def to_local(a, point):
    """A point of the world as seen from a ground transform [m]. Shapes (3,)."""
    from_x, from_z, heading = map(float, a)
    x, y, z = map(float, point)
    cos, sin = math.cos(heading), math.sin(heading)
    dx, dz = x - from_x, z - from_z
    return np.array([dx * cos - dz * sin, y, dx * sin + dz * cos])


def to_world(a, point):
    """A point of a ground frame in the world [m]. Shapes (3,)."""
    from_x, from_z, heading = map(float, a)
    x, y, z = map(float, point)
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([from_x + x * cos + z * sin, y, from_z - x * sin + z * cos])

"""Records of obstacles that kernels share."""

import numpy as np

WALL, BOX, DISC, ROPES, DOOR = range(5)
BORDER = -1  # number of the ropes along the border of a solid arena, instead of that of an obstacle

_FIELDS = ("x", "z", "ux", "uz", "half_along", "half_across", "radius", "height", "opens", "closes")
PART = np.dtype([*((name, np.float64) for name in _FIELDS), ("kind", np.int32), ("obstacle", np.int32)])
"""A part of an obstacle: all points within ``radius`` of a rectangle.

    x, z: Middle of the rectangle [m].
    ux, uz: Its direction, of unit length.
    half_along, half_across: Half its sizes along and across that [m].
    radius: How far around it the part reaches [m].
    height: How high it is [m].
    opens, closes: Control frames from which on a door is open, and closed again; infinite for what is no door.
    kind: ``WALL`` to ``DOOR``.
    obstacle: Number of the obstacle that it belongs to, or ``BORDER``.
"""

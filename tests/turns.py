"""Rotations as tests write them down."""

import numpy as np

from crowdsim.motion import quaternion


def about(axis, angle):
    """Return the rotation by an angle [rad] about a unit axis (..., 3). Shape (..., 4)."""
    return quaternion.from_rotation_vector(np.asarray(axis, dtype=float) * np.asarray(angle, dtype=float)[..., None])

"""Ground transforms ``(x, z, heading)``: position and heading of a body; arrays ``(..., 3)`` that broadcast.

In a ground frame +z is ahead, +x is to the left and +y is up, so a bearing ``atan2(x, z)`` grows to the left as a
heading does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array


def compose(a: ArrayLike, b: ArrayLike) -> Array:
    """Return a b: the place b, given in the frame of a, in the frame that a is given in. Shapes (..., 3)."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + b[..., 0] * cos + b[..., 1] * sin
    z = a[..., 1] - b[..., 0] * sin + b[..., 1] * cos
    return np.stack([x, z, a[..., 2] + b[..., 2]], axis=-1)


def inverse(a: ArrayLike) -> Array:
    """Return the ground transform that undoes a. Shape (..., 3)."""
    a = np.asarray(a, dtype=float)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack([-(a[..., 0] * cos - a[..., 1] * sin), -(a[..., 0] * sin + a[..., 1] * cos), -a[..., 2]], axis=-1)


def to_local(ground: ArrayLike, points: ArrayLike) -> Array:
    """Return world points (..., 3) as seen from the ground transform (..., 3) [m]."""
    ground, points = np.asarray(ground, dtype=float), np.asarray(points, dtype=float)
    cos, sin = np.cos(ground[..., 2]), np.sin(ground[..., 2])
    dx, dz = points[..., 0] - ground[..., 0], points[..., 2] - ground[..., 1]
    return np.stack(np.broadcast_arrays(dx * cos - dz * sin, points[..., 1], dx * sin + dz * cos), axis=-1)


def to_world(ground: ArrayLike, points: ArrayLike) -> Array:
    """Return points (..., 3) of the ground frame (..., 3) in the world [m]."""
    ground, points = np.asarray(ground, dtype=float), np.asarray(points, dtype=float)
    cos, sin = np.cos(ground[..., 2]), np.sin(ground[..., 2])
    x = ground[..., 0] + points[..., 0] * cos + points[..., 2] * sin
    z = ground[..., 1] - points[..., 0] * sin + points[..., 2] * cos
    return np.stack(np.broadcast_arrays(x, points[..., 1], z), axis=-1)


def wrap(angle: ArrayLike) -> Array:
    """Return angles [rad] in -pi..pi."""
    return np.mod(np.asarray(angle, dtype=float) + np.pi, 2 * np.pi) - np.pi

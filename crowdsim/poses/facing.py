"""Where faces and chests of bodies point."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton


def face_direction(body: Body) -> Array:
    """Return where a body's face looks, in the frame of the head's joint. Shape (3,)."""
    return _ahead(body, np.asarray(body.head_offset, dtype=float))


def chest_direction(body: Body, skeleton: Skeleton) -> Array:
    """Return where a body's chest points, in the frame of the chest's joint. Shape (3,)."""
    return _ahead(body, np.asarray(skeleton.offsets[body.roles["neck"]], dtype=float))


def _ahead(body: Body, up: Array) -> Array:
    """Where the feet point, at right angles to ``up``. Shape (3,)."""
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    ahead = np.asarray(body.sole_offsets[:, 1] - body.sole_offsets[:, 0], dtype=float).sum(axis=0)
    ahead = ahead - up * float(ahead @ up)
    length = float(np.linalg.norm(ahead))
    return np.asarray(ahead / length) if length > 1e-9 else np.array([0.0, 0.0, 1.0])

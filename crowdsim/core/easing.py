"""Easing curves: for numbers in compiled code, and for arrays."""

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.jit import kernel


@kernel(inline=True)
def minimum_jerk(s):
    """Return the step from 0 at ``s`` = 0 to 1 at ``s`` = 1 without speed and acceleration at its ends.

    It is the path of least jerk between two points at rest, 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985).
    """
    if s <= 0.0:
        return 0.0
    if s >= 1.0:
        return 1.0
    return s * s * s * (10.0 - s * (15.0 - 6.0 * s))


def ease(x: ArrayLike) -> Array:
    """Return :func:`minimum_jerk` of each number of an array."""
    t: Array = np.minimum(np.maximum(np.asarray(x, dtype=float), 0.0), 1.0)
    eased: Array = t * t * t * (t * (6.0 * t - 15.0) + 10.0)
    return eased

"""How the avatars of each cohort choose, as kernels read it."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.crowd import Crowd


def cohort_columns(crowd: Crowd) -> list[Array]:
    """Return the columns of ``World.cohorts``. Shapes (M,)."""
    none = np.zeros(len(crowd.margins))
    return [
        crowd.margins,
        crowd.most,
        crowd.temperatures,
        crowd.hysteresis,
        crowd.intervals,
        crowd.varieties,
        crowd.defences if len(crowd.defences) else none,
        crowd.reactions if len(crowd.reactions) else none,
    ]

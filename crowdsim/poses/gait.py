"""How a body steps in its own capture, which steps made for transitions are modelled on."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array

_LONGEST, _FURTHEST = 0.5, 0.5
"""Longest time [s] and distance [m] of a single step."""
_LEAST = 12
"""Fewer steps are no sample."""
_TYPICAL = 60
"""Percentile of the speeds of planted feet that a foot may be dragged at."""


class Gait(NamedTuple):
    """What feet do in captured motion, as straight lines over the length of a step.

    Attributes:
        seconds: How long a step of no length takes [s].
        seconds_each: How much longer each metre of it takes [s/m].
        height: How high it rises [m].
        height_each: How much higher it rises for each metre [1].
        slide: Speed at which planted feet often slide [m/s].
    """

    seconds: float
    seconds_each: float
    height: float
    height_each: float
    slide: float


USUAL = Gait(0.14, 0.25, 0.024, 0.06, 0.0)


def measure_gait(contacts: Array, points: Array, starts: Array, rate: float) -> Gait:
    """Return how feet step.

    Args:
        contacts: Whether each foot is planted, over P frames. Shape (P, 2), bool.
        points: Point about which each foot rotates while it is planted, in its clip's world [m]. Shape (P, 2, 3).
        starts: First frame of each clip, and the number of frames. Shape (clips + 1,).
        rate: Frames a second.
    """
    speeds = np.linalg.norm(np.diff(points[..., [0, 2]], axis=0), axis=-1) * rate
    both = contacts[1:] & contacts[:-1]
    both[np.asarray(starts[1:-1], dtype=int) - 1] = False
    slide = float(np.percentile(speeds[both], _TYPICAL)) if both.any() else 0.0
    steps = []
    for first, stop in pairwise(np.asarray(starts, dtype=int)):
        for foot in range(2):
            planted = np.flatnonzero(contacts[first:stop, foot]) + first
            breaks = np.flatnonzero(np.diff(planted) > 1)
            for up, down in zip(planted[breaks], planted[breaks + 1], strict=True):
                way = points[up : down + 1, foot]
                far = float(np.hypot(*(way[-1] - way[0])[[0, 2]]))
                # It moves a little before it counts as being in the air, and after.
                steps.append((far, (down - up + 2) / rate, float(way[:, 1].max() - way[0, 1])))
    result = np.array(steps).reshape(-1, 3)
    result = result[(result[:, 0] < _FURTHEST) & (result[:, 1] < _LONGEST)]
    if len(result) < _LEAST:
        return USUAL._replace(slide=slide)
    # Least squares of lines that do not fall.
    apart = result[:, 0] - result[:, 0].mean()
    square = max(float(apart @ apart), 1e-9)
    each = [max(float(apart @ result[:, k]) / square, 0.0) for k in (1, 2)]
    rest = [float(np.mean(result[:, k] - e * result[:, 0])) for k, e in zip((1, 2), each, strict=True)]
    return Gait(rest[0], each[0], rest[1], each[1], slide)

"""The course of a camera around what it shows: from which side at which time, so that the least is hidden.

Directions are a grid of headings and elevations. Each has a cost at every moment; dynamic programming (Bellman, 1957)
finds the course of least total cost through them, in which the camera stays, moves on to a neighbour, or cuts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.render.crowd_path import between, hann

HEADINGS = 48
"""Headings that a camera may look in."""
_MOVE, _RISE = 0.05, 0.15
"""Cost of moving on to the next heading or elevation."""
_JUMP = 4
"""A cut changes the heading by so many steps at the least: less looks like an error."""


@dataclass(frozen=True)
class Course:
    """Directions of a camera over time; it cuts between stretches.

    Attributes:
        starts: First moment of each stretch, ascending from 0. Shape (n,).
        angles: Heading and elevation at each moment of each stretch [rad]. Length n, each (m, 2).
    """

    starts: Array
    angles: tuple[Array, ...]

    def at(self, moment: float, values: Sequence[Array] | None = None) -> Array:
        """Return heading and elevation at a moment [rad], or other values of each stretch, laid out alike."""
        index = max(int(np.searchsorted(self.starts, moment + 1e-9, side="right")) - 1, 0)
        return between((self.angles if values is None else values)[index], moment - float(self.starts[index]))


def find_course(costs: Array, elevations: Array, cuts: Array, smooth: int) -> Course:
    """Return the course of least cost.

    Args:
        costs: Cost of each heading, in even steps from 0 all around, and elevation at each moment. Shape (M, H, E).
        elevations: The elevations [rad]. Shape (E,).
        cuts: Cost of a cut before each moment, infinite where there must be none. Shape (M,).
        smooth: Moments to either side over which movement is smoothed.
    """
    moments, headings, levels = costs.shape
    best = costs[0].copy()
    came = np.zeros((moments, headings, levels), np.int64)
    numbers = np.arange(headings * levels).reshape(headings, levels)
    rows = np.arange(headings)
    apart = np.abs((rows[:, None] - rows + headings // 2) % headings - headings // 2) >= _JUMP
    for moment in range(1, moments):
        options, sources = [best], [numbers]
        for shift in (1, -1):
            options.append(np.roll(best, shift, axis=0) + _MOVE)
            sources.append(np.roll(numbers, shift, axis=0))
        for low, high in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
            moved, source = np.full_like(best, np.inf), numbers.copy()
            moved[:, high] = best[:, low] + _RISE
            source[:, high] = numbers[:, low]
            options.append(moved)
            sources.append(source)
        if np.isfinite(cuts[moment]):
            # The best state to cut from, among those that are far enough aside.
            least, level = best.min(axis=1), best.argmin(axis=1)
            reach = np.where(apart, least, np.inf)
            row = reach.argmin(axis=1)
            options.append(np.repeat((reach[rows, row] + cuts[moment])[:, None], levels, axis=1))
            sources.append(np.repeat(numbers[row, level[row]][:, None], levels, axis=1))
        choice = np.argmin(options, axis=0)
        came[moment] = np.take_along_axis(np.array(sources), choice[None], axis=0)[0]
        best = np.take_along_axis(np.array(options), choice[None], axis=0)[0] + costs[moment]
    states = np.empty(moments, np.int64)
    states[-1] = int(best.argmin())
    for moment in range(moments - 1, 0, -1):
        states[moment - 1] = came[moment].ravel()[states[moment]]
    steps = states // levels
    leaps = np.abs((np.diff(steps) + headings // 2) % headings - headings // 2) > 1
    starts = np.concatenate([[0], np.flatnonzero(leaps) + 1])
    stretches = []
    for first, stop in zip(starts, [*starts[1:], moments], strict=True):
        heading = np.unwrap(steps[first:stop] * (2.0 * math.pi / headings))
        angles = np.stack([heading, elevations[states[first:stop] % levels]], axis=1)
        stretches.append(hann(angles, smooth))
    return Course(starts, tuple(stretches))

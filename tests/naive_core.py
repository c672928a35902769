"""Slow, obvious versions of the kernels in ``crowdsim.core``."""

import math

import numpy as np
from naive_policy import surface_distance


def lands(fist, head, neck, pelvis, head_radius, torso_radius, tolerance):
    """Whether a fist lands, and by how much it does or does not [m]."""
    spare = tolerance - abs(surface_distance(np.array(fist), head, neck, pelvis, head_radius, torso_radius))
    return spare >= 0.0, abs(spare)


def locate(position, points, wraps):
    """Grid point below a position, the one above it, and the share of the latter."""
    if wraps:
        position = position % points
        below = math.floor(position) % points
        return below, (below + 1) % points, position - math.floor(position)
    position = float(np.clip(position, 0.0, points - 1))
    if points == 1:
        return 0, 0, 0.0
    below = min(math.floor(position), points - 2)
    return below, below + 1, position - below


def corner_weights(shares):
    """Weights of all corners; bit d of a corner's number says whether it is above on axis d."""
    return [
        math.prod(share if corner >> d & 1 else 1.0 - share for d, share in enumerate(shares))
        for corner in range(2 ** len(shares))
    ]


def draw_candidate(values, margin, most, temperature, number):
    """Number of the action drawn among the candidates; -1 where the best value is no finite number."""
    best = max(values)
    if not math.isfinite(best):
        return -1
    order = sorted(range(len(values)), key=lambda k: (-values[k], k))
    if temperature <= 0.0:
        return order[0]
    candidates = sorted(k for k in order[: max(int(most), 1)] if values[k] >= best - margin)
    chances = np.cumsum([math.exp((values[k] - best) / temperature) for k in candidates])
    place = int(np.searchsorted(chances, number * chances[-1], side="right"))
    return candidates[min(place, len(candidates) - 1)]

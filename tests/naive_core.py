"""Slow, obvious versions of the kernels in ``crowdsim.core``."""

import math

import numpy as np
from naive_policy import surface_distance
from scipy.spatial.transform import Rotation


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


def rotation(q):
    """The scipy rotation of a quaternion (w, x, y, z)."""
    return Rotation.from_quat(np.roll(np.asarray(q, float), -1))


def quaternion(turn):
    """The quaternion (w, x, y, z) of a scipy rotation."""
    return np.roll(turn.as_quat(), 1)


def multiply(a, b):
    return quaternion(rotation(a) * rotation(b))


def relative(old, new):
    return quaternion(rotation(new) * rotation(old).inv())


def rotate(q, vector):
    return rotation(q).apply(vector)


def unrotate(q, vector):
    return rotation(q).inv().apply(vector)


def rotate_about_y(angle, q):
    return quaternion(Rotation.from_rotvec([0.0, angle, 0.0]) * rotation(q))


def rotate_by_vector(q, vector):
    return quaternion(Rotation.from_rotvec(vector) * rotation(q))


def mix(a, b, share):
    """Mean of two quaternions, the second on the side of the first, weighted and normalised."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    b = b if a @ b >= 0.0 else -b
    between = (1.0 - share) * a + share * b
    return between / np.linalg.norm(between)


def minimum_jerk(s):
    """The polynomial of degree 5 with value, slope and curvature 0 at 0 and 1, 0, 0 at 1, by solving for it."""
    powers = np.arange(6)
    rows = []
    for x in (0.0, 1.0):
        rows.append(x**powers)
        rows.append(powers * x ** np.maximum(powers - 1, 0))
        rows.append(powers * (powers - 1) * x ** np.maximum(powers - 2, 0))
    coefficients = np.linalg.solve(np.array(rows), [0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    return float(coefficients @ np.clip(s, 0.0, 1.0) ** powers)

"""Slow, obvious versions of the leaves in ``crowdsim.core``, by scipy's rotations and polynomials of numpy."""

import numpy as np
from scipy.spatial.transform import Rotation


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

"""Slow, obvious searches for opponents and neighbours."""

import numpy as np


def nearest(x, z, team, at_x, at_z, own, own_team):
    """Nearest point of another team: squared distance in float64, then the lower number."""
    best, found = np.inf, -1
    for i in range(len(x)):
        if i == own or team[i] == own_team:
            continue
        dx, dz = x[i] - at_x, z[i] - at_z
        distance = dx * dx + dz * dz
        if distance < best:
            best, found = distance, i
    return found


def neighbours(x, z, at_x, at_z, own, reach, most):
    """The nearest points within reach, nearest first, lower numbers first."""
    near = []
    for i in range(len(x)):
        dx, dz = x[i] - at_x, z[i] - at_z
        distance = dx * dx + dz * dz
        if i != own and distance <= reach * reach:
            near.append((distance, i))
    return [i for _, i in sorted(near)[:most]]

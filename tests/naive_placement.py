"""Slow, obvious versions of what placement does."""

import numpy as np

from crowdsim.crowd.random import Purpose, uniform


def throw_darts(seed, count, radius, least, tries):
    """Place avatars one by one at the first free dart, comparing with all before; return those placed."""
    places = np.empty((0, 2))
    for avatar in range(count):
        for dart in range(tries):
            distance = radius * np.sqrt(uniform(seed, Purpose.PLACE, avatar, 2 * dart))
            angle = 2 * np.pi * uniform(seed, Purpose.PLACE, avatar, 2 * dart + 1)
            place = np.array([distance * np.sin(angle), distance * np.cos(angle)])
            if (np.hypot(*(places - place).T) >= least).all():
                places = np.vstack([places, place])
                break
        else:
            break
    return places


def least_distance(x, z):
    """Return the least distance between any two of a few points."""
    distance = np.hypot(x[:, None] - x, z[:, None] - z)
    return distance[~np.eye(len(x), dtype=bool)].min()

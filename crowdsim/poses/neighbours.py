"""Avatars that are near others."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData

TOUCH = 3.1
"""Distance on the ground beyond which no two avatars touch [m]."""
_FEW = 64
"""So many avatars are not looked through."""


def near_avatars(take: TakeData, avatars: Array, first: int, stop: int) -> Array:
    """Return these avatars (n,) and all that are near one at any of control frames ``first`` to ``stop``, ascending.

    There may be others among them.
    """
    if len(avatars) == take.avatar_count or take.avatar_count <= _FEW:
        return np.arange(take.avatar_count)
    places = np.stack([np.asarray(values[first:stop], dtype=float) for values in (take.x, take.z)], -1)
    places[np.asarray(take.action[first:stop]) < 0] = np.nan
    near = np.zeros(take.avatar_count, bool)
    near[avatars] = True
    for now in places:
        own = now[avatars[np.isfinite(now[avatars, 0])]]
        if not len(own):
            continue
        low, high = own.min(axis=0) - TOUCH, own.max(axis=0) + TOUCH
        others = np.flatnonzero(~near & (now >= low).all(axis=1) & (now <= high).all(axis=1))
        if len(others):
            near[others] = np.isfinite(cKDTree(own).query(now[others], distance_upper_bound=TOUCH)[0])
    return np.flatnonzero(near)


def tiles(take: TakeData, avatars: Array, frame: int, most: int) -> list[Array]:
    """Return avatars (n,), ascending, in groups of about ``most`` that are near one another at a control frame."""
    count = -(-len(avatars) // most)
    if count <= 1:
        return [avatars]
    strips = int(np.ceil(np.sqrt(count)))
    x, z = (np.asarray(values[frame], dtype=float)[avatars] for values in (take.x, take.z))
    found = []
    for strip in np.array_split(avatars[np.argsort(x, kind="stable")], strips):
        along = z[np.searchsorted(avatars, strip)]
        pieces = np.array_split(strip[np.argsort(along, kind="stable")], -(-count // strips))
        found += [np.sort(piece) for piece in pieces if len(piece)]
    return found

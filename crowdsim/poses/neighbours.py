"""Avatars that are near others."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.poses.smoothing import widen

TOUCH = 3.1
"""Distance on the ground beyond which no two avatars touch [m]."""
_MOST_CELLS = 2000
"""Most cells of the grid that avatars are looked for in, along either axis."""
_FEW = 64
"""So many avatars are not looked through."""


def near_avatars(take: TakeData, avatars: Array, first: int, stop: int) -> Array:
    """Return these avatars (n,) and all that are near one about control frames ``first`` to ``stop``, ascending.

    There may be others among them.
    """
    if len(avatars) == take.avatar_count or take.avatar_count <= _FEW:
        return np.arange(take.avatar_count)
    there = np.asarray(take.action[first:stop]) >= 0
    x, z = (np.asarray(values[first:stop]) for values in (take.x, take.z))
    own_x, own_z = x[:, avatars], z[:, avatars]
    here = there[:, avatars] & np.isfinite(own_x)
    near = np.zeros(take.avatar_count, bool)
    near[avatars] = True
    if here.any():
        places = np.stack([own_x[here], own_z[here]])
        low, high = places.min(axis=1) - TOUCH, places.max(axis=1) + TOUCH
        # Comparisons with what is no number fail.
        for values, least, most in zip((x, z), low, high, strict=True):
            there &= values >= least
            there &= values <= most
        others = np.flatnonzero(there.any(axis=0) & ~near)
        inside = there[:, others]
        cell = max(TOUCH / 3.0, float((high - low).max()) / _MOST_CELLS)
        cells = np.zeros(((high - low) / cell).astype(int) + 1, bool)
        cells[tuple(((places - low[:, None]) / cell).astype(int))] = True
        cells = widen(cells, int(np.ceil(TOUCH / cell)))
        found = np.zeros(inside.shape, bool)
        around = np.stack([x[:, others][inside], z[:, others][inside]])
        found[inside] = cells[tuple(((around - low[:, None]) / cell).astype(int))]
        near[others] = found.any(axis=0)
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

"""Indices of nearest opponents and neighbours; avatars are stored in the order of the index.

Every index gives the same answers: the nearest opponent by squared distance in float64, the lower number among
equals, and the neighbours within reach. ``kd_tree`` is what ``auto`` takes for crowds that are too large for a direct
comparison; ``scipy`` finds opponents by scipy's tree, for comparison, and neighbours by ours.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import BY_SLOT, Avatars, positions_of
from crowdsim.crowd.kd_tree import SERIAL, fit_tree, plan_tree, sort_tree
from crowdsim.crowd.kernels.kd_queries import observe
from crowdsim.crowd.kernels.kd_tree import Tree
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.workers import Workers
from crowdsim.scenario.groups import SEARCHES

SORT_EVERY = 16
"""Frames after which avatars may be brought into the order of a newly built tree; between, it is only refitted."""

GROWN = 1.2
"""How much longer the sides of the leaves' boxes must have become for that, since a crowd that fights hardly moves."""


class Index(Protocol):
    """The interface of an index."""

    def update(self, avatars: Avatars, present: int) -> None:
        """Read the positions of the first ``present`` slots; sort their storage when it is due."""

    def observe(self, avatars: Avatars, due: Array, reach: float, out: Observed) -> None:
        """Write the nearest opponent's slot, and the slots of neighbours, for each slot of ``due``, which ascend."""

    def fitted(self) -> Tree:
        """Return a tree over the avatars that is fitted to where they are now."""

    def reset(self) -> None:
        """Forget the order, since other avatars are present, or they fight otherwise."""


class TreeIndex:
    """A KD-tree over the avatars' own arrays, which it keeps sorted.

    Args:
        workers: Threads for building and fitting.
        sort_every: Least frames between sorting the storage.
    """

    def __init__(self, workers: Workers, sort_every: int = SORT_EVERY) -> None:
        self._workers = workers
        self._sort_every = sort_every
        self._tree: Tree | None = None
        self._age = 0
        self._extent = 0.0

    @property
    def nbytes(self) -> int:
        """Memory of the tree's boxes."""
        return 0 if self._tree is None else self._tree.boxes.nbytes + self._tree.box_teams.nbytes

    def reset(self) -> None:
        """Forget the order, since other avatars are present, or they fight otherwise."""
        self._tree = None

    def update(self, avatars: Avatars, present: int) -> None:
        """Read the positions of the first ``present`` slots; sort their storage when it is due."""
        if self._tree is None:
            self._tree = plan_tree(
                avatars.x[:present], avatars.z[:present], avatars.number[:present], avatars.team[:present]
            )
            self._age, self._extent = self._sort_every, 0.0
        if self._age >= self._sort_every and self._extents() > GROWN * self._extent:
            copy = self._tree._replace(xs=avatars.x[:present].copy(), zs=avatars.z[:present].copy())
            store_in_order(avatars, sort_tree(copy, self._workers), self._workers)
            fit_tree(self._tree, self._workers)
            self._age, self._extent = 0, self._extents()
        else:
            fit_tree(self._tree, self._workers)
        self._age += 1

    def fitted(self) -> Tree:
        """Return a tree over the avatars that is fitted to where they are now."""
        assert self._tree is not None
        fit_tree(self._tree, self._workers)
        return self._tree

    def _extents(self) -> float:
        """Return the length of all sides of the leaves' boxes; that of a tree which is not fitted yet has no end."""
        assert self._tree is not None
        boxes = self._tree.boxes[1 << self._tree.depth :]
        return sides_of(boxes)

    def observe(self, avatars: Avatars, due: Array, reach: float, out: Observed) -> None:
        """Write the nearest opponent's slot, and the slots of neighbours, for each slot of ``due``, which ascend."""
        assert self._tree is not None
        observe(self._tree, due, avatars.skip, avatars.opponent, avatars.slot_of, reach, out)


class ScipyIndex(TreeIndex):
    """scipy's KDTree for the opponents: one over everyone, and one over all others for each team."""

    def update(self, avatars: Avatars, present: int) -> None:
        """Read the positions of the first ``present`` slots."""
        from scipy.spatial import cKDTree

        super().update(avatars, present)
        points = positions_of(avatars, slice(present))
        self._trees = {}
        for skip in np.unique(avatars.skip[:present]):
            if skip > -2:
                team = avatars.team[:present]
                slots = np.flatnonzero((team != skip) & (team >= 0))
                self._trees[int(skip)] = (slots, cKDTree(points[slots]) if len(slots) else None)

    def observe(self, avatars: Avatars, due: Array, reach: float, out: Observed) -> None:
        """Write the nearest opponent's slot, and the slots of neighbours, for each slot of ``due``, which ascend."""
        skip_none = np.full(len(avatars.x), -2, np.int16)
        assert self._tree is not None
        observe(self._tree, due, skip_none, avatars.opponent, avatars.slot_of, reach, out)
        for skip, (slots, tree) in self._trees.items():
            rows = np.flatnonzero(avatars.skip[due] == skip)
            if tree is None or len(rows) == 0:
                continue
            own = due[rows]
            points = positions_of(avatars, own)
            distances, _ = tree.query(points, k=min(2, len(slots)))
            nearest = distances.reshape(len(own), -1)[:, -1 if skip == -1 else 0]
            near = tree.query_ball_point(points, np.where(np.isfinite(nearest), nearest * (1 + 1e-9) + 1e-12, 0.0))
            for row, slot, found in zip(rows, own, near, strict=True):
                candidates = slots[found]
                candidates = candidates[candidates != slot]
                if len(candidates):
                    dx, dz = (positions_of(avatars, candidates) - positions_of(avatars, slot)).T
                    best = np.lexsort((avatars.number[candidates], dx * dx + dz * dz))[0]
                    out.opponents[row] = candidates[best]


def sides_of(boxes: Array) -> float:
    """Return the length of all sides of some boxes (n, 4) [m]."""
    sides = np.diff(boxes.astype(float), axis=1)[:, ::2]
    return float(np.abs(sides).sum())


def build_index(search: str, workers: Workers, sort_every: int = SORT_EVERY) -> Index:
    """Return an index by its name, one of ``SEARCHES``."""
    if search in ("auto", "kd_tree"):
        return TreeIndex(workers, sort_every)
    if search == "scipy":
        return ScipyIndex(workers, sort_every)
    raise ValueError(f"search is {search!r}, expected one of {', '.join(SEARCHES)}")


def store_in_order(avatars: Avatars, order: Array, workers: Workers = SERIAL) -> None:
    """Bring the first slots into another order; ``order`` is where each slot's avatar is now. Shape (n,)."""
    count = len(order)
    # As plain bytes: numpy copies records field by field. The largest come first, so that threads end together.
    arrays = [getattr(avatars, name) for name in BY_SLOT]
    stored = [values[:count].view(f"V{values.itemsize}") for values in arrays if len(values)]
    stored.sort(key=lambda values: -values.itemsize)

    def bring(first: int, last: int) -> None:
        for values in stored[first:last]:
            values[:] = values.take(order)

    workers.each(bring, len(stored), grain=1)
    avatars.slot_of[avatars.number[:count]] = np.arange(count, dtype=np.int32)

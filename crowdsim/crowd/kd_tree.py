"""KD-trees over where avatars stand: one tree a block (a team, or everyone), built rarely and refitted every frame.

Building sorts the points into the order of the leaves. When avatars have moved a little, the order is kept and only the
boxes around the leaves are fitted anew: a pass over memory in order, and every query stays exact, because it trusts
nothing but the boxes. A block of up to ``LEAF`` points is one leaf, which is a direct comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdsim.crowd.kd_tree_kernels import fit_leaves, fit_nodes, query_nearest, query_neighbours, sort_points
from crowdsim.crowd.workers import Workers

Array = NDArray[Any]

LEAF = 32
"""Most points in a leaf."""

_SERIAL = Workers(1)


@dataclass(frozen=True)
class Forest:
    """KD-trees over N points, in the order of their leaves, block after block.

    Attributes:
        xs: Places across [m]. Shape (N,), float64.
        zs: Places ahead [m]. Shape (N,), float64.
        number: What decides between points at one distance: the lower one wins. Shape (N,), int32.
        team: Team of each point, 0 or greater. Shape (N,), int32.
        starts: First point of each block, and N. Shape (B + 1,), int64.
        depths: Levels below the root of each block's tree. Shape (B,), int64.
        nodes: Where each block's nodes begin in ``boxes``. Shape (B,), int64.
        boxes: Least x, greatest x, least z, greatest z of each node [m]. Shape (M, 4), float64.
        box_teams: The only team in each node, or -1 where teams mix. Shape (M,), int32.
    """

    xs: Array
    zs: Array
    number: Array
    team: Array
    starts: Array
    depths: Array
    nodes: Array
    boxes: Array
    box_teams: Array


def plan_forest(xs: Array, zs: Array, number: Array, team: Array, counts: ArrayLike) -> Forest:
    """Return a forest over the given arrays, which it uses as they are, with blocks of ``counts`` points.

    The arrays are in any order yet: ``sort_forest`` and ``fit_forest`` come next.
    """
    sizes = np.asarray(counts, np.int64)
    if sizes.sum() != len(xs):
        raise ValueError(f"blocks hold {sizes.sum()} points, expected {len(xs)}")
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    depths = np.array([_depth(int(size)) for size in sizes], np.int64)
    widths = 2 << depths
    nodes = np.concatenate([[0], np.cumsum(widths)[:-1]]).astype(np.int64)
    total = int(widths.sum())
    boxes = np.empty((total, 4))
    boxes[:, 0::2], boxes[:, 1::2] = np.inf, -np.inf
    return Forest(xs, zs, number, team, starts, depths, nodes, boxes, np.full(total, -1, np.int32))


def sort_forest(forest: Forest, workers: Workers = _SERIAL) -> Array:
    """Sort each block's ``xs`` and ``zs`` in place into the order of its leaves; return the order. Shape (N,), int32.

    ``number`` and ``team`` are not touched: the caller brings them, and all else that it keeps, into the same order.
    """
    order = np.arange(len(forest.xs), dtype=np.int32)
    for block in range(len(forest.depths)):
        start, count = int(forest.starts[block]), int(forest.starts[block + 1] - forest.starts[block])
        depth = int(forest.depths[block])
        shared = min(depth, 4) if workers.threads > 1 and count > 20_000 else 0
        sort_points(forest.xs, forest.zs, order, start, count, depth, 1, shared)

        def below(
            first: int, last: int, start: int = start, count: int = count, depth: int = depth, tops: int = 1 << shared
        ) -> None:
            for top in range(tops + first, tops + last):
                sort_points(forest.xs, forest.zs, order, start, count, depth, top, depth)

        workers.each(below, 1 << shared, grain=1)
    return order


def fit_forest(forest: Forest, workers: Workers = _SERIAL) -> None:
    """Fit all boxes to where the points are now."""
    for block in range(len(forest.depths)):
        start, count = int(forest.starts[block]), int(forest.starts[block + 1] - forest.starts[block])
        depth, node = int(forest.depths[block]), int(forest.nodes[block])
        if count == 0:
            continue

        def fit(
            first: int, last: int, start: int = start, count: int = count, depth: int = depth, node: int = node
        ) -> None:
            fit_leaves(
                forest.xs, forest.zs, forest.team, start, count, depth, node, first, last, forest.boxes,
                forest.box_teams,
            )  # fmt: skip

        workers.each(fit, 1 << depth, grain=256)
        fit_nodes(depth, node, forest.boxes, forest.box_teams)


def build_forest(x: ArrayLike, z: ArrayLike, team: ArrayLike | None = None, split: bool = True) -> tuple[Forest, Array]:
    """Return a forest over copies of points, and the order of its leaves.

    Args:
        x: Places across [m]. Shape (N,).
        z: Places ahead [m]. Shape (N,).
        team: Team of each point, 0 or greater; without it everyone is a team of one's own. Shape (N,).
        split: One tree a team; otherwise one tree of everyone.

    Returns:
        The forest, in which a point's ``number`` is its index here, and the index of each of its points. Shape (N,).

    Raises:
        ValueError: Shapes differ, or a place is not finite (with the point's index).
    """
    xs, zs = np.array(x, dtype=float), np.array(z, dtype=float)
    teams = np.arange(len(xs), dtype=np.int32) if team is None else np.asarray(team, np.int32)
    if xs.ndim != 1 or xs.shape != zs.shape or teams.shape != xs.shape:
        raise ValueError(f"x {xs.shape}, z {zs.shape} and team {teams.shape} differ in shape, expected (N,)")
    bad = np.flatnonzero(~np.isfinite(xs) | ~np.isfinite(zs))
    if len(bad):
        raise ValueError(f"point {bad[0]} is at ({xs[bad[0]]}, {zs[bad[0]]}), expected finite places")
    if split and team is not None:
        first = np.argsort(teams, kind="stable").astype(np.int32)
        counts = np.unique(teams, return_counts=True)[1]
    else:
        first, counts = np.arange(len(xs), dtype=np.int32), np.array([len(xs)])
    unsorted = plan_forest(xs[first], zs[first], first, teams[first], counts if len(xs) else [0])
    order = first[sort_forest(unsorted)]
    forest = Forest(**{**vars(unsorted), "number": order, "team": teams[order]})
    fit_forest(forest)
    return forest, order


def nearest(
    forest: Forest,
    x: Array,
    z: Array,
    own: Array,
    own_team: Array,
    guess: Array | None = None,
    workers: Workers = _SERIAL,
) -> tuple[Array, Array]:
    """Return the nearest point of another team, and its squared distance, for each query.

    Args:
        forest: The fitted forest.
        x: Places across [m]. Shape (Q,).
        z: Places ahead [m]. Shape (Q,).
        own: Point of the forest that a query skips, -1 for none. Shape (Q,), int32.
        own_team: Team that a query skips, -1 for none. Shape (Q,), int32.
        guess: Point that bounds the search from the start, -1 for none; it changes no result. Shape (Q,), int32.
        workers: Threads to share the queries.

    Returns:
        Points in the forest's order, -1 where none is left, and squared distances [m^2]. Shapes (Q,).
    """
    found, distance = np.empty(len(x), np.int32), np.empty(len(x))
    guesses = np.full(len(x), -1, np.int32) if guess is None else guess

    def query(first: int, last: int) -> None:
        query_nearest(
            forest.xs, forest.zs, forest.number, forest.team, forest.starts, forest.depths, forest.nodes, forest.boxes,
            forest.box_teams, x, z, own, own_team, guesses, first, last, found, distance,
        )  # fmt: skip

    workers.each(query, len(x))
    return found, distance


def neighbours(
    forest: Forest, x: Array, z: Array, own: Array, reach: float, most: int, workers: Workers = _SERIAL
) -> tuple[Array, Array]:
    """Return how many points lie within ``reach`` [m] of each query, and the nearest ``most`` of them.

    Returns:
        Counts, shape (Q,), int32, and points in the forest's order, nearest first, lower numbers first among equals;
        what lies behind a row's count is undefined. Shape (Q, most), int32.
    """
    counts, points = np.empty(len(x), np.int32), np.empty((len(x), most), np.int32)

    def query(first: int, last: int) -> None:
        query_neighbours(
            forest.xs, forest.zs, forest.number, forest.starts, forest.depths, forest.nodes, forest.boxes,
            x, z, own, reach, first, last, counts, points, np.empty(most),
        )  # fmt: skip

    workers.each(query, len(x))
    return counts, points


def _depth(count: int) -> int:
    depth = 0
    while (count >> depth) > LEAF or (count & ((1 << depth) - 1) and (count >> depth) >= LEAF):
        depth += 1
    return depth

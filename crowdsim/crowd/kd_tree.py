"""A KD-tree over the positions of avatars, built rarely and refitted every frame.

Building sorts the points into the order of the leaves. When avatars have moved a little, the order is kept and only the
boxes around the leaves are fitted anew: a pass over memory in order, and every query stays exact, because it trusts
nothing but the boxes. Up to ``LEAF`` points are one leaf, which is a direct comparison. Teams share the tree, whose
nodes know where all below are of one team: a tree for each made neighbours, who are of any team, dearer to find than
it made opponents cheaper.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.kd_queries import Query, query_nearest, query_neighbours
from crowdsim.crowd.kernels.kd_tree import Tree, fit_leaves, fit_nodes, sort_points
from crowdsim.crowd.workers import Workers

LEAF = 32
"""Most points in a leaf."""

SERIAL = Workers(1)


def plan_tree(xs: Array, zs: Array, number: Array, team: Array) -> Tree:
    """Return a tree over the given arrays, which it uses as they are.

    They are in any order yet: ``sort_tree`` and ``fit_tree`` come next.
    """
    depth = _depth(len(xs))
    boxes = np.empty((2 << depth, 4), xs.dtype)
    boxes[:, 0::2], boxes[:, 1::2] = np.inf, -np.inf
    return Tree(xs, zs, number, team, depth, boxes, np.full(len(boxes), -1, np.int32))


def sort_tree(tree: Tree, workers: Workers = SERIAL) -> Array:
    """Sort ``xs`` and ``zs`` in place into the order of the leaves; return the order. Shape (N,), int32.

    ``number`` and ``team`` are not touched: the caller brings them, and all else that it keeps, into the same order.
    """
    count = len(tree.xs)
    order = np.arange(count, dtype=np.int32)
    shared = min(tree.depth, 4) if workers.threads > 1 and count > 20_000 else 0
    sort_points(tree.xs, tree.zs, order, tree.depth, 1, shared)
    tops = 1 << shared

    def below(first: int, last: int) -> None:
        for top in range(tops + first, tops + last):
            sort_points(tree.xs, tree.zs, order, tree.depth, top, tree.depth)

    workers.each(below, tops, grain=1)
    return order


def fit_tree(tree: Tree, workers: Workers = SERIAL) -> None:
    """Fit all boxes to where the points are now."""
    if len(tree.xs) == 0:
        return
    workers.each(lambda first, last: fit_leaves(tree, first, last), 1 << tree.depth, grain=256)
    fit_nodes(tree)


def build_tree(
    x: ArrayLike, z: ArrayLike, team: ArrayLike | None = None, workers: Workers = SERIAL
) -> tuple[Tree, Array]:
    """Return a tree over copies of points, and the order of its leaves.

    Args:
        x: Positions across [m]. Shape (N,).
        z: Positions ahead [m]. Shape (N,).
        team: Team of each point, 0 or greater; without it everyone is a team of one's own. Shape (N,).
        workers: Threads to build it.

    Returns:
        The tree, in which a point's ``number`` is its index here, and the index of each of its points. Shape (N,).

    Raises:
        ValueError: Shapes differ, or a position is not finite (with the point's index).
    """
    xs, zs = np.array(x, dtype=float), np.array(z, dtype=float)
    teams = np.arange(len(xs), dtype=np.int32) if team is None else np.asarray(team, np.int32)
    if xs.ndim != 1 or xs.shape != zs.shape or teams.shape != xs.shape:
        raise ValueError(f"x {xs.shape}, z {zs.shape} and team {teams.shape} differ in shape, expected (N,)")
    bad = np.flatnonzero(~np.isfinite(xs) | ~np.isfinite(zs))
    if len(bad):
        raise ValueError(f"point {bad[0]} is at ({xs[bad[0]]}, {zs[bad[0]]}), expected finite positions")
    order = sort_tree(plan_tree(xs, zs, np.arange(len(xs), dtype=np.int32), teams), workers)
    tree = plan_tree(xs, zs, order, teams[order])
    fit_tree(tree, workers)
    return tree, order


def nearest(
    tree: Tree, x: Array, z: Array, own: Array, own_team: Array, workers: Workers = SERIAL
) -> tuple[Array, Array]:
    """Return the nearest point of another team, and its squared distance, for each query.

    Args:
        tree: The fitted tree.
        x: Positions across [m]. Shape (Q,).
        z: Positions ahead [m]. Shape (Q,).
        own: Point of the tree that a query skips, -1 for none. Shape (Q,), int32.
        own_team: Team that a query skips, -1 for none. Shape (Q,), int32.
        workers: Threads to share the queries.

    Returns:
        Points in the tree's order, -1 where none is left, and squared distances [m^2]. Shapes (Q,).
    """
    found, distance = np.empty(len(x), np.int32), np.empty(len(x))

    queries = Query(x, z, own, own_team)
    workers.each(lambda first, last: query_nearest(tree, queries, first, last, found, distance), len(x))
    return found, distance


def neighbours(
    tree: Tree, x: Array, z: Array, own: Array, reach: float, most: int, workers: Workers = SERIAL
) -> tuple[Array, Array]:
    """Return the number of points within ``reach`` [m] of each query, and the nearest ``most`` of them.

    Returns:
        Counts, shape (Q,), int32, and points in the tree's order, nearest first, lower numbers first among equals;
        entries behind a row's count are undefined. Shape (Q, most), int32.
    """
    counts, points = np.empty(len(x), np.int32), np.empty((len(x), most), np.int32)

    queries = Query(x, z, own, np.full(len(x), -1, np.int32))
    workers.each(lambda first, last: query_neighbours(tree, queries, reach, first, last, counts, points), len(x))
    return counts, points


def _depth(count: int) -> int:
    depth = 0
    while (count >> depth) > LEAF or (count & ((1 << depth) - 1) and (count >> depth) >= LEAF):
        depth += 1
    return depth

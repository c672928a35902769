"""Compiled 2-D KD-tree: a balanced tree over avatars, whose points lie in the order of its leaves.

Leaf i of ``1 << depth`` holds the points ``i * N >> depth`` to ``(i + 1) * N >> depth``, so that no ranges are stored.
Nodes are numbered as in a heap: the root is 1, the children of k are 2 k and 2 k + 1; ``boxes[k]`` holds least x,
greatest x, least z and greatest z. A box's computed squared distance never exceeds that of a point in it, because
rounding is monotonic: pruning with ``>`` therefore loses no candidate at the best distance.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel


class Tree(NamedTuple):
    """A KD-tree over N points, in the order of its leaves.

    Attributes:
        xs: Positions across [m], those of avatars in single precision. Shape (N,).
        zs: Positions ahead [m]. Likewise.
        number: What decides between points at one distance: the lower one wins. Shape (N,), int32.
        team: Team of each point, 0 or greater. Shape (N,).
        depth: Levels below the root.
        boxes: Least x, greatest x, least z, greatest z of each node [m]. Shape (2 << depth, 4), as positions are.
        box_teams: The only team in each node, or -1 where teams mix. Shape (2 << depth,), int32.
    """

    xs: Any
    zs: Any
    number: Any
    team: Any
    depth: int
    boxes: Any
    box_teams: Any


@kernel
def _select(keys, others, order, low, high, middle):
    """Put the ``middle``-th smallest of ``keys[low:high]`` in its place, smaller ones before it (Hoare's selection)."""
    left, right = low, high - 1
    while left < right:
        a, b, c = keys[left], keys[(left + right) >> 1], keys[right]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = left, right
        while i <= j:
            while keys[i] < pivot:
                i += 1
            while keys[j] > pivot:
                j -= 1
            if i <= j:
                keys[i], keys[j] = keys[j], keys[i]
                others[i], others[j] = others[j], others[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@kernel(allocates=True)
def sort_points(xs, zs, order, depth, top, bottom):
    """Bring the points below node ``top`` into the order of leaves, down to nodes of level ``bottom``.

    ``xs``, ``zs`` and ``order`` are moved together; each node splits at its median across the longer side of its box.
    """
    count = xs.shape[0]
    stack = np.empty(64, np.int64)
    stack[0] = top
    held = 1
    while held > 0:
        held -= 1
        node = stack[held]
        level = 0
        while (node >> (level + 1)) > 0:
            level += 1
        if level >= bottom or level >= depth:
            continue
        place = node - (1 << level)
        low = (place * count) >> level
        high = ((place + 1) * count) >> level
        middle = ((2 * place + 1) * count) >> (level + 1)
        x_low, x_high, z_low, z_high = math.inf, -math.inf, math.inf, -math.inf
        for i in range(low, high):
            x_low, x_high = min(x_low, xs[i]), max(x_high, xs[i])
            z_low, z_high = min(z_low, zs[i]), max(z_high, zs[i])
        if x_high - x_low >= z_high - z_low:
            _select(xs, zs, order, low, high, middle)
        else:
            _select(zs, xs, order, low, high, middle)
        stack[held] = 2 * node + 1
        stack[held + 1] = 2 * node
        held += 2


@kernel
def fit_leaves(tree, first, last):
    """Bound leaves ``first`` to ``last`` by their points, and note their only teams."""
    xs, zs, team, depth = tree.xs, tree.zs, tree.team, tree.depth
    count = xs.shape[0]
    for leaf in range(first, last):
        low = (leaf * count) >> depth
        high = ((leaf + 1) * count) >> depth
        x_low, x_high, z_low, z_high = math.inf, -math.inf, math.inf, -math.inf
        only = team[low] if high > low else -1
        for i in range(low, high):
            x_low, x_high = min(x_low, xs[i]), max(x_high, xs[i])
            z_low, z_high = min(z_low, zs[i]), max(z_high, zs[i])
            if team[i] != only:
                only = -1
        node = (1 << depth) + leaf
        tree.boxes[node, 0], tree.boxes[node, 1] = x_low, x_high
        tree.boxes[node, 2], tree.boxes[node, 3] = z_low, z_high
        tree.box_teams[node] = only


@kernel
def fit_nodes(tree):
    """Bound every inner node by its two children, leaves first."""
    for node in range((1 << tree.depth) - 1, 0, -1):
        fit_node(tree, node)


@kernel(inline=True)
def fit_node(tree, node):
    """Bound an inner node by its two children."""
    boxes, teams = tree.boxes, tree.box_teams
    a, b = 2 * node, 2 * node + 1
    boxes[node, 0] = min(boxes[a, 0], boxes[b, 0])
    boxes[node, 1] = max(boxes[a, 1], boxes[b, 1])
    boxes[node, 2] = min(boxes[a, 2], boxes[b, 2])
    boxes[node, 3] = max(boxes[a, 3], boxes[b, 3])
    teams[node] = teams[a] if teams[a] == teams[b] else -1


@kernel
def widen(tree, i):
    """Widen the boxes above point ``i``, which has moved, until it is in them."""
    x, z, boxes = tree.xs[i], tree.zs[i], tree.boxes
    node = (1 << tree.depth) + (((i + 1) << tree.depth) - 1) // tree.xs.shape[0]
    while node > 0:
        boxes[node, 0], boxes[node, 1] = min(boxes[node, 0], x), max(boxes[node, 1], x)
        boxes[node, 2], boxes[node, 3] = min(boxes[node, 2], z), max(boxes[node, 3], z)
        node >>= 1


@kernel(allocates=True)
def everyone(avatars, present):
    """Return a tree of one leaf, in which avatars are found by comparing with everyone, wherever these are."""
    boxes = np.empty((2, 4), np.float32)
    boxes[:, 0::2], boxes[:, 1::2] = -math.inf, math.inf
    xs, zs, number, team = avatars.x[:present], avatars.z[:present], avatars.number[:present], avatars.team[:present]
    return Tree(xs, zs, number, team, 0, boxes, np.full(2, -1, np.int32))

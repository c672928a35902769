"""Compiled 2-D KD-tree: a balanced tree over avatars, whose points lie in the order of its leaves.

Leaf i of ``1 << depth`` holds the points ``i * N >> depth`` to ``(i + 1) * N >> depth``, so that no ranges are stored.
Nodes are numbered as in a heap: the root is 1, the children of k are 2 k and 2 k + 1; ``boxes[k]`` holds least x,
greatest x, least z and greatest z. A box's computed squared distance never exceeds that of a point in it, because
rounding is monotonic: pruning with ``>`` therefore loses no candidate at the best distance.
"""

import math

import numpy as np

from crowdsim.jit import kernel

# Kernels that allocate nothing do without numba's counting of references, which would cost more than their work.
_kernel = kernel(allocates=False)

ABOVE = 3  # levels up from a leaf to the node whose leaves share a list of the leaves around them


@_kernel
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


@kernel
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


@_kernel
def fit_leaves(xs, zs, team, depth, first, last, out_boxes, out_teams):
    """Bound leaves ``first`` to ``last`` by their points; ``out_teams`` is a leaf's only team, or -1 where they mix."""
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
        out_boxes[node, 0], out_boxes[node, 1] = x_low, x_high
        out_boxes[node, 2], out_boxes[node, 3] = z_low, z_high
        out_teams[node] = only


@_kernel
def fit_nodes(depth, out_boxes, out_teams):
    """Bound every inner node by its two children, leaves first."""
    for node in range((1 << depth) - 1, 0, -1):
        a, b = 2 * node, 2 * node + 1
        out_boxes[node, 0] = min(out_boxes[a, 0], out_boxes[b, 0])
        out_boxes[node, 1] = max(out_boxes[a, 1], out_boxes[b, 1])
        out_boxes[node, 2] = min(out_boxes[a, 2], out_boxes[b, 2])
        out_boxes[node, 3] = max(out_boxes[a, 3], out_boxes[b, 3])
        out_teams[node] = out_teams[a] if out_teams[a] == out_teams[b] else -1


@_kernel
def _box_distance(boxes, node, x, z):
    """Squared distance from a point to a box; 0 inside."""
    dx = max(max(boxes[node, 0] - x, x - boxes[node, 1]), 0.0)
    dz = max(max(boxes[node, 2] - z, z - boxes[node, 3]), 0.0)
    return dx * dx + dz * dz


@_kernel
def _nearest(xs, zs, number, team, depth, boxes, box_teams, x, z, own, own_team, best, found, stack, far):
    """Return the nearest point that is neither ``own`` nor of ``own_team``, or the one found before."""
    count = xs.shape[0]
    root = _box_distance(boxes, 1, x, z)
    if count == 0 or root > best or (own_team >= 0 and box_teams[1] == own_team):
        return best, found
    leaves = 1 << depth
    stack[0] = 1
    far[0] = root
    held = 1
    while held > 0:
        held -= 1
        node = stack[held]
        if far[held] > best:
            continue
        while node < leaves:
            a = 2 * node
            da, db = _box_distance(boxes, a, x, z), _box_distance(boxes, a + 1, x, z)
            if own_team >= 0:
                if box_teams[a] == own_team:
                    da = math.inf
                if box_teams[a + 1] == own_team:
                    db = math.inf
            near, near_distance, other, other_distance = a, da, a + 1, db
            if db < da:
                near, near_distance, other, other_distance = a + 1, db, a, da
            if other_distance <= best and other_distance < math.inf:
                stack[held] = other
                far[held] = other_distance
                held += 1
            if near_distance > best or near_distance == math.inf:
                node = 0
                break
            node = near
        if node == 0:
            continue
        leaf = node - leaves
        for i in range((leaf * count) >> depth, ((leaf + 1) * count) >> depth):
            dx, dz = xs[i] - x, zs[i] - z
            distance = dx * dx + dz * dz
            if (
                distance <= best
                and i != own
                and team[i] != own_team
                and (distance < best or found < 0 or number[i] < number[found])
            ):
                best = distance
                found = i
    return best, found


@_kernel
def _insert(number, i, distance, held_now, out_points, out_distances):
    """Put point i in its place in the sorted list, if it belongs there; return the list's new length."""
    room = out_points.shape[0]
    k = held_now
    if held_now == room:
        k = room - 1
        if distance > out_distances[k] or (distance == out_distances[k] and number[i] > number[out_points[k]]):
            return held_now
    else:
        held_now += 1
    while k > 0 and (
        distance < out_distances[k - 1] or (distance == out_distances[k - 1] and number[i] < number[out_points[k - 1]])
    ):
        out_points[k] = out_points[k - 1]
        out_distances[k] = out_distances[k - 1]
        k -= 1
    out_points[k] = i
    out_distances[k] = distance
    return held_now


@_kernel
def _gather(
    xs, zs, number, depth, boxes, x, z, own, reach, out_points, out_distances, stack
):  # fmt: skip
    """List the nearest points within ``reach`` (squared), nearest first; return how many."""
    count = xs.shape[0]
    held_now = 0
    room = out_points.shape[0]
    leaves = 1 << depth
    stack[0] = 1
    held = 1 if count > 0 else 0
    while held > 0:
        held -= 1
        node = stack[held]
        limit = reach if held_now < room else out_distances[room - 1]
        if _box_distance(boxes, node, x, z) > limit:
            continue
        if node < leaves:
            stack[held] = 2 * node + 1
            stack[held + 1] = 2 * node
            held += 2
            continue
        leaf = node - leaves
        for i in range((leaf * count) >> depth, ((leaf + 1) * count) >> depth):
            dx, dz = xs[i] - x, zs[i] - z
            distance = dx * dx + dz * dz
            if distance > limit or i == own:
                continue
            held_now = _insert(number, i, distance, held_now, out_points, out_distances)
            if held_now == room:
                limit = out_distances[room - 1]
    return held_now


@kernel
def query_nearest(
    xs, zs, number, team, depth, boxes, box_teams, at_x, at_z, at_own, at_team, first, last, out_found, out_distance
):
    """Find the nearest point of another team for queries ``first`` to ``last``.

    A query is a place, the point that it skips (-1 for none) and the team that it skips (-1 for none). ``out_found`` is
    -1 where no point is left.
    """
    stack = np.empty(64, np.int64)
    far = np.empty(64)
    for q in range(first, last):
        out_distance[q], out_found[q] = _nearest(
            xs, zs, number, team, depth, boxes, box_teams, at_x[q], at_z[q], at_own[q], at_team[q], math.inf, -1,
            stack, far,
        )  # fmt: skip


@kernel
def query_neighbours(
    xs, zs, number, depth, boxes, at_x, at_z, at_own, reach, first, last, out_counts, out_points, out_distances
):
    """List the nearest points within ``reach`` for queries ``first`` to ``last``, nearest first, lower numbers first.

    As many as ``out_points`` (Q, K) has room for; ``out_distances`` (K,) is scratch space.
    """
    stack = np.empty(64, np.int64)
    for q in range(first, last):
        out_counts[q] = _gather(
            xs,
            zs,
            number,
            depth,
            boxes,
            at_x[q],
            at_z[q],
            at_own[q],
            reach * reach,
            out_points[q],
            out_distances,
            stack,
        )


@_kernel
def _list_leaves(boxes, depth, above, reach, out_leaves, stack):
    """List the leaves within ``reach`` of a node's box, along each axis; return how many, -1 where there is no room."""
    x_low, x_high = boxes[above, 0] - reach, boxes[above, 1] + reach
    z_low, z_high = boxes[above, 2] - reach, boxes[above, 3] + reach
    listed, held = 0, 1
    stack[0] = 1
    while held > 0:
        held -= 1
        node = stack[held]
        if boxes[node, 0] > x_high or boxes[node, 1] < x_low or boxes[node, 2] > z_high or boxes[node, 3] < z_low:
            continue
        if node < 1 << depth:
            stack[held] = 2 * node + 1
            stack[held + 1] = 2 * node
            held += 2
            continue
        if listed == out_leaves.shape[0]:
            return -1
        out_leaves[listed] = node
        listed += 1
    return listed


@_kernel
def _copy_near(xs, zs, depth, boxes, leaf, reach, leaves, listed, out_points, out_xs, out_zs):
    """Copy the points within ``reach`` of a leaf's box, along each axis; return how many, -1 where there is no room."""
    count, leaf_count = xs.shape[0], 1 << depth
    x_low, x_high = boxes[leaf, 0] - reach, boxes[leaf, 1] + reach
    z_low, z_high = boxes[leaf, 2] - reach, boxes[leaf, 3] + reach
    held = 0
    for k in range(listed):
        node = leaves[k]
        if boxes[node, 0] > x_high or boxes[node, 1] < x_low or boxes[node, 2] > z_high or boxes[node, 3] < z_low:
            continue
        place = node - leaf_count
        first, last = (place * count) >> depth, ((place + 1) * count) >> depth
        if held + last - first > out_points.shape[0]:
            return -1
        for i in range(np.uint64(first), np.uint64(last)):
            x, z, at = xs[i], zs[i], np.uint64(held)
            out_points[at], out_xs[at], out_zs[at] = i, x, z
            held += (x >= x_low) & (x <= x_high) & (z >= z_low) & (z <= z_high)
    return held


@kernel
def observe(
    xs, zs, number, team, depth, boxes, box_teams, due, skipped, opponent, slot_of, reach, first, last, out_opponents,
    out_counts, out_neighbours,
):  # fmt: skip
    """Find the nearest opponent and the neighbours within ``reach`` of points ``due[first:last]``, which ascend.

    Queries of one leaf share the points around it. ``skipped`` (N,) is the team that a point's opponent may not be of:
    -1 for none (nearest of anyone), -2 where no opponent is asked for. ``opponent`` (N,) is the number of the opponent
    so far, or negative, and ``slot_of`` tells where a number is: it bounds the search and changes no result. The
    outputs run along with ``due``; ``out_neighbours`` (Q, K) holds the nearest ``out_counts`` ones, in no order.
    """
    stack = np.empty(64, np.int64)
    far = np.empty(64)
    count, room = xs.shape[0], out_neighbours.shape[1]
    distances = np.empty(room)
    near_points, near_xs, near_zs, near_distances = np.empty(512, np.int64), np.empty(512), np.empty(512), np.empty(512)
    hits, leaves = np.empty(512, np.int64), np.empty(512, np.int64)
    near_count = listed_leaves = 0
    leaf = leaf_end = group_end = -1
    for q in range(first, last):
        own = due[q]
        x, z = xs[own], zs[own]
        if own >= leaf_end:
            place = (((own + 1) << depth) - 1) // count
            leaf_end = ((place + 1) * count) >> depth
            leaf = (1 << depth) + place
            above = min(ABOVE, depth)
            if place >= group_end:
                group_end = ((place >> above) + 1) << above
                listed_leaves = _list_leaves(boxes, depth, leaf >> above, reach, leaves, stack)
            near_count = -1
            if listed_leaves >= 0:
                near_count = _copy_near(
                    xs, zs, depth, boxes, leaf, reach, leaves, listed_leaves, near_points, near_xs, near_zs
                )
        neighbours = out_neighbours[q]
        own_team = skipped[own]
        best, found = math.inf, -1
        held = 0
        for n in range(near_count):
            dx, dz = near_xs[n] - x, near_zs[n] - z
            near_distances[n] = dx * dx + dz * dz
        for n in range(near_count):  # no branch: which points are near is anybody's guess
            hits[np.uint64(held)] = n
            held += near_distances[n] <= reach * reach
        if near_count >= 0 and held <= room + 1:
            listed = 0
            for h in range(held):
                i = near_points[hits[h]]
                if i != own and listed < room:
                    neighbours[listed] = i
                    listed += 1
                    distance = near_distances[hits[h]]
                    if team[i] != own_team and (distance < best or (distance == best and number[i] < number[found])):
                        best, found = distance, i
            held = listed
        else:
            held = _gather(xs, zs, number, depth, boxes, x, z, own, reach * reach, neighbours, distances, stack)
            for n in range(held):
                if found < 0 and team[neighbours[n]] != own_team:
                    best, found = distances[n], neighbours[n]
        out_counts[q] = held
        if own_team == -2:
            found = -1
        elif found < 0:
            for n in range(near_count):
                i, distance = near_points[n], near_distances[n]
                if (
                    distance <= best
                    and i != own
                    and team[i] != own_team
                    and (distance < best or number[i] < number[found])
                ):
                    best, found = distance, i
            # All that is nearer than the border of what was copied has been seen.
            across = min(x - boxes[leaf, 0], boxes[leaf, 1] - x) + reach
            along = min(z - boxes[leaf, 2], boxes[leaf, 3] - z) + reach
            seen = (1.0 - 1e-9) * min(across, along) if near_count >= 0 else 0.0
            if best >= seen * seen:
                guess = slot_of[opponent[own]] if opponent[own] >= 0 else -1
                if 0 <= guess < count and guess != own and team[guess] != own_team:
                    dx, dz = xs[guess] - x, zs[guess] - z
                    distance = dx * dx + dz * dz
                    if distance < best or (distance == best and number[guess] < number[found]):
                        best, found = distance, guess
                best, found = _nearest(
                    xs, zs, number, team, depth, boxes, box_teams, x, z, own, own_team, best, found, stack, far
                )
        out_opponents[q] = found

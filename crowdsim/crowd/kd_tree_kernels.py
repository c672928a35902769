"""Compiled 2-D KD-trees: a balanced tree over each block of avatars, whose points lie in the order of its leaves.

Block b holds the points ``starts[b]`` to ``starts[b + 1]``. Its tree has ``2 ** depths[b]`` leaves, and leaf i of n
points the points ``i * n >> depth`` to ``(i + 1) * n >> depth``, so that no ranges are stored. Nodes are numbered as in
a heap: the root is 1, the children of k are 2 k and 2 k + 1; ``boxes[nodes[b] + k]`` holds least x, greatest x, least z
and greatest z. A box's computed squared distance never exceeds that of a point in it, because rounding is monotonic:
pruning with ``>`` therefore loses no candidate at the best distance.
"""

import math

import numba as nb
import numpy as np

# Kernels that allocate nothing do without numba's counting of references, which would cost more than their work.
_kernel = nb.njit(cache=True, nogil=True, _nrt=False)  # type: ignore[call-overload]


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


@nb.njit(cache=True, nogil=True)
def sort_points(xs, zs, order, start, count, depth, top, bottom):
    """Bring the points below node ``top`` into the order of leaves, down to nodes of level ``bottom``.

    ``xs``, ``zs`` and ``order`` are moved together; each node splits at its median across the longer side of its box.
    """
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
        low = start + ((place * count) >> level)
        high = start + (((place + 1) * count) >> level)
        middle = start + (((2 * place + 1) * count) >> (level + 1))
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
def fit_leaves(xs, zs, team, start, count, depth, first_node, first, last, out_boxes, out_teams):
    """Bound leaves ``first`` to ``last`` by their points; ``out_teams`` is a leaf's only team, or -1 where they mix."""
    for leaf in range(first, last):
        low = start + ((leaf * count) >> depth)
        high = start + (((leaf + 1) * count) >> depth)
        x_low, x_high, z_low, z_high = math.inf, -math.inf, math.inf, -math.inf
        only = team[low] if high > low else -1
        for i in range(low, high):
            x_low, x_high = min(x_low, xs[i]), max(x_high, xs[i])
            z_low, z_high = min(z_low, zs[i]), max(z_high, zs[i])
            if team[i] != only:
                only = -1
        node = first_node + (1 << depth) + leaf
        out_boxes[node, 0], out_boxes[node, 1] = x_low, x_high
        out_boxes[node, 2], out_boxes[node, 3] = z_low, z_high
        out_teams[node] = only


@_kernel
def fit_nodes(depth, first_node, out_boxes, out_teams):
    """Bound every inner node by its two children, leaves first."""
    for node in range((1 << depth) - 1, 0, -1):
        k, a, b = first_node + node, first_node + 2 * node, first_node + 2 * node + 1
        out_boxes[k, 0] = min(out_boxes[a, 0], out_boxes[b, 0])
        out_boxes[k, 1] = max(out_boxes[a, 1], out_boxes[b, 1])
        out_boxes[k, 2] = min(out_boxes[a, 2], out_boxes[b, 2])
        out_boxes[k, 3] = max(out_boxes[a, 3], out_boxes[b, 3])
        out_teams[k] = out_teams[a] if out_teams[a] == out_teams[b] else -1


@_kernel
def _box_distance(boxes, node, x, z):
    """Squared distance from a point to a box; 0 inside."""
    dx = max(max(boxes[node, 0] - x, x - boxes[node, 1]), 0.0)
    dz = max(max(boxes[node, 2] - z, z - boxes[node, 3]), 0.0)
    return dx * dx + dz * dz


@_kernel
def _nearest_in_block(
    xs,
    zs,
    number,
    team,
    start,
    count,
    depth,
    first_node,
    boxes,
    box_teams,
    x,
    z,
    own,
    own_team,
    best,
    found,
    stack,
    far,
):
    """Return the nearest point of a block that is neither ``own`` nor of ``own_team``, or the one found before."""
    root = _box_distance(boxes, first_node + 1, x, z)
    if root > best or (own_team >= 0 and box_teams[first_node + 1] == own_team):
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
            da, db = _box_distance(boxes, first_node + a, x, z), _box_distance(boxes, first_node + a + 1, x, z)
            if own_team >= 0:
                if box_teams[first_node + a] == own_team:
                    da = math.inf
                if box_teams[first_node + a + 1] == own_team:
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
        for i in range(start + ((leaf * count) >> depth), start + (((leaf + 1) * count) >> depth)):
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
def _gather_in_block(
    xs, zs, number, start, count, depth, first_node, boxes, x, z, own, reach, held_now, out_points, out_distances, stack
):
    """Add a block's points within ``reach`` (squared) to a sorted list of the nearest ones; return its new length."""
    room = out_points.shape[0]
    leaves = 1 << depth
    stack[0] = 1
    held = 1
    while held > 0:
        held -= 1
        node = stack[held]
        limit = reach if held_now < room else out_distances[room - 1]
        if _box_distance(boxes, first_node + node, x, z) > limit:
            continue
        if node < leaves:
            stack[held] = 2 * node + 1
            stack[held + 1] = 2 * node
            held += 2
            continue
        leaf = node - leaves
        for i in range(start + ((leaf * count) >> depth), start + (((leaf + 1) * count) >> depth)):
            dx, dz = xs[i] - x, zs[i] - z
            distance = dx * dx + dz * dz
            if distance > limit or i == own:
                continue
            held_now = _insert(number, i, distance, held_now, out_points, out_distances)
            if held_now == room:
                limit = out_distances[room - 1]
    return held_now


@nb.njit(cache=True, nogil=True)
def query_nearest(
    xs, zs, number, team, starts, depths, nodes, boxes, box_teams,
    at_x, at_z, at_own, at_team, at_guess, first, last, out_found, out_distance,
):  # fmt: skip
    """Find the nearest point of another team for queries ``first`` to ``last``.

    A query is a place, the point that it skips (-1 for none), the team that it skips (-1 for none) and a guess (-1 for
    none), a point whose distance bounds the search. ``out_found`` is -1 where no point is left.
    """
    stack = np.empty(64, np.int64)
    far = np.empty(64)
    for q in range(first, last):
        x, z, own, own_team = at_x[q], at_z[q], at_own[q], at_team[q]
        best, found = math.inf, -1
        guess = at_guess[q]
        if guess >= 0 and guess != own and team[guess] != own_team:
            dx, dz = xs[guess] - x, zs[guess] - z
            best, found = dx * dx + dz * dz, guess
        for b in range(starts.shape[0] - 1):
            count = starts[b + 1] - starts[b]
            if count > 0:
                best, found = _nearest_in_block(
                    xs, zs, number, team, starts[b], count, depths[b], nodes[b], boxes, box_teams,
                    x, z, own, own_team, best, found, stack, far,
                )  # fmt: skip
        out_found[q] = found
        out_distance[q] = best


@nb.njit(cache=True, nogil=True)
def query_neighbours(
    xs, zs, number, starts, depths, nodes, boxes, at_x, at_z, at_own, reach, first, last,
    out_counts, out_points, out_distances,
):  # fmt: skip
    """List the nearest points within ``reach`` for queries ``first`` to ``last``, nearest first, lower numbers first.

    As many as ``out_points`` (Q, K) has room for; ``out_distances`` (K,) is scratch space.
    """
    stack = np.empty(64, np.int64)
    for q in range(first, last):
        held = 0
        for b in range(starts.shape[0] - 1):
            count = starts[b + 1] - starts[b]
            if count > 0:
                held = _gather_in_block(
                    xs, zs, number, starts[b], count, depths[b], nodes[b], boxes,
                    at_x[q], at_z[q], at_own[q], reach * reach, held, out_points[q], out_distances, stack,
                )  # fmt: skip
        out_counts[q] = held


@_kernel
def _gather_near(
    xs, zs, starts, depths, nodes, boxes, x_low, x_high, z_low, z_high, reach, out_points, out_xs, out_zs, stack
):
    """Copy the points within ``reach`` of a box, along each axis; return how many, or -1 where there is no room."""
    x_low, x_high, z_low, z_high = x_low - reach, x_high + reach, z_low - reach, z_high + reach
    room = out_points.shape[0]
    held_now = 0
    for b in range(starts.shape[0] - 1):
        start, count, depth, first_node = starts[b], starts[b + 1] - starts[b], depths[b], nodes[b]
        leaves = 1 << depth
        held = 0
        if count > 0:
            stack[0] = 1
            held = 1
        while held > 0:
            held -= 1
            node = stack[held]
            k = first_node + node
            if boxes[k, 0] > x_high or boxes[k, 1] < x_low or boxes[k, 2] > z_high or boxes[k, 3] < z_low:
                continue
            if node < leaves:
                stack[held] = 2 * node + 1
                stack[held + 1] = 2 * node
                held += 2
                continue
            leaf = node - leaves
            first, last = start + ((leaf * count) >> depth), start + (((leaf + 1) * count) >> depth)
            if held_now + last - first > room:
                return -1
            for i in range(first, last):
                x, z = xs[i], zs[i]
                out_points[held_now] = i
                out_xs[held_now] = x
                out_zs[held_now] = z
                held_now += (x >= x_low) & (x <= x_high) & (z >= z_low) & (z <= z_high)
    return held_now


@nb.njit(cache=True, nogil=True)
def observe(
    xs, zs, number, team, starts, depths, nodes, boxes, box_teams,
    due, skipped, opponent, slot_of, reach, first, last, out_opponents, out_counts, out_neighbours,
):  # fmt: skip
    """Find the nearest opponent and the neighbours within ``reach`` of points ``due[first:last]``, which ascend.

    Queries of one leaf share the points around it. ``skipped`` (N,) is the team that a point's opponent may not be of:
    -1 for none (nearest of anyone), -2 where no opponent is asked for. ``opponent`` (N,) is the number of the opponent
    so far, or negative, and ``slot_of`` tells where a number is: it bounds the search and changes no result. The
    outputs run along with ``due``; ``out_neighbours`` (Q, K) holds the nearest ``out_counts`` ones, in no order.
    """
    stack = np.empty(64, np.int64)
    far = np.empty(64)
    room = out_neighbours.shape[1]
    distances = np.empty(room)
    near_points, near_xs, near_zs, near_distances = np.empty(512, np.int64), np.empty(512), np.empty(512), np.empty(512)
    hits = np.empty(512, np.int64)
    near_count = 0
    leaf_end = -1
    block = 0
    for q in range(first, last):
        own = due[q]
        x, z = xs[own], zs[own]
        if own >= leaf_end:
            while own >= starts[block + 1]:
                block += 1
            start, count, depth = starts[block], starts[block + 1] - starts[block], depths[block]
            leaf = (((own - start + 1) << depth) - 1) // count
            leaf_end = start + (((leaf + 1) * count) >> depth)
            k = nodes[block] + (1 << depth) + leaf
            near_count = _gather_near(
                xs, zs, starts, depths, nodes, boxes, boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3], reach,
                near_points, near_xs, near_zs, stack,
            )  # fmt: skip
        neighbours = out_neighbours[q]
        own_team = skipped[own]
        best, found = math.inf, -1
        held = 0
        for n in range(near_count):
            dx, dz = near_xs[n] - x, near_zs[n] - z
            near_distances[n] = dx * dx + dz * dz
        for n in range(near_count):  # no branch: which points are near is anybody's guess
            hits[held] = n
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
            held = 0
            for b in range(starts.shape[0] - 1):
                if starts[b + 1] > starts[b]:
                    held = _gather_in_block(
                        xs, zs, number, starts[b], starts[b + 1] - starts[b], depths[b], nodes[b], boxes,
                        x, z, own, reach * reach, held, neighbours, distances, stack,
                    )  # fmt: skip
            for n in range(held):
                if found < 0 and team[neighbours[n]] != own_team:
                    best, found = distances[n], neighbours[n]
        out_counts[q] = held
        if own_team == -2:
            found = -1
        elif found < 0:
            guess = slot_of[opponent[own]] if opponent[own] >= 0 else -1
            if 0 <= guess < starts[-1] and guess != own and team[guess] != own_team:
                found = guess
                dx, dz = xs[found] - x, zs[found] - z
                best = dx * dx + dz * dz
            for n in range(near_count):
                if near_distances[n] < best and near_points[n] != own and team[near_points[n]] != own_team:
                    best, found = near_distances[n], near_points[n]
            for b in range(starts.shape[0] - 1):
                if starts[b + 1] > starts[b]:
                    best, found = _nearest_in_block(
                        xs, zs, number, team, starts[b], starts[b + 1] - starts[b], depths[b], nodes[b], boxes,
                        box_teams, x, z, own, own_team, best, found, stack, far,
                    )  # fmt: skip
        out_opponents[q] = found

"""Compiled queries of a KD-tree: nearest opponents, and neighbours within reach.

Points of a team below 0 are nobody's opponent; they are neighbours all the same.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel

ABOVE = 3  # levels up from a leaf to the node whose leaves share a list of the leaves around them


class Query(NamedTuple):
    """A position, the point that it skips (-1 for none) and the team that it skips (-1 for none), or arrays of them."""

    x: Any
    z: Any
    own: Any
    skip: Any


class Window(NamedTuple):
    """A box: least and greatest x and z [m]."""

    x_low: float
    x_high: float
    z_low: float
    z_high: float


class Space(NamedTuple):
    """Scratch space of a thread: the points around a leaf, and nodes that are still to be looked at."""

    points: Any
    xs: Any
    zs: Any
    distances: Any
    hits: Any
    leaves: Any
    nearest: Any
    stack: Any
    far: Any


@kernel
def box_distance(boxes, node, x, z):
    """Return the squared distance from a point to a box; 0 inside."""
    dx = max(max(boxes[node, 0] - x, x - boxes[node, 1]), 0.0)
    dz = max(max(boxes[node, 2] - z, z - boxes[node, 3]), 0.0)
    return dx * dx + dz * dz


@kernel
def _nearest(tree, query, best, found, stack, far):
    """Return the nearest point that a query does not skip, or the one found before."""
    x, z, own, skip = query.x, query.z, query.own, query.skip
    boxes, box_teams, count = tree.boxes, tree.box_teams, tree.xs.shape[0]
    root = box_distance(boxes, 1, x, z)
    if count == 0 or root > best or (skip >= 0 and box_teams[1] == skip):
        return best, found
    leaves = 1 << tree.depth
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
            da, db = box_distance(boxes, a, x, z), box_distance(boxes, a + 1, x, z)
            if skip >= 0:
                if box_teams[a] == skip:
                    da = math.inf
                if box_teams[a + 1] == skip:
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
        for i in range((leaf * count) >> tree.depth, ((leaf + 1) * count) >> tree.depth):
            dx, dz = tree.xs[i] - x, tree.zs[i] - z
            distance = dx * dx + dz * dz
            if (
                distance <= best
                and i != own
                and tree.team[i] != skip
                and tree.team[i] >= 0
                and (distance < best or found < 0 or tree.number[i] < tree.number[found])
            ):
                best = distance
                found = i
    return best, found


@kernel
def _insert(number, i, distance, held_now, out_points, out_distances):
    """Insert point i into the sorted list, if it is near enough; return the list's new length."""
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


@kernel
def gather(tree, query, reach, out_points, out_distances, stack):
    """List the nearest points within ``reach`` (squared), nearest first; return how many."""
    count = tree.xs.shape[0]
    held_now = 0
    room = out_points.shape[0]
    leaves = 1 << tree.depth
    stack[0] = 1
    held = 1 if count > 0 else 0
    while held > 0:
        held -= 1
        node = stack[held]
        limit = reach if held_now < room else out_distances[room - 1]
        if box_distance(tree.boxes, node, query.x, query.z) > limit:
            continue
        if node < leaves:
            stack[held] = 2 * node + 1
            stack[held + 1] = 2 * node
            held += 2
            continue
        leaf = node - leaves
        for i in range((leaf * count) >> tree.depth, ((leaf + 1) * count) >> tree.depth):
            dx, dz = tree.xs[i] - query.x, tree.zs[i] - query.z
            distance = dx * dx + dz * dz
            if distance > limit or i == query.own:
                continue
            held_now = _insert(tree.number, i, distance, held_now, out_points, out_distances)
            if held_now == room:
                limit = out_distances[room - 1]
    return held_now


@kernel(allocates=True)
def query_nearest(tree, queries, first, last, out_found, out_distance):
    """Find the nearest point for each of ``queries``, a ``Query`` of arrays, from ``first`` to ``last``.

    ``out_found`` is -1 where no point is left; distances are squared.
    """
    stack, far = np.empty(64, np.int64), np.empty(64)
    for q in range(first, last):
        query = Query(queries.x[q], queries.z[q], queries.own[q], queries.skip[q])
        out_distance[q], out_found[q] = _nearest(tree, query, math.inf, -1, stack, far)


@kernel(allocates=True)
def query_neighbours(tree, queries, reach, first, last, out_counts, out_points):
    """List the nearest points within ``reach`` of ``queries``, of any team, nearest first, lower numbers first.

    As many as ``out_points`` (Q, K) has room for.
    """
    stack, distances = np.empty(64, np.int64), np.empty(out_points.shape[1])
    for q in range(first, last):
        query = Query(queries.x[q], queries.z[q], queries.own[q], queries.skip[q])
        out_counts[q] = gather(tree, query, reach * reach, out_points[q], distances, stack)


@kernel(allocates=True)
def observe(tree, due, skipped, opponent, slot_of, reach, observed):
    """Find the nearest opponent and the neighbours within ``reach`` of points ``due``, which ascend.

    Queries of one leaf share the points around it. ``skipped`` (N,) is the team that a point's opponent may not be of:
    -1 for none (nearest of anyone), -2 where no opponent is asked for. ``opponent`` (N,) is the number of the opponent
    so far, or negative, and ``slot_of`` the slot of each number: it bounds the search and changes no result. The
    outputs run along with ``due``; neighbours are the nearest ones, in no order.
    """
    space = Space(
        np.empty(512, np.int64), np.empty(512), np.empty(512), np.empty(512), np.empty(512, np.int64),
        np.empty(512, np.int64), np.empty(observed.neighbours.shape[1]), np.empty(64, np.int64), np.empty(64),
    )  # fmt: skip
    count, depth = tree.xs.shape[0], tree.depth
    copied = listed = 0
    leaf = leaf_end = group_end = -1
    for q in range(due.shape[0]):
        own = due[q]
        if own >= leaf_end:
            place = (((own + 1) << depth) - 1) // count
            leaf_end = ((place + 1) * count) >> depth
            leaf = (1 << depth) + place
            above = min(ABOVE, depth)
            if place >= group_end:
                group_end = ((place >> above) + 1) << above
                listed = _list_leaves(tree, _around(tree.boxes, leaf >> above, reach), space.leaves, space.stack)
            copied = -1
            if listed >= 0:
                copied = _copy_near(tree, _around(tree.boxes, leaf, reach), listed, space)
        query = Query(np.float64(tree.xs[own]), np.float64(tree.zs[own]), own, np.int32(skipped[own]))
        best, found = _list_neighbours(tree, query, q, copied, reach, observed, space)
        if query.skip == -2:
            found = -1
        elif found < 0:
            best, found = _scan(tree, query, copied, best, found, space)
            seen = _distance_seen(tree.boxes, leaf, query, reach) if copied >= 0 else 0.0
            if best >= seen * seen:
                guess = slot_of[opponent[own]] if opponent[own] >= 0 else -1
                best, found = _take_guess(tree, query, guess, best, found)
                best, found = _nearest(tree, query, best, found, space.stack, space.far)
        observed.opponents[q] = found


@kernel(inline=True)
def observe_alone(tree, own, skip, guess, reach, out_points, out_distances, stack, far):
    """Find the nearest opponent and the neighbours within ``reach`` of one point, as ``observe`` does.

    ``guess`` is the slot of the opponent so far, or negative. ``out_distances``, ``stack`` and ``far`` (64,) are
    scratch space. Returns the opponent, -1 for none, and how many neighbours are listed.
    """
    query = Query(np.float64(tree.xs[own]), np.float64(tree.zs[own]), own, skip)
    listed = gather(tree, query, reach * reach, out_points, out_distances, stack)
    if skip == -2:
        return -1, listed
    for n in range(listed):  # nearest first, lower numbers first among equals
        if tree.team[out_points[n]] != skip and tree.team[out_points[n]] >= 0:
            return np.int64(out_points[n]), listed
    best, found = _take_guess(tree, query, guess, math.inf, -1)
    best, found = _nearest(tree, query, best, found, stack, far)
    return np.int64(found), listed


@kernel(inline=True)
def _around(boxes, node, reach):
    """Return the window within ``reach`` of a node's box, along each axis."""
    return Window(boxes[node, 0] - reach, boxes[node, 1] + reach, boxes[node, 2] - reach, boxes[node, 3] + reach)


@kernel(inline=True)
def _is_apart(boxes, node, window):
    """Return whether a node's box lies outside a window."""
    return (
        boxes[node, 0] > window.x_high
        or boxes[node, 1] < window.x_low
        or boxes[node, 2] > window.z_high
        or boxes[node, 3] < window.z_low
    )


@kernel
def _list_leaves(tree, window, out_leaves, stack):
    """List the leaves in a window; return how many, -1 where there is no room."""
    listed, held = 0, 1
    stack[0] = 1
    while held > 0:
        held -= 1
        node = stack[held]
        if _is_apart(tree.boxes, node, window):
            continue
        if node < 1 << tree.depth:
            stack[held] = 2 * node + 1
            stack[held + 1] = 2 * node
            held += 2
            continue
        if listed == out_leaves.shape[0]:
            return -1
        out_leaves[listed] = node
        listed += 1
    return listed


@kernel
def _copy_near(tree, window, listed, space):
    """Copy the points of the listed leaves that are in a window; return how many, -1 where there is no room."""
    count, depth = tree.xs.shape[0], tree.depth
    held = 0
    for k in range(listed):
        node = space.leaves[k]
        if _is_apart(tree.boxes, node, window):
            continue
        place = node - (1 << depth)
        first, last = (place * count) >> depth, ((place + 1) * count) >> depth
        if held + last - first > space.points.shape[0]:
            return -1
        for i in range(np.uint64(first), np.uint64(last)):
            x, z, at = tree.xs[i], tree.zs[i], np.uint64(held)
            space.points[at], space.xs[at], space.zs[at] = i, x, z
            held += (x >= window.x_low) & (x <= window.x_high) & (z >= window.z_low) & (z <= window.z_high)
    return held


@kernel(inline=True)
def _list_neighbours(tree, query, q, copied, reach, observed, space):
    """List the neighbours of a query; return the nearest opponent among them, and its squared distance."""
    neighbours, hits, distances = observed.neighbours[q], space.hits, space.distances
    room, own, skip = neighbours.shape[0], query.own, query.skip
    best, found = math.inf, -1
    held = 0
    for n in range(copied):
        dx, dz = space.xs[n] - query.x, space.zs[n] - query.z
        distances[n] = dx * dx + dz * dz
    for n in range(copied):  # no branch, since which points are near cannot be predicted
        hits[np.uint64(held)] = n
        held += distances[n] <= reach * reach
    if copied >= 0 and held <= room + 1:
        listed = 0
        for h in range(held):
            i = space.points[hits[h]]
            if i != own and listed < room:
                neighbours[listed] = i
                listed += 1
                distance = distances[hits[h]]
                if (
                    tree.team[i] != skip
                    and tree.team[i] >= 0
                    and (distance < best or (distance == best and tree.number[i] < tree.number[found]))
                ):
                    best, found = distance, i
        held = listed
    else:
        held = gather(tree, query, reach * reach, neighbours, space.nearest, space.stack)
        for n in range(held):
            if found < 0 and tree.team[neighbours[n]] != skip and tree.team[neighbours[n]] >= 0:
                best, found = space.nearest[n], np.int64(neighbours[n])
    observed.counts[q] = held
    return best, found


@kernel(inline=True)
def _scan(tree, query, copied, best, found, space):
    """Return the nearest opponent among the points copied, or the one found before, and its squared distance."""
    for n in range(copied):
        i, distance = space.points[n], space.distances[n]
        if (
            distance <= best
            and i != query.own
            and tree.team[i] != query.skip
            and tree.team[i] >= 0
            and (distance < best or tree.number[i] < tree.number[found])
        ):
            best, found = distance, i
    return best, found


@kernel(inline=True)
def _distance_seen(boxes, leaf, query, reach):
    """Return a distance up to which the points copied around a leaf are all that there are."""
    across = min(query.x - boxes[leaf, 0], boxes[leaf, 1] - query.x) + reach
    along = min(query.z - boxes[leaf, 2], boxes[leaf, 3] - query.z) + reach
    return (1.0 - 1e-9) * min(across, along)


@kernel(inline=True)
def _take_guess(tree, query, guess, best, found):
    """Return a point that may be the nearest one, where it is nearer than the one found before."""
    if (
        0 <= guess < tree.xs.shape[0]
        and guess != query.own
        and tree.team[guess] != query.skip
        and tree.team[guess] >= 0
    ):
        dx, dz = tree.xs[guess] - query.x, tree.zs[guess] - query.z
        distance = dx * dx + dz * dz
        if distance < best or (distance == best and tree.number[guess] < tree.number[found]):
            best, found = distance, np.int64(guess)
    return best, found

"""Slow, obvious versions of the motion graph's parts."""

import numpy as np


def pairs(features, clip_starts, contacts, near, ceiling):
    """Return {(i, k): cost} of the local minima i < k of costs no two of which are equal."""
    frames = len(features)
    clip = [max(c for c in range(len(clip_starts) - 1) if clip_starts[c] <= f) for f in range(frames)]
    cost = np.sqrt(((features[:, None].astype(float) - features[None].astype(float)) ** 2).sum(axis=-1))
    found = {}
    for i in range(frames):
        for k in range(i + 1, frames):
            if cost[i, k] > ceiling or tuple(contacts[i]) != tuple(contacts[k]):
                continue
            if clip[i] == clip[k] and k - i < near:
                continue
            around = [
                cost[m, n]
                for m in range(max(0, i - 1), min(frames, i + 2))
                for n in range(max(0, k - 1), min(frames, k + 2))
                if (m, n) != (i, k) and clip[m] == clip[i] and clip[n] == clip[k]
            ]
            if all(cost[i, k] < other for other in around):
                found[i, k] = cost[i, k]
    return found


def transitions(found, clip_starts):
    """Return {(i, j): cost}: after frame i shows frame j."""
    last = {int(stop) - 1 for stop in clip_starts[1:]}
    result = {}
    for (i, k), cost in found.items():
        if k not in last:
            result[i, k + 1] = cost
        if i not in last:
            result[k, i + 1] = cost
    return result


def cheapest(edges, most):
    """Return the ``most`` cheapest transitions of each source."""
    result = {}
    for source in {i for i, _ in edges}:
        cheapest = sorted((cost, j) for (i, j), cost in edges.items() if i == source)
        result.update({(source, j): cost for cost, j in cheapest[:most]})
    return result


def largest_worth_apart(worth, spacing):
    """Return the largest sum of entries no two of which are less than ``spacing`` apart, by trying everything."""
    if not worth:
        return 0
    return max(largest_worth_apart(worth[1:], spacing), worth[0] + largest_worth_apart(worth[spacing:], spacing))


def reachable(successors, frame):
    """Return all frames that can be reached from one, itself only over a cycle."""
    seen, todo = set(), list(successors[frame])
    while todo:
        here = todo.pop()
        if here not in seen:
            seen.add(here)
            todo.extend(successors[here])
    return seen


def component(edges, clip_starts):
    """Return the largest set of frames that all reach each other, the earliest of those of one size."""
    frames = int(clip_starts[-1])
    last = {int(stop) - 1 for stop in clip_starts[1:]}
    successors = {f: [j for i, j in edges if i == f] + ([f + 1] if f not in last else []) for f in range(frames)}
    reach = {f: reachable(successors, f) for f in range(frames)}
    best = set()
    for f in range(frames):
        mutual = {g for g in reach[f] if f in reach[g]}
        if len(mutual) > len(best):
            best = mutual
    return best


def actions(edges, kept, clip_starts):
    """Return {state frame: [(first frame, frames shown, cost)]}, walking frame by frame from each successor."""
    last = {int(stop) - 1 for stop in clip_starts[1:]}
    onward = {f for f in kept if f not in last and f + 1 in kept}
    jumps = {f: sorted((j, c) for (i, j), c in edges.items() if i == f and j in kept) for f in kept}
    states = {f for f in kept if len(jumps[f]) + (f in onward) > 1 or f not in onward}
    result = {}
    for state in sorted(states):
        successors = [(state + 1, 0.0)] if state in onward else []
        result[state] = []
        for first, cost in successors + jumps[state]:
            frame = first
            while frame not in states:
                frame += 1
            result[state].append((first, frame - first + 1, cost))
    return result

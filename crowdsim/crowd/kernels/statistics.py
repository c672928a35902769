"""Counts over what is recorded of avatars, and which bodies overlap."""

import math

import numpy as np

from crowdsim.crowd.kernels.kd_queries import Query, gather
from crowdsim.jit import kernel

NEAREST = 16  # bodies that are compared with each one


@kernel
def count_frames(action, done, opponent, first_action, is_transition, first, last, last_done, last_shown, out_counts):
    """Count frames in which avatars are present, transitions and changes of opponents of some avatars.

    Args:
        action: Action of each avatar in its policy, -1 where it is absent. Shape (frames, N), int32.
        done: Frames of that action done. Shape (frames, N), float32.
        opponent: Its opponent, -1 for none. Shape (frames, N), int32.
        first_action: Number of the first action of its policy. Shape (N,), int32.
        is_transition: Whether each action of all policies begins with a transition. Shape (A,), bool.
        first: The first avatar.
        last: One past the last one.
        last_done: Frames done in the frame before, which those of the last frame replace. Shape (N,), float32.
        last_shown: Likewise action and opponent. Shape (2, N), int32.
        out_counts: Where counts are written. Shape (3,), int64.
    """
    present, transitions, changes = 0, 0, 0
    for k in range(action.shape[0]):
        for n in range(first, last):
            before, opponent_before = last_shown[0, n], last_shown[1, n]
            now, other = action[k, n], opponent[k, n]
            is_here = now >= 0
            present += is_here
            if is_here and before >= 0:
                if now != before or done[k, n] <= last_done[n]:
                    transitions += is_transition[first_action[n] + now]
                changes += other != opponent_before and other != -1 and opponent_before != -1
            last_shown[0, n], last_shown[1, n], last_done[n] = now, other, done[k, n]
    out_counts[0], out_counts[1], out_counts[2] = present, transitions, changes


@kernel(allocates=True)
def find_overlaps(tree, order, radii, greatest, first, last, out):
    """Write whether bodies ``first`` to ``last`` of a tree overlap one of the bodies nearest to them.

    ``order`` (N,) are indices of the tree's points, by which ``radii`` [m] and ``out`` are given; ``greatest`` is the
    greatest radius.
    """
    stack, points, distances = np.empty(64, np.int64), np.empty(NEAREST, np.int32), np.empty(NEAREST)
    for q in range(first, last):
        radius = radii[order[q]]
        reach = radius + greatest
        count = gather(tree, Query(tree.xs[q], tree.zs[q], q, -1), reach * reach, points, distances, stack)
        overlaps = False
        for k in range(count):
            other = points[k]
            dx, dz = tree.xs[q] - tree.xs[other], tree.zs[q] - tree.zs[other]
            away = math.sqrt(dx * dx + dz * dz)
            overlaps = overlaps or away < radius + radii[order[other]]
        out[order[q]] = overlaps

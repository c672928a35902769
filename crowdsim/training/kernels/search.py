"""The best action of a state by beam search: exact rewards, and V behind the leaves."""

import math

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.rewards import Target, action_reward
from crowdsim.policy.kernels.values import DISCOUNT, END_TERM, FIRST_TERM, after_action, state_value

# Columns of nodes: first action of its path, state, position of its target, discount and reward so far, value.
FIRST_ACTION, STATE, NODE_X, NODE_Z, FACTOR, EARNED, WORTH = range(7)
NODE_WIDTH = 7


@kernel
def best_by_search(tables, behaviour, state, target, width, depth, scratch):
    """Return the best action of a state for a target at rest.

    Of all actions of all nodes the ``width`` with the highest reward so far and V behind it go on, ``depth`` times.

    Args:
        tables: ``LookupTables``; the behaviour's look-up is v.
        behaviour: Its row.
        state: The avatar's state.
        target: ``Target``.
        width: Nodes that go on.
        depth: Actions from the root to a leaf.
        scratch: Nodes. Shape (2, enough, 7), float64.
    """
    corners = Corners(np.empty(64, np.int64), np.empty(64))
    now, later = scratch[0], scratch[1]
    now[0, FIRST_ACTION], now[0, STATE], now[0, NODE_X], now[0, NODE_Z] = -1.0, state, target.x, target.z
    now[0, FACTOR], now[0, EARNED] = 1.0, 0.0
    count = 1
    for _ in range(depth):
        found = 0
        for node in range(count):
            found = _expand(tables, behaviour, target.y, now[node], corners, later, found)
        order = np.argsort(-later[:found, WORTH])
        count = min(width, found)
        for node in range(count):
            for column in range(NODE_WIDTH):
                now[node, column] = later[order[node], column]
    return int(now[0, FIRST_ACTION])


@kernel(allocates=False)
def _expand(tables, behaviour, y, node, corners, later, found):
    """Write the nodes that follow a node by all actions of its state from ``found`` on; return how many there are."""
    actions = tables.actions
    row = tables.behaviours[behaviour]
    log_discount = math.log(row[DISCOUNT])
    state = int(node[STATE])
    seen = Target(node[NODE_X], y, node[NODE_Z], 0.0, 0.0)
    for i in range(actions.offsets[state], actions.offsets[state + 1]):
        a = np.int64(i)
        earned = action_reward(actions, a, seen, tables.terms, int(row[FIRST_TERM]), int(row[END_TERM]), log_discount)
        x, z = after_action(actions, a, seen.x, seen.z)
        factor = node[FACTOR] * math.exp(log_discount * actions.lengths[a])
        total = node[EARNED] + node[FACTOR] * earned
        behind = state_value(tables, behaviour, actions.next[a], x, y, z, corners)
        later[found, FIRST_ACTION] = a if node[FIRST_ACTION] < 0.0 else node[FIRST_ACTION]
        later[found, STATE], later[found, NODE_X], later[found, NODE_Z] = actions.next[a], x, z
        later[found, FACTOR], later[found, EARNED], later[found, WORTH] = factor, total, total + factor * behind
        found += 1
    return found

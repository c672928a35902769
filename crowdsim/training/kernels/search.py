"""The best action of a state by beam search: exact rewards, and V behind the leaves."""

import math

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, Target
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.rewards import action_reward
from crowdsim.policy.kernels.values import after_action, value_behind

NODE = np.dtype(
    [
        ("first_action", np.int64),
        ("state", np.int64),
        ("x", np.float64),
        ("z", np.float64),
        ("heading", np.float64),
        ("factor", np.float64),
        ("earned", np.float64),
        ("worth", np.float64),
    ]
)
"""A node: first action of its path, state, its target, discount and reward so far, and the value with what follows."""


@kernel(allocates=True)
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
        scratch: Nodes. Shape (2, enough), ``NODE``.
    """
    corners = Corners(np.empty(64, np.int64), np.empty(64))
    now, later = scratch[0], scratch[1]
    root = now[0]
    root.first_action, root.state, root.x, root.z, root.heading = -1, state, target.x, target.z, target.heading
    root.factor, root.earned = 1.0, 0.0
    count = 1
    for _ in range(depth):
        found = 0
        for node in range(count):
            found = _expand(tables, behaviour, target.y, now[node], corners, later, found)
        order = np.argsort(-later.worth[:found])
        count = min(width, found)
        for node in range(count):
            now[node] = later[order[node]]
    return now[0].first_action


@kernel
def _expand(tables, behaviour, y, node, corners, later, found):
    """Write the nodes that follow a node by all actions of its state from ``found`` on; return how many there are."""
    actions, log_discount = tables.actions, math.log(tables.behaviours[behaviour].discount)
    seen = Target(node.x, y, node.z, 0.0, 0.0, node.heading, UNSEEN_STRIKE, math.inf)
    for i in range(actions.offsets[node.state], actions.offsets[node.state + 1]):
        a, fresh = np.int64(i), later[found]
        behind = after_action(actions, a, seen)
        fresh.first_action = a if node.first_action < 0 else node.first_action
        fresh.state, fresh.x, fresh.z, fresh.heading = actions.next[a], behind.x, behind.z, behind.heading
        fresh.factor = node.factor * math.exp(log_discount * actions.lengths[a])
        fresh.earned = node.earned + node.factor * action_reward(tables, behaviour, a, seen)
        fresh.worth = fresh.earned + fresh.factor * value_behind(tables, behaviour, a, seen, corners)
        found += 1
    return found

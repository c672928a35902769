"""Where a target is seen after each action, as cells and shares (``model.Model``)."""

import math

import numpy as np
from numba import prange

from crowdsim.jit import kernel
from crowdsim.policy.kernels.axes import STRIDE, find_on_axis
from crowdsim.policy.kernels.rewards import HEADING, X, Z


@kernel(parallel=True)
def fill_successors(actions, axes, targets, velocities, lowers, shares):
    """Write where each moving cell of a grid is seen after each action: the lower corner, and the share of the upper.

    Args:
        actions: ``Actions``.
        axes: The grid's moving axes, with strides in moving cells (``Grid.pack``). Shape (D, 9).
        targets: The target of each moving cell. Shape (M, 3).
        velocities: How the target may move [m a frame]. Shape (O, 2).
        lowers: Written: lower corner. Shape (O, A, M).
        shares: Written: share of the next grid point on each axis. Shape (O, A, M, D).
    """
    for action in prange(lowers.shape[1]):
        _fill_after_action(actions, np.int64(action), axes, targets, velocities, lowers, shares)


@kernel(allocates=False)
def _fill_after_action(actions, action, axes, targets, velocities, lowers, shares):
    """Do what ``fill_successors`` does for one action."""
    length = actions.lengths[action]
    last = actions.path_offsets[action + 1] - 1
    cos, sin = math.cos(actions.paths[last, HEADING]), math.sin(actions.paths[last, HEADING])
    for outcome in range(lowers.shape[0]):
        left = velocities[outcome, X] * length - actions.paths[last, X]
        ahead = velocities[outcome, Z] * length - actions.paths[last, Z]
        for m in range(lowers.shape[2]):
            dx, dz = targets[m, 0] + left, targets[m, 2] + ahead
            x, z = dx * cos - dz * sin, dx * sin + dz * cos
            cell = 0
            for row in range(len(axes)):
                lower, _, share, _ = find_on_axis(axes, row, x, 0.0, z)
                cell += lower * int(axes[row, STRIDE])
                shares[outcome, action, m, row] = share
            lowers[outcome, action, m] = cell

"""What an avatar's best next action is worth for a target at each of some points."""

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, Target
from crowdsim.policy.kernels.values import evaluate_actions


@kernel
def best_values(tables, weights, state, points, headings, corners, values, out):
    """Write into ``out`` (n,) what the best action of a state is worth for still targets at ``points`` (n, 3).

    Args:
        tables: ``policy.LookupTables``.
        weights: Weight of each behaviour. Shape (B,).
        state: The state.
        points: Where targets are, seen by the avatar, for a body of scale 1 [m].
        headings: Which way they face, seen by the avatar [rad]. Shape (n,).
        corners: Scratch, ``policy.kernels.axes.Corners``.
        values: Scratch, as long as a state has actions.
        out: Written.
    """
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        target = Target(x, y, z, 0.0, 0.0, headings[i], UNSEEN_STRIKE, 0.0)
        count = evaluate_actions(tables, weights, state, target, corners, values)
        most = values[0]
        for k in range(1, count):
            most = max(most, values[k])
        out[i] = most

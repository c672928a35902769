"""What sweeps read of a model (``solution.SweepModel``, whose arrays ``model.Model`` describes).

Values V lie flat at ``state * cells + cell``, Q-values at ``offsets[state] * cells + cell * n + k``, with n actions of
the state.
"""

from crowdsim.jit import kernel


@kernel(allocates=False)
def earned_in(model, outcome, action, m, cell):
    """Return r(a, c, o) of one cell, which is in the moving cell ``m``."""
    row = outcome * len(model.next) + action
    low, end = model.landed[row], model.landed[row + 1]
    near = model.near[outcome, action]
    earned = near[0] if len(near) == 1 else (near[m] if len(near) == len(model.xs) else near[cell])
    if low == end:
        return earned
    high = end
    while low < high:
        middle = (low + high) // 2
        if model.landed_cells[middle] < cell:
            low = middle + 1
        else:
            high = middle
    return earned + model.landed_rewards[low] if low < end and model.landed_cells[low] == cell else earned


@kernel(allocates=False)
def expected_reward(model, action, m, cell):
    """Return r(a, c), averaged over the velocities of the target."""
    total = model.probabilities[0] * earned_in(model, 0, action, m, cell)
    for outcome in range(1, len(model.probabilities)):
        total += model.probabilities[outcome] * earned_in(model, outcome, action, m, cell)
    return total

"""Axes of a behaviour's grid, a file each: what is observed of a target, and what becomes of it when the avatar acts.

Distance and bearing say where the target is over the ground; sweeps of training and the loops of control find them
together, for all targets or all actions at once. What any other axis measures changes in a way that does not depend on
where the target is (``AxisKind.after``). An axis may say how the target moves: training then moves the target of each
cell by that while an action runs, and control reads the axis instead of looking ahead of a moving target.
"""

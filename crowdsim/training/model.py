"""The model that both solvers learn on: what each action earns in each cell, and where the target is seen afterwards.

With s a state, c a cell, a an action of s that takes T(a) control frames to the state s'(a):

    Q(a, c) = sum over o of p(o) [ r(a, c, o) + gamma^T(a) * next(s'(a), e(a, c, o)) ]

The target moves meanwhile in one of the ways o, each with its probability p(o); e is where it is seen at the end, which
is between grid points. ``next`` is what the best action is worth there, by one of two backups (``BACKUPS``):

* ``max_of_interpolated``: the greatest interpolated Q, max over a' of sum of w Q(a', cell). It is the paper's.
* ``interpolation_of_max``: V(s', cell) = max over a' of Q(a', cell), interpolated. It is cheaper by the number of
  actions a state has, and never smaller, since every corner may take another action.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.actions import Actions
from crowdsim.policy.environment import AXIS_KINDS, Grid
from crowdsim.policy.rewards import StrikeTerm, TargetBody, Term, TransitionTerm, pack_terms

if TYPE_CHECKING:
    from crowdsim.training.kernels.rewards import Landed

BACKUPS = ("max_of_interpolated", "interpolation_of_max")


@dataclass(frozen=True)
class Movement:
    """How the target may move during an action: a discrete distribution of displacements.

    Attributes:
        probabilities: Probability of each way. Shape (O,).
        velocities: Displacement over the ground, along x and z [m a control frame]. Shape (O, 2).
    """

    probabilities: Array
    velocities: Array


def build_movement(speed: float = 0.0, directions: int = 4, still: float = 0.5, control_rate: float = 15.0) -> Movement:
    """Return a target that stands with probability ``still``, else walks in one of ``directions`` at ``speed`` [m/s].

    With a speed of 0 or ``still`` at 1 it never moves.
    """
    if speed <= 0.0 or still >= 1.0:
        return Movement(np.ones(1), np.zeros((1, 2)))
    angles = 2.0 * math.pi * np.arange(directions) / directions
    steps = speed / control_rate * np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    probabilities = np.full(directions + 1, (1.0 - still) / directions)
    probabilities[0] = still
    return Movement(probabilities, np.concatenate([np.zeros((1, 2)), steps]))


@dataclass(frozen=True)
class Model:
    """The model as flat arrays. A actions, M moving cells, D moving axes, C cells, O ways in which the target moves.

    Attributes:
        grid: The environment.
        discount: gamma, a control frame.
        offsets: CSR: actions of each state. Shape (S + 1,), int32.
        next: State in which each action ends. Shape (A,), int32.
        discounts: gamma^T of each action. Shape (A,), float32.
        lowers: Lower corner of the moving cells around the place where each cell's target is seen after each action.
            Shape (O, A, M), uint16, or int32 when there are many cells.
        shares: Share of the next grid point on each moving axis. Shape (O, A, M, D), float32.
        steps: From a lower corner to all its corners, in cells of the table. Shape (M, 2^D), int32.
        probabilities: p(o). Shape (O,), float32.
        near: What each action earns in each moving cell, landed strikes left out: the reward there is for where the
            target is over the ground. Shape (O, A, M), float32; (O, A, 1) where it is the same everywhere.
        landed: CSR over outcome and action: entries ``landed[o * A + a]:landed[o * A + a + 1]`` of the next two are
            what its strikes earn. Shape (O * A + 1,), int64.
        landed_cells: Cells, ascending, where a strike lands. Flat, int32.
        landed_rewards: What the best of the strikes that land there earns. Flat, float32.
    """

    grid: Grid
    discount: float
    offsets: Array
    next: Array
    discounts: Array
    lowers: Array
    shares: Array
    steps: Array
    probabilities: Array
    near: Array
    landed: Array
    landed_cells: Array
    landed_rewards: Array

    @property
    def state_count(self) -> int:
        """Number of states S."""
        return len(self.offsets) - 1

    @property
    def action_count(self) -> int:
        """Number of actions A."""
        return len(self.next)

    @property
    def nbytes(self) -> int:
        """Memory that successors and rewards take."""
        landed = self.landed_cells.nbytes + self.landed_rewards.nbytes
        return int(self.lowers.nbytes + self.shares.nbytes + self.near.nbytes + landed)

    def rewards(self, first: int, last: int) -> Array:
        """Return the rewards of actions ``first`` to ``last``, averaged over outcomes. Shape (n, C), float32."""
        layers, total = self.grid.layers, np.zeros((last - first, self.grid.cells), np.float32)
        for outcome, probability in enumerate(self.probabilities):
            near = np.broadcast_to(self.near[outcome, first:last], (last - first, self.grid.cells // layers))
            total += probability * np.repeat(near, layers, axis=1)
            offsets = self.landed[outcome * self.action_count + np.arange(first, last + 1)]
            rows = np.repeat(np.arange(last - first), np.diff(offsets))
            some = slice(offsets[0], offsets[-1])
            total[rows, self.landed_cells[some]] += probability * self.landed_rewards[some]
        return total


def build_model(
    actions: Actions,
    grid: Grid,
    terms: tuple[Term, ...],
    body: TargetBody,
    discount: float,
    movement: Movement | None = None,
) -> Model:
    """Return the model of one behaviour over the actions of a graph.

    Args:
        actions: The graph's actions.
        grid: The environment.
        terms: The reward's terms.
        body: Sizes of the target.
        discount: gamma, a control frame.
        movement: How the target moves; without it, it stands still.

    Raises:
        RecipeError: Training does not know a term or an axis.
    """
    from crowdsim.training.kernels.rewards import fill_near
    from crowdsim.training.kernels.successors import fill_successors

    movement = build_movement() if movement is None else movement
    moving, layers = len(grid.moving_axes), grid.layers
    axes = grid.pack()[:moving]
    axes[:, 5] /= layers
    targets = grid.targets()
    count, cells, ways = actions.action_count, grid.cells // layers, len(movement.probabilities)

    lowers = np.empty((ways, count, cells), np.uint16 if cells <= 65536 else np.int32)
    shares = np.empty((ways, count, cells, moving), np.float32)
    fill_successors(actions, axes, targets[::layers].copy(), movement.velocities, lowers, shares)

    packed, log_discount = pack_terms(terms, body), math.log(discount)
    near = np.empty((ways, count, 1 if _same_everywhere(terms) else cells), np.float32)
    xs, zs = targets[::layers, 0].copy(), targets[::layers, 2].copy()
    fill_near(actions, xs, zs, movement.velocities, packed, log_discount, near)
    landed = _landed_rewards(actions, grid, movement, packed, log_discount)
    return Model(
        grid=grid,
        discount=discount,
        offsets=actions.offsets,
        next=actions.next,
        discounts=(discount ** actions.lengths.astype(np.float64)).astype(np.float32),
        lowers=lowers,
        shares=shares,
        steps=corner_steps(grid),
        probabilities=movement.probabilities.astype(np.float32),
        near=near,
        landed=landed.offsets,
        landed_cells=landed.cells,
        landed_rewards=landed.rewards,
    )


def _landed_rewards(actions: Actions, grid: Grid, movement: Movement, packed: Array, log_discount: float) -> Landed:
    """Return what strikes earn where they land: offsets by outcome and action, cells and rewards (``Model``)."""
    from crowdsim.training.kernels.rewards import Landed, fill_landed

    targets, velocities = grid.targets(), movement.velocities
    offsets = np.zeros(len(movement.probabilities) * actions.action_count + 1, np.int64)
    counted = Landed(offsets, np.zeros(0, np.int32), np.zeros(0, np.float32))
    fill_landed(actions, targets, velocities, packed, log_discount, counted)
    np.cumsum(offsets, out=offsets)
    listed = Landed(offsets, np.empty(offsets[-1], np.int32), np.empty(offsets[-1], np.float32))
    fill_landed(actions, targets, velocities, packed, log_discount, listed)
    return listed


def _same_everywhere(terms: tuple[Term, ...]) -> bool:
    """Return whether rewards, those of landed strikes left out, do not depend on where the target is."""
    return all(
        isinstance(term, TransitionTerm) or (isinstance(term, StrikeTerm) and term.waste == 0.0) for term in terms
    )


def corner_steps(grid: Grid) -> Array:
    """Return the way from each moving cell to the corners above it, in cells of the table. Shape (M, 2^D), int32.

    Corner ``i`` takes the upper grid point on axis d where bit d of ``i`` is set.
    """
    moving = grid.moving_axes
    places = np.indices(tuple(axis.count for axis in moving)).reshape(len(moving), -1)
    steps = np.zeros((places.shape[1], 2 ** len(moving)), np.int32)
    for d, axis in enumerate(moving):
        assert AXIS_KINDS[axis.name].moves
        upper = (places[d] + 1) % axis.count if axis.wraps else np.minimum(places[d] + 1, axis.count - 1)
        step = (upper - places[d]) * grid.strides[d]
        for corner in range(steps.shape[1]):
            if corner >> d & 1:
                steps[:, corner] += step
    return steps

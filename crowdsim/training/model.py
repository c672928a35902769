"""The model that both solvers learn on: what each action earns in each cell, and where the target is seen afterwards.

With s a state, c a cell, a an action of s that takes T(a) control frames to the state s'(a):

    Q(a, c) = sum over o of p(o) [ r(a, c, o) + gamma^T(a) * next(s'(a), e(a, c, o)) ]

The target moves meanwhile with one of the velocities o, each with its probability p(o); e is where it is seen at the
end, which is between grid points. ``next`` is what the best action is worth there, by one of two backups (``BACKUPS``):

* ``max_of_interpolated``: the greatest interpolated Q, max over a' of sum of w Q(a', cell). It is the paper's.
* ``interpolation_of_max``: V(s', cell) = max over a' of Q(a', cell), interpolated. It is cheaper by the number of
  actions a state has, and never smaller, since every corner may take another action.

Where motion is mirrored, s* is the mirror image of the state s and c* that of the cell c, and V(s*, c*) = V(s, c). A
model may then hold the captured states alone: an action that ends in s* ends in s, where the mirror image of the target
is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.errors import RecipeError
from crowdsim.policy.actions import Actions
from crowdsim.policy.axes.axis import Target
from crowdsim.policy.axes.registry import kind_named
from crowdsim.policy.environment import Grid
from crowdsim.policy.rewards import StrikeTerm, TargetBody, Term, once_of, pack_terms, term_name

if TYPE_CHECKING:
    from crowdsim.training.kernels.rewards import Landed, Places
    from crowdsim.training.kernels.successors import Layers

BACKUPS = ("max_of_interpolated", "interpolation_of_max")

GROUND = ("distance", "bearing")
"""The axes over the ground, in the order of ``Model.axes``."""


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
    """Return a target at rest with probability ``still``, else walking in one of ``directions`` at ``speed`` [m/s].

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
    """The model as flat arrays.

    A actions, M cells over the ground, L layers, C = M L cells, O velocities of the target.

    Attributes:
        grid: The environment.
        discount: gamma, a control frame.
        offsets: CSR: actions of each state. Shape (S + 1,), int32.
        next: State in which each action ends, or whose mirror image that is. Shape (A,), int32.
        discounts: gamma^T of each action. Shape (A,), float32.
        axes: The distance and the bearing, ``kernels.successors.GROUND_AXIS``. One that the grid lacks has a single
            point. Shape (2,).
        ends: The ground where each action ends, ``kernels.successors.END``. Shape (O, A).
        layered: What each layer sees, how that changes while the avatar acts, and how the target moves; empty arrays
            where nothing does.
        xs: Where the target of each ground cell is, to the left [m]. Shape (M,), float32.
        zs: Ahead.
        probabilities: p(o). Shape (O,), float32.
        near: What each action earns in each ground cell, landed strikes left out: the reward there is for where the
            target is over the ground. Shape (O, A, M), float32; (O, A, 1) where it is the same everywhere, and (O, A,
            C) where a term needs more than the ground.
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
    axes: Array
    ends: Array
    layered: Layers
    xs: Array
    zs: Array
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

    def corners(self, first: int, last: int) -> tuple[Array, Array]:
        """Return where the targets are seen after actions ``first`` to ``last``: cells of a table, and their weights.

        Shapes (O, n, M, 4), int32, for the first layer, and float32; weights add up to 1.
        """
        from crowdsim.training.kernels.successors import list_corners

        shape = (len(self.probabilities), last - first, len(self.xs), 4)
        cells, weights = np.empty(shape, np.int32), np.empty(shape, np.float32)
        list_corners(self.axes, self.ends[:, first:last], self.xs, self.zs, cells, weights)
        return cells, weights

    def rewards(self, first: int, last: int) -> Array:
        """Return the rewards of actions ``first`` to ``last``, averaged over outcomes. Shape (n, C), float32."""
        layers, total = self.grid.layers, np.zeros((last - first, self.grid.cells), np.float32)
        for outcome, probability in enumerate(self.probabilities):
            near = self.near[outcome, first:last]
            if near.shape[1] != self.grid.cells:
                near = np.repeat(np.broadcast_to(near, (last - first, self.grid.cells // layers)), layers, axis=1)
            total += probability * near
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
        actions: The graph's actions, or those of the captured states alone, S of them: an action that ends in state
            S + s ends in the mirror image of state s.
        grid: The environment.
        terms: The reward's terms.
        body: Sizes of the target.
        discount: gamma, a control frame.
        movement: How the target moves; without it, it is at rest.

    Raises:
        RecipeError: A term or an axis is unknown to training.
    """
    from crowdsim.training.kernels.rewards import fill_near

    check_axes(terms, grid)
    movement = build_movement() if movement is None else movement
    layers, cells = grid.layers, grid.observed()
    xs, zs = (np.ascontiguousarray(place[::layers], np.float32) for place in (cells.x, cells.z))
    count, outcomes = actions.action_count, len(movement.probabilities)

    packed, log_discount = pack_terms(terms, body), math.log(discount)
    wide = 1 if _same_everywhere(terms) else len(xs)
    if any(not kind_named(name).over_ground for term in terms for name in term.axes) or (wide > 1 and grid.moves):
        wide, places = grid.cells, cells
    else:
        places = Target(*(number[::layers] for number in cells))
    near = np.empty((outcomes, count, wide), np.float32)
    for velocity, out in zip(movement.velocities, near, strict=True):
        share(
            count, fill_near, actions,
            places_of(places, places.vx + velocity[0], places.vz + velocity[1], grid.lasts),
            packed, once_of(terms, actions), log_discount, out,
        )  # fmt: skip
    landed = _landed_rewards(actions, grid, movement, packed, log_discount)
    return Model(
        grid=grid,
        discount=discount,
        offsets=actions.offsets,
        next=actions.next % np.int32(actions.state_count),
        discounts=(discount ** actions.lengths.astype(np.float64)).astype(np.float32),
        axes=ground_axes(grid),
        ends=action_ends(actions, movement, grid.lasts),
        layered=changing_layers(grid),
        xs=xs,
        zs=zs,
        probabilities=movement.probabilities.astype(np.float32),
        near=near,
        landed=landed.offsets,
        landed_cells=landed.cells,
        landed_rewards=landed.rewards,
    )


def check_axes(terms: tuple[Term, ...], grid: Grid) -> None:
    """Raise a ``RecipeError`` if a term needs an axis that a grid lacks."""
    names = [axis.name for axis in grid.axes]
    for term in terms:
        for name in term.axes:
            if name not in names:
                raise RecipeError(
                    f"reward term {term_name(term)!r} needs the axis {name!r}, the grid has {', '.join(names)}"
                )


def places_of(targets: Target, vx: ArrayLike, vz: ArrayLike, lasts: float) -> Places:
    """Return targets (arrays of M) that move for some frames [m a control frame] as training reads them."""
    from crowdsim.training.kernels.rewards import Places

    columns = targets.x, targets.z, vx, vz, np.sin(targets.heading), np.cos(targets.heading), targets.impact
    shape = np.shape(targets.x)
    rows = [np.ascontiguousarray(np.broadcast_to(one, shape), np.float32) for one in columns]
    return Places(*[*rows, np.float32(lasts)])


def _landed_rewards(actions: Actions, grid: Grid, movement: Movement, packed: Array, log_discount: float) -> Landed:
    """Return what strikes earn where they land: offsets by outcome and action, cells and rewards (``Model``)."""
    from crowdsim.training.kernels.rewards import Landed, fill_landed

    count, layers, targets = actions.action_count, 1 if grid.moves else grid.layers, np.stack(grid.observed()[:5], -1)
    movements = np.column_stack([movement.velocities, np.full(len(movement.probabilities), grid.lasts)])
    offsets = np.zeros(len(movement.probabilities) * count + 1, np.int64)
    counted = Landed(offsets, np.zeros(0, np.int32), np.zeros(0, np.float32))
    share(count, fill_landed, actions, targets, layers, movements, packed, log_discount, counted)
    np.cumsum(offsets, out=offsets)
    listed = Landed(offsets, np.empty(offsets[-1], np.int32), np.empty(offsets[-1], np.float32))
    share(count, fill_landed, actions, targets, layers, movements, packed, log_discount, listed)
    return listed


def _same_everywhere(terms: tuple[Term, ...]) -> bool:
    """Return whether rewards, those of landed strikes left out, do not depend on where the target is."""
    return all(term.at_frames is None and not (isinstance(term, StrikeTerm) and term.waste > 0.0) for term in terms)


def ground_axes(grid: Grid) -> Array:
    """Return the distance and the bearing of a grid as sweeps read them (``Model.axes``)."""
    from crowdsim.training.kernels.successors import GROUND_AXIS

    records = np.zeros(len(GROUND), GROUND_AXIS)
    records["per_step"] = records["count"] = 1.0
    for axis, stride in zip(grid.axes, grid.strides, strict=True):
        if axis.name in GROUND and axis.count > 1:
            facts = axis.first, 1.0 / axis.step, axis.count, axis.rate, axis.wraps, stride
            records[GROUND.index(axis.name)] = facts
    return records


def action_ends(actions: Actions, movement: Movement, lasts: float = math.inf) -> Array:
    """Return the ground frame in which each action ends, for each velocity of the target (``Model.ends``).

    The target moves for ``lasts`` control frames.
    """
    from crowdsim.training.kernels.successors import END

    x, z, heading = actions.displacements.T.astype(float)
    gone = movement.velocities[:, None, :] * np.minimum(actions.lengths, lasts)[:, None]
    ends = np.empty(gone.shape[:2], END)
    ends["left"], ends["ahead"] = gone[..., 0] - x, gone[..., 1] - z
    ends["cos"], ends["sin"], ends["turn"] = np.cos(heading), np.sin(heading), heading
    ends["frames"] = actions.lengths
    ends["side"] = np.where(actions.next < actions.state_count, 1.0, -1.0)
    return ends


def changing_layers(grid: Grid) -> Layers:
    """Return what the layers of a grid see, as sweeps read it; empty arrays of a grid in which nothing changes."""
    from crowdsim.training.kernels.successors import Layers

    cells, ground = grid.observed(), len(grid.ground_axes)
    axes = grid.pack()[ground:] if grid.changes else grid.pack()[:0]
    runs, vxs, vzs = np.zeros(0, np.int64), np.zeros(0, np.float32), np.zeros(0, np.float32)
    if grid.moves:
        vxs, vzs = cells.vx.astype(np.float32), cells.vz.astype(np.float32)
        ways = np.stack([vxs, vzs]).reshape(2, -1, grid.layers)
        other = (ways[..., 1:] != ways[..., :-1]).any(axis=(0, 1))
        runs = np.concatenate([[0], np.flatnonzero(other) + 1, [grid.layers]]).astype(np.int64)
    targets = Target(*(number[: grid.layers] for number in cells))
    return Layers(axes, measure_layers(grid, targets), runs, vxs, vzs, np.float32(grid.lasts))


def measure_layers(grid: Grid, targets: Target) -> Array:
    """Return what the axes of the layers of a grid measure of targets (arrays of N). Shape (N, axes)."""
    rows = [
        [axis.kind.value(Target(*one)) for axis in grid.layer_axes]
        for one in zip(*np.broadcast_arrays(*targets), strict=True)
    ]
    return np.array(rows).reshape(len(targets.x), len(grid.layer_axes))

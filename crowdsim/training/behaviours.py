"""One behaviour: its grid, its rewards and its model, solved into a table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.motion.database import MotionDatabase
from crowdsim.policy import bundle
from crowdsim.policy.actions import Actions, leading_actions
from crowdsim.policy.environment import Grid
from crowdsim.policy.policy import Behaviour, StateValues
from crowdsim.policy.rewards import TargetBody, Term
from crowdsim.training.mirroring import values_with_images
from crowdsim.training.ranges import resolve_grid, resolve_terms, sample_targets
from crowdsim.training.recipe import BehaviourSpec, QLearningSpec
from crowdsim.training.scales import SHOWN, action_values_at, advantages, decisive_scale, fades_of
from crowdsim.training.solution import Solution, q_table

if TYPE_CHECKING:
    from crowdsim.training.model import Model

STEPS = 4095
"""Steps of the values V that a table of Q in bytes is a backup of: several to one of the table's."""


@dataclass(frozen=True)
class Lesson:
    """A behaviour that is to be learned.

    Attributes:
        name: What progress calls it.
        spec: What is learned.
        database: The motion.
        actions: The graph's actions, or those of the captured states alone (``model.build_model``).
        body: Sizes of the target.
        progress: Called with (stage, done, total).
    """

    name: str
    spec: BehaviourSpec
    database: MotionDatabase
    actions: Actions
    body: TargetBody
    progress: Progress | None = None

    @cached_property
    def grid(self) -> Grid:
        """The grid of the behaviour's table."""
        return resolve_grid(self.spec, self.database)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The terms of its reward."""
        return resolve_terms(self.spec, self.database)

    def model_on(self, grid: Grid) -> Model:
        """Return the behaviour's model on a grid."""
        from crowdsim.training.model import build_model, build_movement

        target = self.spec.target
        movement = build_movement(target.speed, target.directions, target.still, self.database.control_rate)
        self._report("model", 0, 1)
        model = build_model(self.actions, grid, self.terms, self.body, self.spec.discount, movement)
        self._report("model", 1, 1)
        return model

    def solve(self, start: Array | None = None) -> Solution:
        """Return what the solver of the recipe finds; value iteration may start from values (S, C)."""
        from crowdsim.training.q_learning import q_learning
        from crowdsim.training.refinement import solve_by_levels
        from crowdsim.training.value_iteration import value_iteration

        spec, grid, report = self.spec, self.grid, self._report
        options = spec.solver.model_dump(exclude={"kind"})
        if isinstance(spec.solver, QLearningSpec):
            return q_learning(self.model_on(grid), progress=report, **options)
        if spec.backup == "max_of_interpolated" or start is not None:
            return value_iteration(self.model_on(grid), spec.backup, progress=report, start=start, **options)
        return solve_by_levels(self.model_on, grid, spec.finer, progress=report, **options)

    def judge(self, values: Array, targets: Array) -> tuple[Array, float]:
        """Return what every action is worth for some targets (A, N) by values V, and the scale on which that decides.

        Targets are those of ``ranges.sample_targets``.
        """
        worth = action_values_at(targets, self.grid, self.terms, values, self.spec.discount, self.actions, self.body)
        scale = decisive_scale(worth, self.actions, fades_of(self.grid, targets), float(np.abs(values).max()))
        return worth, scale

    def q_table(self, values: Array) -> Array:
        """Return the table of Q that is one backup of V over all states. Flat, float32."""
        return q_table(self.model_on(self.grid), values)

    def q_bytes(self, behind: StateValues) -> tuple[Array, float, float]:
        """Return the table of Q in bytes that is one backup of V, what an entry of 0 is worth, and what one more is.

        V is that in whole steps, so that the table follows from what a packed policy holds.
        """
        table = self.q_table((behind.low + behind.step * behind.table).astype(np.float32))
        return bundle.encode(advantages(table, self.actions, self.grid.cells, SHOWN * behind.spread), "int8")

    def _report(self, stage: str, done: int, total: int) -> None:
        if self.progress is not None:
            self.progress(f"{self.name}: {stage}", done, total)


def train_behaviour(
    name: str,
    spec: BehaviourSpec,
    database: MotionDatabase,
    actions: Actions,
    body: TargetBody,
    precision: str = "float32",
    progress: Progress | None = None,
    solved: int | None = None,
) -> tuple[Behaviour, Solution]:
    """Return one behaviour trained over the actions of a graph, and what its solver found.

    With ``solved`` (``mirroring.solved_states``) the other states are the mirror images of as many that are solved.
    """
    whole = Lesson(name, spec, database, actions, body, progress)
    lesson = whole if solved is None else replace(whole, actions=leading_actions(actions, solved))
    solution = lesson.solve()
    _, spread = lesson.judge(solution.values, sample_targets(database))
    if lesson.actions.state_count < actions.state_count:
        solution = replace(solution, values=values_with_images(solution.values, whole.grid))
    behind = None
    if spec.lookup == "v":
        stored, zero, step = bundle.encode(solution.values.ravel(), precision)
    elif precision == "int8" and solution.q is None:
        behind = StateValues(*bundle.whole_steps(solution.values.ravel(), STEPS), spread)
        stored, zero, step = whole.q_bytes(behind)
    else:
        table = whole.q_table(solution.values) if solution.q is None else solution.q
        if precision == "int8":
            table = advantages(table, actions, whole.grid.cells, SHOWN * spread)
        stored, zero, step = bundle.encode(table, precision)
    scale = spread if spec.normalise else 1.0
    return Behaviour(
        name, whole.grid, spec.lookup, stored, scale, whole.terms, spec.discount, zero, step, behind
    ), solution

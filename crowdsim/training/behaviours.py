"""One behaviour: its grid, its rewards and its model, solved into a table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
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
from crowdsim.training.recipe import BehaviourSpec, QLearningSpec
from crowdsim.training.scales import SHOWN, action_values_at, advantages, decisive_scale, fades_of
from crowdsim.training.solution import Solution, q_table

if TYPE_CHECKING:
    from crowdsim.training.model import Model

STEPS = 4095
"""Steps of the values V that a table of Q in bytes is a backup of: several to one of the table's."""


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
    from crowdsim.training.ranges import sample_targets

    own = actions if solved is None else leading_actions(actions, solved)
    model_on, grid, terms = prepare_models(name, spec, database, own, body, progress)
    solution = solve(name, spec, model_on, grid, progress)
    targets = sample_targets(database)
    worth = action_values_at(targets, grid, terms, solution.values, spec.discount, own, body)
    spread = decisive_scale(worth, own, fades_of(grid, targets), float(np.abs(solution.values).max()))
    if own.state_count < actions.state_count:
        solution = replace(solution, values=values_with_images(solution.values, grid))
    behind = None
    if spec.lookup == "v":
        stored, zero, step = bundle.encode(solution.values.ravel(), precision)
    elif precision == "int8" and solution.q is None:
        behind = StateValues(*bundle.whole_steps(solution.values.ravel(), STEPS), spread)
        stored, zero, step = bytes_behind(name, spec, database, actions, body, behind, progress)
    else:
        table = solution.q
        if table is None:
            table = _q_behind(name, spec, database, actions, body, solution.values, progress)
        if precision == "int8":
            table = advantages(table, actions, grid.cells, SHOWN * spread)
        stored, zero, step = bundle.encode(table, precision)
    scale = spread if spec.normalise else 1.0
    return Behaviour(name, grid, spec.lookup, stored, scale, terms, spec.discount, zero, step, behind), solution


def bytes_behind(
    name: str,
    spec: BehaviourSpec,
    database: MotionDatabase,
    actions: Actions,
    body: TargetBody,
    values: StateValues,
    progress: Progress | None = None,
) -> tuple[Array, float, float]:
    """Return the table of Q in bytes that is one backup of V, what an entry of 0 is worth, and what one more is.

    V is that in whole steps, so that the table follows from what a packed policy holds.
    """
    numbers = (values.low + values.step * values.table).astype(np.float32)
    table = _q_behind(name, spec, database, actions, body, numbers, progress)
    cells = len(table) // actions.action_count
    return bundle.encode(advantages(table, actions, cells, SHOWN * values.spread), "int8")


def _q_behind(
    name: str,
    spec: BehaviourSpec,
    database: MotionDatabase,
    actions: Actions,
    body: TargetBody,
    values: Array,
    progress: Progress | None,
) -> Array:
    """Return the table of Q that is one backup of V over all states. Flat, float32."""
    model_on, grid, _ = prepare_models(name, spec, database, actions, body, progress)
    return q_table(model_on(grid), values)


def prepare_models(
    name: str,
    spec: BehaviourSpec,
    database: MotionDatabase,
    actions: Actions,
    body: TargetBody,
    progress: Progress | None = None,
) -> tuple[Callable[[Grid], Model], Grid, tuple[Term, ...]]:
    """Return what builds a behaviour's model on a grid, the grid of its table, and the terms of its reward."""
    from crowdsim.training.model import build_model, build_movement
    from crowdsim.training.ranges import resolve_grid, resolve_terms

    terms, target = resolve_terms(spec, database), spec.target
    movement = build_movement(target.speed, target.directions, target.still, database.control_rate)
    report = _reporter(name, progress)

    def model_on(grid: Grid) -> Model:
        report("model", 0, 1)
        model = build_model(actions, grid, terms, body, spec.discount, movement)
        report("model", 1, 1)
        return model

    return model_on, resolve_grid(spec, database), terms


def solve(
    name: str,
    spec: BehaviourSpec,
    model_on: Callable[[Grid], Model],
    grid: Grid,
    progress: Progress | None = None,
    start: Array | None = None,
) -> Solution:
    """Return what the solver of a behaviour finds on its grid; value iteration may start from values (S, C)."""
    from crowdsim.training.q_learning import q_learning
    from crowdsim.training.refinement import solve_by_levels
    from crowdsim.training.value_iteration import value_iteration

    options = spec.solver.model_dump(exclude={"kind"})
    report = _reporter(name, progress)
    if isinstance(spec.solver, QLearningSpec):
        return q_learning(model_on(grid), progress=report, **options)
    if spec.backup == "max_of_interpolated":
        return value_iteration(model_on(grid), spec.backup, progress=report, **options)
    if start is not None:
        return value_iteration(model_on(grid), spec.backup, progress=report, start=start, **options)
    return solve_by_levels(model_on, grid, spec.finer, progress=report, **options)


def _reporter(name: str, progress: Progress | None) -> Progress:
    """Return progress that names the behaviour."""

    def report(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"{name}: {stage}", done, total)

    return report

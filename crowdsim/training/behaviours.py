"""One behaviour: its grid, its rewards and its model, solved into a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.core.types import Progress
from crowdsim.motion.database import MotionDatabase
from crowdsim.policy import bundle
from crowdsim.policy.actions import Actions
from crowdsim.policy.environment import Grid
from crowdsim.policy.policy import Behaviour
from crowdsim.policy.rewards import TargetBody
from crowdsim.training.recipe import BehaviourSpec, QLearningSpec
from crowdsim.training.scales import SHOWN, advantages, decisive_scale
from crowdsim.training.solution import Solution, q_table


def train_behaviour(
    name: str,
    spec: BehaviourSpec,
    database: MotionDatabase,
    actions: Actions,
    body: TargetBody,
    precision: str = "float32",
    progress: Progress | None = None,
) -> tuple[Behaviour, Solution]:
    """Return one behaviour trained over the actions of a graph, and what its solver found."""
    from crowdsim.training.model import Model, build_model, build_movement
    from crowdsim.training.q_learning import q_learning
    from crowdsim.training.ranges import resolve_grid, resolve_terms, sample_targets
    from crowdsim.training.refinement import solve_by_levels
    from crowdsim.training.value_iteration import value_iteration

    def report(stage: str, done: int, total: int) -> None:
        if progress is not None:
            progress(f"{name}: {stage}", done, total)

    grid = resolve_grid(spec, database)
    terms = resolve_terms(spec, database)
    target = spec.target
    movement = build_movement(target.speed, target.directions, target.still, database.control_rate)

    def model_on(one: Grid) -> Model:
        report("model", 0, 1)
        model = build_model(actions, one, terms, body, spec.discount, movement)
        report("model", 1, 1)
        return model

    options = spec.solver.model_dump(exclude={"kind"})
    if isinstance(spec.solver, QLearningSpec):
        solution = q_learning(model_on(grid), progress=report, **options)
    elif spec.backup == "max_of_interpolated":
        solution = value_iteration(model_on(grid), spec.backup, progress=report, **options)
    else:
        solution = solve_by_levels(model_on, grid, spec.finer, progress=report, **options)
    if spec.lookup == "v":
        table = solution.values.ravel()
    else:
        table = solution.q if solution.q is not None else q_table(model_on(grid), solution.values)
    table = np.asarray(table, dtype=np.float32)
    behaviour = Behaviour(name, grid, spec.lookup, table, 1.0, terms, spec.discount)
    spread = decisive_scale(behaviour, actions, body, sample_targets(database), float(np.abs(solution.values).max()))
    if spec.lookup == "q" and precision == "int8":
        table = advantages(table, actions, grid.cells, SHOWN * spread)
    stored, zero, step = bundle.encode(table, precision)
    scale = spread if spec.normalise else 1.0
    return replace(behaviour, table=stored, scale=scale, low=zero, step=step), solution

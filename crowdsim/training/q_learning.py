"""Q-learning: trial and error over every state, action and cell, again and again (paper, section 4).

A trial starts in a state, with the target in a grid cell; the avatar does an action, the target moves meanwhile in a
way that is drawn, the reward r is observed, and where the target is then, between grid points. Then

    Q(a, c) := Q(a, c) + alpha (r + gamma^T max over a' of Q(a', e) - Q(a, c))

with Q interpolated at e, which is the backup ``max_of_interpolated``. A round of exploration tries everything once;
rounds of exploitation between them try the action that is best so far, in every state and cell, and so spread what was
found. Every trial of a round reads the table of the round before, so rounds run on several threads and give the same
bytes on any number of them. An entry's draws begin at a hash of (seed, entry) and run on evenly. Step sizes settle:
alpha = (1 + visits / settle)^-omega.
"""

from __future__ import annotations

import time

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.core.workers import share
from crowdsim.training.kernels.exploration import Learning, try_best, try_everything
from crowdsim.training.kernels.q_tables import put, values_from_q
from crowdsim.training.model import Model
from crowdsim.training.solution import PUT, Solution, sweep_model


def q_learning(
    model: Model,
    tolerance: float = 1e-2,
    max_sweeps: int = 30,
    omega: float = 0.75,
    settle: float = 60.0,
    exploitations: int = 8,
    tries: int = 4,
    seed: int = 0,
    progress: Progress | None = None,
) -> Solution:
    """Return the values of a model, found by trial and error.

    Args:
        model: The model.
        tolerance: Rounds end when the temporal-difference error of exploration has a mean size below this share of the
            mean value.
        max_sweeps: They also end after this many rounds of exploration.
        omega: How fast step sizes fall, above 0.5 and up to 1, so that the noise of a moving target averages out.
        settle: Visits of an entry before they begin to fall.
        exploitations: Rounds of exploitation after each round of exploration.
        tries: Trials of an entry in a round of exploitation, where the target moves.
        seed: Seed of the draws.
        progress: Called with ("q-learning", rounds of exploration done, at most).
    """
    started, packed = time.perf_counter(), sweep_model(model)
    cells, layers = model.grid.cells, model.grid.layers
    q, other = (np.zeros(model.action_count * cells, np.float32) for _ in range(2))
    changes, visits = np.empty(model.state_count), np.zeros(len(q), np.uint16)
    tries = tries if len(model.probabilities) > 1 else 1
    rounds = max_sweeps * (1 + exploitations * tries)
    learning = Learning(visits, _step_sizes(rounds, omega, settle), seed)
    entries, found = (np.empty(model.state_count * cells, kind) for kind in (np.int64, np.float32))
    residuals: list[float] = []
    converged, played = False, 0
    while len(residuals) < max_sweeps and not converged:
        share(model.state_count, try_everything, packed, layers, q, other, learning, changes)
        q, other = other, q
        played += 1
        residuals.append(float(changes.sum()) / len(q))
        converged = residuals[-1] <= tolerance * float(np.mean(np.abs(q), dtype=np.float64))
        if progress is not None:
            progress("q-learning", len(residuals), max_sweeps)
        for _ in range(0 if converged else exploitations):
            share(model.state_count, try_best, packed, layers, q, entries, found, learning, tries)
            share(len(found), put, q, entries, found, least=PUT)
            played += 1
    values = np.empty_like(found)
    share(model.state_count, values_from_q, model.offsets, cells, q, values)
    return Solution(
        values=values.reshape(model.state_count, cells),
        q=q,
        solver="q_learning",
        backup="max_of_interpolated",
        sweeps=len(residuals),
        updates=len(residuals) * len(q) + (played - len(residuals)) * tries * len(values),
        residuals=tuple(residuals),
        seconds=time.perf_counter() - started,
        converged=converged,
    )


def _step_sizes(rounds: int, omega: float, settle: float) -> Array:
    """Return alpha by the number of visits before. Float32."""
    return np.asarray(((1.0 + np.arange(min(rounds, 65535)) / settle) ** -omega).astype(np.float32))

"""Tables that are learned in fights: the behaviour ``defend``, and the best response to a policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from crowdsim.core.threats import CELLS
from crowdsim.core.types import Array, Progress
from crowdsim.crowd.arrays import Model
from crowdsim.crowd.model import build_model
from crowdsim.policy.policy import Policy
from crowdsim.self_play.fights import Side, Tally, start_fights, watch_fights
from crowdsim.training.pursuit import TEMPERATURE
from crowdsim.training.recipe import DefenceSpec

UNNOTICED = 1e-9
"""Weight with which a table that is still empty is observed."""
KEPT = 0.6
"""What a decision of a round before counts in the next one."""
COMMON, CELLWISE = 30.0, 60.0
"""Decisions that an action's own hits must outweigh, those in all cells, and those in one."""


def learn_defence(policy: Policy, spec: DefenceSpec, weight: float = 1.0, progress: Progress | None = None) -> Array:
    """Return the hits that follow each action of a policy, learned in fights of its avatars.

    The avatar that learns defends itself by what the rounds before have found, against opponents that do not. A table
    that the policy has is not used. Shape (choice_count, CELLS), float32.
    """
    model = build_model([replace(policy, defence=None)])

    def with_table(table: Array) -> Model:
        return model._replace(defence=table)

    table = learn_table([policy], with_table, spec, weight, Side(TEMPERATURE), spec.counter, progress)
    return np.ascontiguousarray(table[: policy.actions.choice_count])


def learn_table(
    policies: Sequence[Policy],
    with_table: Callable[[Array], Model],
    spec: DefenceSpec,
    weight: float,
    opponent: Side,
    counter: float,
    progress: Progress | None = None,
) -> Array:
    """Return the hits that follow each action of the first of some policies, taken less landed, from rounds of fights.

    Args:
        policies: What the first of each pair has learned, then the other; one policy for both.
        with_table: Returns their model with a table (A, CELLS) of the first policy's.
        spec: How long is fought.
        weight: Weight of the table.
        opponent: How the other one of each pair chooses, which learns nothing.
        counter: What a hit is worth that the first one lands, over one that it takes.
        progress: Called with (stage, done, total).

    Returns:
        Shape (A, CELLS), float32.
    """
    table: Array = np.zeros((policies[0].actions.action_count, CELLS), np.float32)
    tally = Tally.empty(len(table))
    frames = round(spec.seconds * policies[0].database.control_rate)
    learners = np.arange(2 * spec.pairs) < spec.pairs
    for turn in range(spec.rounds):
        learner = Side(spec.temperature, weight if turn else UNNOTICED)
        tally.fade(KEPT)
        fights = start_fights(policies, with_table(table), spec.pairs, learner, opponent, spec.seed + turn)
        try:
            watch_fights(fights, frames, learners, tally, _reporter(progress, turn, spec.rounds))
        finally:
            fights.close()
        table = expected_hits(tally.taken, tally.count)
        table -= np.float32(counter) * expected_hits(tally.landed, tally.count)
    return table


def expected_hits(hits: Array, count: Array) -> Array:
    """Return the hits that are expected after each action in each cell, from sums over few decisions.

    An action that was seldom chosen in a cell is judged by how it does in all cells, over what is usual in them; and
    one that was seldom chosen at all by what is usual.

    Args:
        hits: Sums of hits. Shape (A, CELLS).
        count: Decisions. Shape (A, CELLS).

    Returns:
        Shape (A, CELLS), float32.
    """
    usual = hits.sum(axis=0) / np.maximum(count.sum(axis=0), 1.0)
    prior = COMMON * float(hits.sum() / max(count.sum(), 1.0))
    share = (hits.sum(axis=1) + prior) / np.maximum(count @ usual + prior, 1e-12)
    return ((hits + CELLWISE * share[:, None] * usual) / (count + CELLWISE)).astype(np.float32)


def _reporter(progress: Progress | None, turn: int, rounds: int) -> Callable[[int, int], None]:
    """Return progress over all rounds."""

    def report(done: int, frames: int) -> None:
        if progress is not None:
            progress("fights", turn * frames + done, rounds * frames)

    return report

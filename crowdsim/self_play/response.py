"""The best response to a policy that can be found by fighting it: how much it gains says how exploitable the policy is.

The response has the policy's own motion and behaviours, and learns by the hits that follow its actions, those that it
takes less those that it lands, against avatars that do not learn. What it finds is a lower bound of what can be gained.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crowdsim.core.threats import CELLS
from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Model
from crowdsim.crowd.model import build_model
from crowdsim.policy.defence import join_defences
from crowdsim.policy.policy import Policy
from crowdsim.self_play.fights import Side, start_fights
from crowdsim.self_play.learning import learn_table
from crowdsim.training.recipe import DefenceSpec

WEIGHTS = (0.15, 0.5, 1.0)
"""Weights of what is learned, of which the best one counts."""


def best_response(
    policy: Policy,
    temperature: float,
    spec: DefenceSpec,
    weights: Sequence[float] = WEIGHTS,
) -> dict[str, float]:
    """Return what the best response to a policy gains in a fight of two.

    Args:
        policy: The policy, with its weights, and its defence where it has learned that.
        temperature: Randomness of the policy's draws, see the type's key.
        spec: How long is fought.
        weights: Weights of what the response learns; the best one counts.

    Returns:
        ``gain``: hits per minute that the response lands more than it takes, over the policy itself in its place;
        ``landed`` and ``taken``: its hits per minute; ``weight``: the one that is best.
    """
    model = build_model([policy, policy])
    policies, shipped = [policy, policy], Side(temperature, policy.defence_weight)

    def with_table(table: Array | None) -> Model:
        """Return the model in which the first of each pair has another table."""
        first = np.zeros((0, CELLS), np.float32) if table is None else table
        return model._replace(defence=join_defences([first, policy.defence], [policy.actions.action_count] * 2))

    own_landed, own_taken = _hits_per_minute(policies, with_table(policy.defence), shipped, shipped, spec)
    found: list[dict[str, float]] = []
    for weight in weights:
        table = learn_table(policies, with_table, spec, weight, shipped, 1.0)
        landed, taken = _hits_per_minute(policies, with_table(table), Side(temperature, weight), shipped, spec)
        gain = landed - taken - (own_landed - own_taken)
        found.append({"gain": gain, "landed": landed, "taken": taken, "weight": weight})
    return max(found, key=lambda one: one["gain"])


def _hits_per_minute(
    policies: Sequence[Policy], model: Model, first: Side, other: Side, spec: DefenceSpec
) -> tuple[float, float]:
    """Return hits per minute that the first of each pair lands and takes, in fights of another seed."""
    fights = start_fights(policies, model, spec.pairs, first, other, spec.seed + 1000)
    try:
        events = fights.run(round(60.0 * fights.rate)).events
    finally:
        fights.close()
    hits = events.landed & (events.victim >= 0)
    ours = int((hits & (events.attacker < spec.pairs)).sum())
    return ours / spec.pairs, (int(hits.sum()) - ours) / spec.pairs

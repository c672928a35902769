"""Trained policies, behaviours learned beside theirs, and starts from which they are judged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rewards import ProximityTerm
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.evaluation import Composition, Episodes, EpisodeSettings, run_episodes
from crowdsim.training.fingerprint import capture_files
from crowdsim.training.mirroring import solved_states
from crowdsim.training.recipe import BehaviourSpec, Recipe, load_recipe
from crowdsim.training.train import ready_policy, train_policy
from crowdsim.training.trials import ARRIVED_WITHIN, CLOSE, LANDED_WITHIN, WALKED_AND_LANDED_WITHIN, starts_of_trials

POLICIES = Path(__file__).resolve().parents[2] / "policies"
LANDED = {False: LANDED_WITHIN, True: WALKED_AND_LANDED_WITHIN}
"""By when an episode has succeeded [s]: by a landed strike, without and with a walk before it."""

QUICK = {"distance": 8, "bearing": 8, "height": 2}
"""Most points of each axis in a quick run."""


@dataclass(frozen=True)
class Sizes:
    """How much a benchmark does.

    Attributes:
        starts: Random starts.
        searched: How many of them are searched from.
        width: Nodes of the beam.
        depth: Actions from its root to its leaves.
    """

    starts: int = 400
    searched: int = 100
    width: int = 128
    depth: int = 10


TINY = Sizes(starts=24, searched=8, width=8, depth=3)


def trained(stem: str, mocap: str | None, threads: int) -> tuple[Recipe, Policy]:
    """Return a shipped recipe and its policy, which is trained first where it is missing or stale."""
    path = POLICIES / f"{stem}.yaml"
    return load_recipe(path), ready_policy(path, mocap, threads)


def quickly_trained(stem: str, mocap: str | None, threads: int) -> tuple[Recipe, Policy]:
    """Return a recipe of the same behaviours that is learned in seconds, and its policy.

    It has little motion, one file of capture, a narrow graph and coarse grids.
    """
    recipe = load_recipe(POLICIES / f"{stem}.yaml")
    outcome = recipe.model_dump(mode="json")
    if recipe.motion.capture is not None and mocap is not None:
        outcome["motion"]["capture"]["clips"] = [str(capture_files(recipe, mocap)[0].relative_to(mocap))]
    else:
        outcome["motion"]["performer"]["seconds"] = 24.0
    outcome["graph"]["branching"] = 6
    for spec in outcome["behaviours"].values():
        spec["solver"]["tolerance"] = 0.05
        for name, axis in spec["axes"].items():
            if axis is not None:
                axis["count"] = min(axis["count"], QUICK[name])
    recipe = Recipe.model_validate(outcome)
    return recipe, train_policy(recipe, stem, mocap, threads)[0]


def train(policy: Policy, name: str, spec: BehaviourSpec, precision: str = "float32") -> Behaviour:
    """Return a behaviour trained over the policy's actions."""
    solved = solved_states(policy.database, policy.graph, [spec])
    return train_behaviour(name, spec, policy.database, policy.actions, policy.body, precision, solved=solved)[0]


def changed(spec: BehaviourSpec, counts: dict[str, int], **more: Any) -> BehaviourSpec:
    """Return a behaviour with other numbers of grid points and other settings."""
    outcome = spec.model_dump(mode="json")
    for axis, count in counts.items():
        outcome["axes"][axis]["count"] = count
    return BehaviourSpec.model_validate({**outcome, **more})


def reference(policy: Policy, name: str, spec: BehaviourSpec) -> Behaviour:
    """Return a behaviour on a grid of four times the cells: twice the distances, twice the bearings."""
    counts = {axis: one.count * (1 if axis == "height" else 2) for axis, one in spec.axes.given().items()}
    return train(policy, name, changed(spec, counts, lookup="v", finer=1))


def play(
    policy: Policy,
    behaviour: Behaviour,
    states: Any,
    targets: Any,
    composition: Composition | None = None,
    threads: int = 1,
    **options: Any,
) -> Episodes:
    """Return what came of a behaviour from each start."""
    rate, settings = policy.database.control_rate, EpisodeSettings(**options)
    return run_episodes(policy.actions, behaviour, policy.body, rate, states, targets, settings, composition, threads)


def starts_for(policy: Policy, spec: BehaviourSpec, count: int) -> tuple[Any, Any]:
    """Return states and targets from which a behaviour is judged.

    For one that is rewarded for strikes alone targets are where they reach, for one that is rewarded for being near
    alone they are further away, and for one that is rewarded for both they are half and half.
    """
    walks = any(isinstance(term, ProximityTerm) for term in spec.rewards)
    return starts_of_trials(policy, spec.strikes, walks, count)


def wanted_within(behaviour: Behaviour) -> float:
    """Return how near a target must be to be where a behaviour wants it, give or take ``CLOSE`` [m]."""
    return max((term.between[1] for term in behaviour.terms if isinstance(term, ProximityTerm)), default=0.5) + CLOSE


def success(spec: BehaviourSpec, episodes: Episodes) -> tuple[float, float | None]:
    """Return the share of episodes that succeed in time, and the median time of those that ever do, if any [s]."""
    walks = any(isinstance(term, ProximityTerm) for term in spec.rewards)
    times = episodes.landings if spec.strikes else episodes.arrivals
    in_time = LANDED[walks] if spec.strikes else ARRIVED_WITHIN
    share = float(np.mean(times <= in_time))
    return share, float(np.nanmedian(times)) if np.isfinite(times).any() else None

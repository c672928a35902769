"""From a scenario to a crowd that is ready for its first frame: policies, what is constant, memory and room on disk."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crowdsim import assets
from crowdsim.core.types import FileName, Progress
from crowdsim.errors import RecipeError, RunError
from crowdsim.machine import available_memory
from crowdsim.scenario.scenario import Scenario
from crowdsim.take.data import Cast, TakeHeader

if TYPE_CHECKING:
    from crowdsim.crowd.crowd import Crowd
    from crowdsim.crowd.placement import Placed
    from crowdsim.crowd.script import Script
    from crowdsim.policy.policy import Policy


TRAINING_MINUTES = 2.0
"""Roughly what the training of a shipped policy takes on one core, compilation included [min]."""
LARGE = 20_000
"""Avatars from which on a run reports beforehand what it needs."""

_BASE_BYTES, _AVATAR_BYTES, _FRAME_BYTES, _DISK_BYTES = 400e6, 1200.0, 6.0, 20.0
"""Memory of a run: of the program and a policy, an avatar, an avatar-frame's strikes; and what a take holds of it on
disk at most. Measured with the shipped crowds, rounded up."""


@dataclass(frozen=True)
class Prepared:
    """A scenario ready to be run.

    Attributes:
        policies: Its policies.
        cast: What is constant for each avatar.
        crowd: The crowd before its first frame.
        script: What is planned.
        frames: Control frames.
        rate: Control frames a second.
        header: What is known of the take.
    """

    policies: Sequence[Policy]
    cast: Cast
    crowd: Crowd
    script: Script
    frames: int
    rate: float
    header: TakeHeader


def load_policies(
    scenario: Scenario, mocap: FileName | None = None, threads: int = 1, progress: Progress | None = None
) -> list[Policy]:
    """Return the policies that a scenario's types use, in the order of their types; trained when missing or stale.

    Args:
        scenario: The scenario, resolved.
        mocap: Folder of capture; by default that of the recipe, else of the variable ``CROWDSIM_MOCAP``.
        threads: Threads for training.
        progress: Called with stage, done and total.

    Raises:
        RecipeError: A recipe is invalid.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
    """
    from crowdsim.policy.bundle import load_policy
    from crowdsim.self_play.train import ready_policy

    policies = []
    for name in policy_names(scenario):
        shared = shared_bundle(name, mocap)
        policy = ready_policy(name, mocap, threads, progress) if shared is None else load_policy(shared)
        # A bundle goes by the name that the scenario calls it, wherever it was trained.
        policies.append(replace(policy, name=name))
    return policies


def shared_bundle(name: FileName, mocap: FileName | None = None) -> Path | None:
    """Return the bundle of a recipe that another user has trained beside it; None where it is missing or stale.

    Raises:
        RecipeError: The recipe is invalid.
        PolicyError: Capture is not in the folder given for it, or the bundle is foreign or damaged.
    """
    from crowdsim.training.contexts import naming
    from crowdsim.training.recipe import load_recipe
    from crowdsim.training.train import stale

    if (Path(name) / "policy.json").is_file():
        return None
    try:
        path = assets.find_recipe(name)
    except RecipeError:
        return None
    shared = assets.shared_folder(path)
    if shared == assets.bundle_folder(path) or not (shared / "policy.json").is_file():
        return None
    with naming(path):
        return None if stale(shared, load_recipe(path), mocap) else shared


def policy_names(scenario: Scenario) -> list[str]:
    """Return the names of the policies that a scenario's types use, in the order of the types."""
    return list(dict.fromkeys(kind.policy for name, kind in scenario.types.items() if name in scenario.used_types))


def untrained_policies(scenario: Scenario, mocap: FileName | None = None) -> list[str]:
    """Return the names of the policies of a scenario that have to be trained first.

    Raises:
        RecipeError: A recipe is invalid.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
    """
    from crowdsim.training.train import is_trained

    return [
        name for name in policy_names(scenario) if shared_bundle(name, mocap) is None and not is_trained(name, mocap)
    ]


def training_notice(name: str, threads: int) -> str:
    """Return the notice printed before a policy is trained: about how long it takes, compilation included."""
    minutes = max(1, round(TRAINING_MINUTES / threads))
    cores = "1 core" if threads < 2 else f"{threads} cores"
    return f"training policy {name!r} takes about {minutes} min on {cores}, and is done once"


def kernel_uses(scenario: Scenario, untrained: Sequence[str] = ()) -> list[str]:
    """Return what a scenario needs kernels for, in the order of need (``jit.signatures``).

    Args:
        scenario: The scenario, resolved.
        untrained: Policies that have to be trained first.

    Raises:
        RecipeError: A recipe is invalid.
        PolicyError: A policy is missing, or its bundle is damaged.
    """
    from crowdsim.crowd.cast import table_type_of
    from crowdsim.crowd.simulation import SMALL

    size = "few" if scenario.avatar_count <= SMALL else "many"
    needed = {
        "training": bool(untrained),
        f"{size} {table_type_of(policy_names(scenario))}": True,
        **{output.kernels: True for output in scenario.outputs.wanted() if output.kernels},
    }
    return [use for use, is_needed in needed.items() if is_needed]


def prepare(scenario: Scenario, policies: Sequence[Policy], placed: Placed | None = None) -> Prepared:
    """Return a scenario with its policies, ready to be run.

    Raises:
        ScenarioError: Not all avatars fit, or a type weighs a behaviour that its policy has not learned.
        RunError: The policies' control rates differ.
    """
    from crowdsim.crowd.cast import cast_crowd
    from crowdsim.crowd.placement import place_groups

    rates = {policy.name: float(policy.database.control_rate) for policy in policies}
    if len(set(rates.values())) > 1:
        result = ", ".join(f"{name} has {rate:g}" for name, rate in rates.items())
        raise RunError(f"{scenario.name}: policies of one run need one control rate, but {result}")
    placed = placed or place_groups(scenario)
    crowd, script = cast_crowd(scenario, placed, policies)
    rate = next(iter(rates.values()))
    cast = build_cast(scenario, placed, policies)
    fingerprints = tuple(policy.fingerprint for policy in policies)
    targets = tuple(scenario.targets)
    options = scenario.reactions, scenario.collision_avoidance
    header = TakeHeader(cast, rate, scenario.name, scenario.seed, fingerprints, targets, *options)
    return Prepared(policies, cast, crowd, script, scenario.control_frames(rate), rate, header)


def build_cast(scenario: Scenario, placed: Placed, policies: Sequence[Policy]) -> Cast:
    """Return what is constant for each avatar."""
    from crowdsim.crowd.cast import policies_of_types
    from crowdsim.crowd.distributions import draw_numbers
    from crowdsim.crowd.stances import draw_stances

    kinds = list(scenario.types.values())
    owner, stances = policies_of_types(scenario, policies), draw_stances(scenario, placed.type)
    colours = [[np.nan] * 3 if kind.colour is None else _rgb(kind.colour) for kind in kinds]
    return Cast(
        names=np.array(scenario.avatar_names()),
        types=placed.type.astype(np.int16),
        teams=placed.team.astype(np.int16),
        policies=owner[placed.type],
        scales=placed.scale.astype(np.float32),
        speeds=placed.speed.astype(np.float32),
        type_names=tuple(placed.types),
        team_names=tuple(placed.teams),
        policy_names=tuple(policy.name for policy in policies),
        colours=np.array(colours, float).reshape(-1, 3),
        girths=placed.girth.astype(np.float32),
        legs=draw_numbers(scenario, placed.type, "legs").astype(np.float32),
        arms=draw_numbers(scenario, placed.type, "arms").astype(np.float32),
        tempos=draw_numbers(scenario, placed.type, "tempo").astype(np.float32),
        aggressions=draw_numbers(scenario, placed.type, "aggression").astype(np.float32),
        ranges=draw_numbers(scenario, placed.type, "range").astype(np.float32),
        stances=stances if len(stances) else np.zeros(placed.count, np.uint8),
    )


def _rgb(colour: str) -> list[float]:
    return [int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5)]


def estimate_needs(avatars: int, frames: int) -> tuple[float, float]:
    """Return about how much memory a run takes, and at most how much room on disk without its outputs [bytes]."""
    return _BASE_BYTES + avatars * (_AVATAR_BYTES + frames * _FRAME_BYTES), avatars * frames * _DISK_BYTES


def needs(avatars: int, frames: int, folder: Path) -> str:
    """Return a sentence on the memory and room on disk that a run takes, and whether there is as much."""
    memory, room = estimate_needs(avatars, frames)
    result = f"{avatars:,} avatars x {frames:,} control frames take up to {memory / 1e9:.1f} GB of memory and "
    result += f"{room / 1e9:.1f} GB on disk, without outputs"
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(existing).free
    available = available_memory()
    if available is not None and memory > available:
        result += f"; only {available / 1e9:.1f} GB of memory are free"
    if room > free:
        result += f"; only {free / 1e9:.1f} GB are free in {existing}"
    return result

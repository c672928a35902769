"""From a scenario to a crowd that is ready for its first frame: policies, what is constant, memory and room on disk."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowdsim import assets
from crowdsim.core.types import FileName, Progress
from crowdsim.errors import RecipeError
from crowdsim.machine import available_memory
from crowdsim.policy.checks import DEFENCE
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.policy.flattening import STORED
from crowdsim.scenario.scenario import Scenario, check_loaded
from crowdsim.take.header import TakeHeader

if TYPE_CHECKING:
    from crowdsim.crowd.crowd import Crowd
    from crowdsim.policy.policy import Policy
    from crowdsim.training.recipe import Recipe


TRAINING_MINUTES = 2.0
"""Roughly what the training of a shipped policy takes on one core, compilation included [min]."""
LARGE = 20_000
"""Avatars from which on a run reports beforehand what it needs."""

_BASE_BYTES, _AVATAR_BYTES, _FRAME_BYTES, _DISK_BYTES = 400e6, 1200.0, 6.0, 20.0
"""Memory of a run: of the program and a policy, an avatar, an avatar-frame's strikes; and what a take holds of it on
disk at most. Measured with the shipped crowds, rounded up."""


def load_policies(
    scenario: Scenario, mocap: FileName | None = None, threads: int = 1, progress: Progress | None = None
) -> list[Policy]:
    """Return the policies that a scenario's types use, in the order of their types; trained when missing or stale.

    Capture is in the folder ``mocap``; by default that of the recipe, else of the variable ``CROWDSIM_MOCAP``.

    Raises:
        RecipeError: A recipe is invalid.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        ScenarioError: ``scenario`` is none.
    """
    from crowdsim.policy.bundle import load_policy
    from crowdsim.self_play.train import ready_policy

    check_loaded(scenario)
    policies = []
    for name in policy_names(scenario):
        shared = shared_bundle(name, mocap)
        policy = ready_policy(name, mocap, threads, progress) if shared is None else load_policy(shared)
        # A bundle goes by the name that the scenario calls it, wherever it was trained.
        policies.append(replace(policy, name=name))
    return policies


def shared_bundle(name: FileName, mocap: FileName | None = None) -> Path | None:
    """Return the bundle of a recipe that another user has trained beside it; None where it is missing or stale."""
    from crowdsim.training.recipe import load_recipe
    from crowdsim.training.train import naming, stale

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
    """Return the names of the policies of a scenario that have to be trained first."""
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

    ``untrained`` are policies that have to be trained first.
    """
    from crowdsim.crowd.simulation import SMALL

    size = "few" if scenario.avatar_count <= SMALL else "many"
    needed = {
        "training": bool(untrained),
        # Training ends with duels.
        **({f"few {table_type_of(untrained)}": True} if untrained else {}),
        f"{size} {table_type_of(policy_names(scenario))}": True,
        **{output.kernels: True for output in scenario.outputs.wanted() if output.kernels},
    }
    return [use for use, is_needed in needed.items() if is_needed]


def take_header(scenario: Scenario, crowd: Crowd) -> TakeHeader:
    """Return what is known of the take of a run before its first frame."""
    return TakeHeader(
        crowd.cast,
        crowd.rate,
        scenario.name,
        scenario.seed,
        tuple(policy.fingerprint for policy in crowd.policies),
        tuple(scenario.targets),
        scenario.reactions,
        scenario.collision_avoidance,
    )


def learned_behaviours(policy: str) -> list[str]:
    """Return the behaviours of a policy by its name, trained or not."""
    recipe, document = _recipe_or_bundle(policy)
    if recipe:
        return [*recipe.behaviours, *([DEFEND] if recipe.defend is not None else [])]
    named = [str(behaviour["name"]) for behaviour in document["behaviours"]]
    return [*named, *([DEFEND] if f"{DEFENCE}.npy" in document["files"] else [])]


def reacts_to_strikes(policy: str) -> bool:
    """Return whether avatars of a policy, by its name and trained or not, react to strikes of their opponents."""
    from crowdsim.crowd.draw import sees_strikes

    recipe, document = _recipe_or_bundle(policy)
    if recipe:
        axes = {name for one in recipe.behaviours.values() for name in one.axes.given()}
    else:
        axes = {str(axis["name"]) for one in document["behaviours"] for axis in one["axes"]}
    return sees_strikes(learned_behaviours(policy), axes)


def control_rate_of(policy: str) -> float:
    """Return the control rate of a policy by its name, trained or not [Hz]."""
    recipe, document = _recipe_or_bundle(policy)
    return float(recipe.control_rate if recipe else document["database"]["control_rate"])


def table_type_of(policies: Sequence[str]) -> str:
    """Return the type of the tables that control reads in a run of some policies, by their names, trained or not."""
    found = set()
    for policy in policies:
        recipe, document = _recipe_or_bundle(policy)
        found.add(STORED[recipe.precision if recipe else document["recipe"]["precision"]])
    # float16 is read as float32, and so are tables of several types.
    return found.pop() if found in ({"uint8"}, {"uint16"}) else "float32"


def _recipe_or_bundle(policy: str) -> tuple[Recipe | None, Mapping[str, Any]]:
    """Return the recipe of a policy, or None and what the bundle of a policy without a recipe says.

    Raises:
        RecipeError: The recipe is invalid.
        PolicyError: There is no such policy, or its bundle is damaged.
    """
    from crowdsim.policy.bundle import read_document
    from crowdsim.training.recipe import load_recipe

    try:
        path = assets.find_recipe(policy)
    except RecipeError:
        return None, read_document(assets.find_bundle(policy))
    return load_recipe(path), {}


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

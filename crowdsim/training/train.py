"""Training: from a recipe to a bundle, one process at a time, and only when there is none yet or it is stale."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from crowdsim import assets
from crowdsim.core.types import Array, FileName, Progress
from crowdsim.core.workers import limited
from crowdsim.errors import CrowdsimError, MotionError, PolicyError, RecipeError, VersionError, under_way
from crowdsim.graph.motion_graph import MotionGraph
from crowdsim.motion.database import MotionDatabase
from crowdsim.policy import bundle
from crowdsim.policy.actions import Actions, build_actions
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.policy.falls import add_falls
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rests import add_rests
from crowdsim.policy.rewards import target_body
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.fingerprint import capture_files, combine, fingerprints_of
from crowdsim.training.motion_loading import load_motion
from crowdsim.training.packing import read_packed, unpack_policy
from crowdsim.training.recipe import DefenceSpec, Recipe, load_recipe, plain
from crowdsim.training.solution import Solution

Sparring = Callable[[Policy, DefenceSpec, float, Progress | None], Array]
"""Returns what avatars of a policy learn about defence, by a section of its recipe and the behaviour's weight."""
Grading = Callable[[Policy, Progress | None], dict[str, Any]]
"""Returns how a policy fights itself, plain data."""


def train_recipe(
    name: FileName,
    mocap: FileName | None = None,
    threads: int = 1,
    force: bool = False,
    progress: Progress | None = None,
    spar: Sparring | None = None,
    grade: Grading | None = None,
) -> tuple[Path, bool]:
    """Train a recipe into its bundle, unless that is up to date; return its folder, and whether it was trained.

    A bundle that is packed with the package, and is up to date, is unpacked instead.

    Args:
        name: The recipe's file, or its name.
        mocap: Folder of motion capture (``fingerprint.capture_folder``).
        threads: Threads to use; the bundle has the same bytes for any number.
        force: Train even when the bundle is up to date.
        progress: Called with (stage, done, total).
        spar: Learns the behaviour ``defend``, for recipes that ask for it (``self_play``).
        grade: Lets the policy fight itself when it is trained (``self_play``); without it the bundle reports no duel.

    Raises:
        RecipeError: The recipe is invalid.
        PolicyError: Capture is missing.
        MotionError: The motion cannot be used: clips, strikes, graph.
        OutputError: Something else has the bundle's name.
        RunError: The bundle cannot be written; nothing is left half-written, and one that is there stays.
    """
    path = assets.find_recipe(name)
    recipe = load_recipe(path)
    folder = assets.bundle_folder(path)
    with naming(path):
        if not force and not stale(folder, recipe, mocap):
            return folder, False
        with alone(folder, progress) as waited:
            restored = bundle.tidy(folder)
            if (waited or restored) and not force and not stale(folder, recipe, mocap):
                return folder, False
            bundle.check_name(folder)
            packed = None if force else _packed(path, recipe, mocap)
            if packed is not None:
                with limited(threads), under_way():
                    unpack_policy(packed, folder, progress)
                return folder, False
            policy, timings = train_policy(recipe, path.stem, mocap, threads, progress, spar, grade)
            with under_way():
                bundle.write_bundle(folder, policy, timings)
    return folder, True


def ready_policy(
    name: FileName,
    mocap: FileName | None = None,
    threads: int = 1,
    progress: Progress | None = None,
    spar: Sparring | None = None,
    grade: Grading | None = None,
) -> Policy:
    """Return the trained policy of a recipe or a bundle by path or name; trained first when it is missing or stale.

    Where the capture is missing, a bundle that was trained on it before is used.

    Raises:
        RecipeError: There is no such recipe, or it is invalid.
        PolicyError: The bundle is foreign or damaged, or must be trained and its capture is missing.
        MotionError: The motion cannot be used.
        OutputError: The bundle cannot be written.
    """
    given = Path(name)
    if (given / "policy.json").is_file():
        return bundle.load_policy(given)
    try:
        assets.find_recipe(name)
    except RecipeError:
        return bundle.load_policy(assets.find_bundle(name))
    folder, _ = train_recipe(name, mocap, threads, False, progress, spar, grade)
    return bundle.load_policy(folder)


def is_trained(name: FileName, mocap: FileName | None = None) -> bool:
    """Return whether ``ready_policy`` need not train.

    Raises:
        RecipeError: The recipe is invalid.
        PolicyError: The bundle is foreign or damaged, or capture is not in the folder given for it.
    """
    try:
        path = assets.find_recipe(name)
    except RecipeError:
        return True
    with naming(path):
        if (Path(name) / "policy.json").is_file():
            return True
        recipe = load_recipe(path)
        return not stale(assets.bundle_folder(path), recipe, mocap) or _packed(path, recipe, mocap) is not None


def find_bundle(name: FileName, progress: Progress | None = None) -> Path:
    """Return the folder of a trained bundle, as ``assets.find_bundle`` does; one that is only packed is unpacked.

    Raises:
        RecipeError: The recipe is invalid.
        PolicyError: There is none, or it is foreign or damaged.
        OutputError: What is unpacked cannot be written.
    """
    packed = None
    if not (Path(name) / "policy.json").is_file():
        with suppress(RecipeError):
            packed = assets.packed_policy(assets.find_recipe(name))
    if packed is not None and is_trained(name):
        return train_recipe(name, progress=progress)[0]
    return assets.find_bundle(name)


def stale(folder: Path, recipe: Recipe, mocap: FileName | None = None) -> str:
    """Return why the bundle in a folder is not what the recipe would train now, or an empty string when it is.

    Raises:
        PolicyError: The folder holds a bundle that is foreign or damaged, or capture is not in the folder given for it.
    """
    if not (folder / "policy.json").is_file():
        return "there is none yet"
    try:
        document = bundle.read_document(folder)
    except VersionError:
        return "it is of another format version"
    changed = _changed_parts(document, recipe, mocap)
    return f"its {' and '.join(changed)} changed" if changed else ""


def _packed(path: Path, recipe: Recipe, mocap: FileName | None) -> Path | None:
    """Return the packed policy of a recipe's file; None where there is none, or it is stale."""
    packed = assets.packed_policy(path)
    if packed is None or _changed_parts(read_packed(packed)["policy"], recipe, mocap):
        return None
    return packed


def _changed_parts(document: Mapping[str, Any], recipe: Recipe, mocap: FileName | None) -> list[str]:
    """Return what a bundle was made from that is no longer what the recipe would train from; see ``stale``."""
    try:
        files = capture_files(recipe, mocap) if recipe.motion.capture is not None else None
    except PolicyError:
        if mocap is not None:
            raise
        files = None
    now = fingerprints_of(recipe, files)
    return [part for part, value in now.items() if document["fingerprints"].get(part) != value]


def train_policy(
    recipe: Recipe,
    name: str,
    mocap: FileName | None = None,
    threads: int = 1,
    progress: Progress | None = None,
    spar: Sparring | None = None,
    grade: Grading | None = None,
) -> tuple[Policy, dict[str, Any]]:
    """Return a policy trained by a recipe, and what training took: seconds by stage and by behaviour.

    Raises:
        PolicyError: Capture is missing.
        MotionError: The motion cannot be used, or holds no strikes where behaviours need them.
    """
    from crowdsim.graph.motion_graph import build_graph
    from crowdsim.training.pruning import prune_graph
    from crowdsim.training.statistics import policy_statistics, with_rests

    with limited(threads):
        started = time.perf_counter()
        files = capture_files(recipe, mocap)
        prints = fingerprints_of(recipe, files)
        changes: dict[str, str] = {}
        database = load_motion(recipe, files, progress, changes)
        moved = time.perf_counter()
        body = target_body(database)
        graph = build_graph(database, recipe.graph, progress)
        built = time.perf_counter()
        if recipe.prune is not None:
            graph = prune_graph(database, graph, recipe.behaviours, body, recipe.prune, progress)
        actions = build_actions(database, graph)
        timings: dict[str, Any] = {"motion": moved - started, "graph": built - moved, "behaviours": {}}
        timings["prune"] = time.perf_counter() - built
        trained, solutions = _train_behaviours(recipe, database, graph, actions, timings, progress)
        behaviours, values = _join_tables(trained)
        policy = Policy(
            name=name,
            database=database,
            graph=graph,
            actions=actions,
            behaviours=behaviours,
            body=body,
            values=values,
            recipe=plain(recipe),
            statistics={},
            fingerprint=combine(prints),
            fingerprints=prints,
        )
        statistics = policy_statistics(policy, solutions) | ({"retargeted": changes} if changes else {})
        graph, actions, falls = add_falls(database, graph, actions, recipe.graph)
        seconds = None if recipe.rest is None else recipe.rest.seconds
        graph, actions, rests = add_rests(database, graph, actions, recipe.graph, seconds)
        statistics = statistics if seconds is None else with_rests(statistics, graph, rests)
        policy = replace(policy, statistics=statistics, graph=graph, actions=actions, falls=falls, rests=rests)
        policy = _with_defence(policy, recipe, spar, timings, progress)
        if grade is not None:
            begun = time.perf_counter()
            policy = replace(policy, statistics={**policy.statistics, "duel": grade(policy, progress)})
            timings["duel"] = time.perf_counter() - begun
    return policy, timings


def _train_behaviours(
    recipe: Recipe,
    database: MotionDatabase,
    graph: MotionGraph,
    actions: Actions,
    timings: dict[str, Any],
    progress: Progress | None,
) -> tuple[list[Behaviour], dict[str, Solution]]:
    """Return the behaviours of a recipe and what their solvers found, by name; note how long each took."""
    from crowdsim.training.mirroring import solved_states

    body = target_body(database)
    trained, solutions = [], {}
    for label, spec in recipe.behaviours.items():
        begun = time.perf_counter()
        n = solved_states(database, graph, [spec])
        one, solutions[label] = train_behaviour(label, spec, database, actions, body, recipe.precision, progress, n)
        trained.append(one)
        timings["behaviours"][label] = _timing(solutions[label], time.perf_counter() - begun)
    return trained, solutions


def _with_defence(
    policy: Policy, recipe: Recipe, spar: Sparring | None, timings: dict[str, Any], progress: Progress | None
) -> Policy:
    """Return the policy with what it learns in fights, if its recipe asks for that; note how long that took."""
    if recipe.defend is None:
        return policy
    if spar is None:
        raise PolicyError("defend: is learned in fights, expected training by crowdsim.train_recipe")
    begun = time.perf_counter()
    weight = (recipe.weights or {}).get(DEFEND, 0.0 if recipe.weights else 1.0)
    table = spar(policy, recipe.defend, weight, progress)
    timings["defend"] = time.perf_counter() - begun
    return replace(policy, defence=table)


def _timing(solution: Solution, seconds: float) -> dict[str, float]:
    """Return what a behaviour took, ``seconds`` in all."""
    return {
        "seconds": seconds,
        "solver_seconds": solution.seconds,
        "updates_per_second": solution.updates / max(solution.seconds, 1e-9),
    }


def _join_tables(behaviours: list[Behaviour]) -> tuple[tuple[Behaviour, ...], Array]:
    """Return behaviours whose tables are parts of one array, and that array."""
    values = np.concatenate([behaviour.table for behaviour in behaviours])
    ends = np.cumsum([len(behaviour.table) for behaviour in behaviours])
    parts = [values[end - len(one.table) : end] for one, end in zip(behaviours, ends, strict=True)]
    return tuple(replace(one, table=part) for one, part in zip(behaviours, parts, strict=True)), values


@contextmanager
def alone(folder: Path, progress: Progress | None) -> Iterator[bool]:
    """Let one process at a time train a bundle; give whether this one had to wait for another.

    Where files cannot be locked, each trains for itself, and the last one's bundle stays.
    """
    path = folder.with_name(f".{folder.name}.lock")
    lock = FileLock(path)
    waited = False
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            waited = True
            if progress is not None:
                progress("wait for another process that trains it", 0, 1)
            lock.acquire()
    except (OSError, NotImplementedError):
        yield waited
        return
    try:
        yield waited
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        lock.release()


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the recipe's file before what is wrong with what it names."""
    try:
        yield
    except (MotionError, PolicyError) as error:
        kind: type[CrowdsimError] = type(error)
        raise kind(f"{path}: {error}") from None

"""Training: from a recipe to a bundle, and only when there is none yet or the one there is stale."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from crowdsim import assets
from crowdsim.core.types import Array, FileName, Progress
from crowdsim.errors import CrowdsimError, MotionError, PolicyError, RecipeError, VersionError
from crowdsim.motion.database import MotionDatabase
from crowdsim.policy import bundle
from crowdsim.policy.actions import build_actions
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.rewards import target_body
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.fingerprint import capture_files, combine, fingerprints_of
from crowdsim.training.recipe import Recipe, load_recipe, plain
from crowdsim.training.solution import Solution


def train_recipe(
    name: FileName,
    mocap: FileName | None = None,
    threads: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> tuple[Path, bool]:
    """Train a recipe into its bundle, unless that is up to date; return its folder, and whether it was trained.

    Args:
        name: The recipe's file, or its name.
        mocap: Folder of motion capture (``fingerprint.capture_folder``).
        threads: Threads to use; the bundle has the same bytes for any number.
        force: Train even when the bundle is up to date.
        progress: Called with (stage, done, total).

    Raises:
        RecipeError: The recipe is invalid.
        PolicyError: Capture is missing.
        MotionError: The motion cannot be used: clips, strikes, graph.
        OutputError: The bundle cannot be written; nothing is left half-written.
    """
    path = assets.find_recipe(name)
    recipe = load_recipe(path)
    folder = assets.bundle_folder(path)
    with _naming(path):
        if not force and not stale(folder, recipe, mocap):
            return folder, False
        with _alone(folder, progress) as waited:
            if waited and not force and not stale(folder, recipe, mocap):
                return folder, False
            policy, timings = train_policy(recipe, path.stem, mocap, threads, progress)
            bundle.write_bundle(folder, policy, timings)
    return folder, True


def ready_policy(
    name: FileName, mocap: FileName | None = None, threads: int = 1, progress: Progress | None = None
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
    folder, _ = train_recipe(name, mocap, threads, False, progress)
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
    with _naming(path):
        given = (Path(name) / "policy.json").is_file()
        return given or not stale(assets.bundle_folder(path), load_recipe(path), mocap)


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
    try:
        files = capture_files(recipe, mocap) if recipe.motion.capture is not None else None
    except PolicyError:
        if mocap is not None:
            raise
        files = None
    now = fingerprints_of(recipe, files)
    changed = [part for part, value in now.items() if document["fingerprints"].get(part) != value]
    return f"its {' and '.join(changed)} changed" if changed else ""


def train_policy(
    recipe: Recipe,
    name: str,
    mocap: FileName | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> tuple[Policy, dict[str, Any]]:
    """Return a policy trained by a recipe, and what training took: seconds by stage and by behaviour.

    Raises:
        PolicyError: Capture is missing.
        MotionError: The motion cannot be used, or holds no strikes where behaviours need them.
    """
    from crowdsim.graph.motion_graph import build_graph
    from crowdsim.training.mirroring import solved_states
    from crowdsim.training.pruning import prune_graph
    from crowdsim.training.statistics import policy_statistics

    with _threads(threads):
        started = time.perf_counter()
        files = capture_files(recipe, mocap)
        prints = fingerprints_of(recipe, files)
        database = load_motion(recipe, files, progress)
        moved = time.perf_counter()
        body = target_body(database)
        graph = build_graph(database, recipe.graph, progress)
        built = time.perf_counter()
        if recipe.prune is not None:
            graph = prune_graph(database, graph, recipe.behaviours, body, recipe.prune, progress)
        actions = build_actions(database, graph)
        timings: dict[str, Any] = {
            "motion": moved - started,
            "graph": built - moved,
            "prune": time.perf_counter() - built,
            "behaviours": {},
        }
        trained, solutions = [], {}
        for label, spec in recipe.behaviours.items():
            begun = time.perf_counter()
            n = solved_states(database, graph, [spec])
            one, solutions[label] = train_behaviour(label, spec, database, actions, body, recipe.precision, progress, n)
            trained.append(one)
            timings["behaviours"][label] = _timing(solutions[label], time.perf_counter() - begun)
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
        statistics = policy_statistics(policy, solutions)
    return Policy(**{**vars(policy), "statistics": statistics}), timings


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


def load_motion(recipe: Recipe, files: Sequence[Path], progress: Progress | None = None) -> MotionDatabase:
    """Return the motion database that a recipe asks for, from the given files or from the embedded boxer.

    Raises:
        MotionError: A file cannot be used: which, and why; or there are no strikes, and a behaviour needs them.
        BvhError: A file is no BVH.
    """
    from crowdsim.capture.loading import Capture, load_capture, usable_clip
    from crowdsim.motion.database import build_database
    from crowdsim.motion.measuring import MeasuredClip, measure_clips
    from crowdsim.performer.session import perform
    from crowdsim.training.strikeless import require_no_strikes

    performer, source = recipe.motion.performer, recipe.motion.capture
    captures: list[Capture] = []
    clips: list[MeasuredClip] = []
    if performer is not None:
        performed = perform(performer.seconds, performer.seed, recipe.playback_rate, performer.stance, progress)
        clips = measure_clips([performance.clip for performance in performed])
    else:
        assert source is not None
        for done, path in enumerate(files, start=1):
            captures.append(load_capture(path, source.unit, source.up_axis))
            clips.append(usable_clip(captures[-1], source.strict))
            if progress is not None:
                progress("read capture", done, len(files))
    database = build_database(
        clips,
        recipe.control_rate,
        recipe.playback_rate,
        mirror=recipe.motion.mirror,
        trim=recipe.motion.trim,
        progress=progress,
    )
    if not len(database.strike_frames):
        require_no_strikes(recipe, captures)
    return database


@contextmanager
def _alone(folder: Path, progress: Progress | None) -> Iterator[bool]:
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
def _threads(count: int) -> Iterator[None]:
    """Set the number of threads of compiled code, and restore it afterwards."""
    import numba
    from numba import config

    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(count, int(getattr(config, "NUMBA_NUM_THREADS", 1)))))
    try:
        yield
    finally:
        numba.set_num_threads(before)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the recipe's file before what is wrong with what it names."""
    try:
        yield
    except (MotionError, PolicyError) as error:
        kind: type[CrowdsimError] = type(error)
        raise kind(f"{path}: {error}") from None

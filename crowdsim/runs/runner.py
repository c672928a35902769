"""One run, from a scenario to its manifest: the only place where crowd, take, export and render meet."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crowdsim import assets
from crowdsim.compilation import watch_compilation
from crowdsim.core.types import Array, FileName, Progress
from crowdsim.errors import CrowdsimError, RunError, ScenarioError, under_way
from crowdsim.files import walk
from crowdsim.runs.folder import RESOLVED, TAKE, check_folder, claim_folder, copy_file, hold_folder, write_text
from crowdsim.runs.journal import remove_journal
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import checksums, peak_memory, read_manifest, write_manifest
from crowdsim.runs.outputs import expect_outputs, plan_outputs, write_outputs
from crowdsim.runs.preparation import Prepared, load_policies, prepare
from crowdsim.runs.recording import CHOICES, LARGE, Clock, Interrupted, Report, needs, record, stop_signals
from crowdsim.runs.validation import check_scenario, late_events
from crowdsim.scenario.scenario import Scenario, dump_scenario
from crowdsim.scenario.warnings import speed_warnings
from crowdsim.take.take import VARIABLES, Events, Take

if TYPE_CHECKING:
    from crowdsim.crowd.chunk import Chunk
    from crowdsim.policy.policy import Policy

__all__ = ["Interrupted", "OpenedRun", "Report", "load_policies", "open_run", "prepare", "run", "run_to"]


def run(
    scenario: Scenario,
    policies: Sequence[Policy] | None = None,
    threads: int = 1,
    mocap: FileName | None = None,
    order: Array | None = None,
    progress: Progress | None = None,
) -> Take:
    """Run a scenario in memory and return its take; nothing is written but policies that had to be trained.

    The command line runs by the same path, see ``run_to``, and gives the same take.

    Args:
        scenario: The scenario, resolved, as ``load_scenario`` gives it.
        policies: Its policies; found, and trained if need be, when None.
        threads: Threads; the take does not depend on them.
        mocap: Folder of capture for policies that are trained from it.
        order: Number of the avatar in each slot of storage at the start, which changes no result. Shape (N,).
        progress: Called with stage, done and total.

    Raises:
        ScenarioError: Not all avatars fit, or behaviours are weighed that are not learned.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        RunError: The run failed.
    """
    from crowdsim.crowd.placement import place_groups
    from crowdsim.crowd.simulation import simulate

    placed = None
    if policies is None:
        check_scenario(scenario)
        placed = place_groups(scenario)
    chosen = load_policies(scenario, mocap, threads, progress) if policies is None else policies
    prepared = prepare(scenario, chosen, placed)
    chunks: list[Chunk] = []
    for chunk in simulate(
        prepared.crowd, prepared.policies, prepared.frames, prepared.script, threads, scenario.opponents.search, order
    ):
        chunks.append(chunk)
        if progress is not None:
            progress("control", chunk.first + chunk.frames, prepared.frames)
    told = {name: np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in VARIABLES}
    events = {
        name: np.concatenate([getattr(chunk.events, name) for chunk in chunks]) for name in Events.__dataclass_fields__
    }
    events["frame"] = events["frame"].astype(np.float32)
    return Take(
        **told,
        cast=prepared.cast,
        targets=np.concatenate([chunk.targets for chunk in chunks]),
        target_names=tuple(scenario.targets),
        events=Events(**events),
        control_rate=prepared.rate,
        scenario=scenario.name,
        seed=scenario.seed,
        fingerprints=tuple(policy.fingerprint for policy in prepared.policies),
        status="done",
        reactions=scenario.reactions,
        policies=tuple(prepared.policies),
    )


def run_to(
    folder: FileName,
    scenario: Scenario,
    threads: int = 1,
    mocap: FileName | None = None,
    force: bool = False,
    command: str = "",
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
) -> Report:
    """Run a scenario into a folder: take, outputs, and the manifest last.

    A finished run of the same resolved scenario is not done again, and nothing that a run has computed is removed,
    unless ``force`` says so; then only what a manifest or journal lists. What is wrong with the input is found before
    the folder is made or touched. ``tell`` is handed beforehand what a large crowd will need and what its policies
    cannot do, and once that kernels are compiled.

    Raises:
        ScenarioError: Not all avatars fit, or behaviours are weighed that are not learned.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        OutputError: The folder cannot be used.
        RunError: The run failed, or an output cannot be written.
        Interrupted: SIGINT or SIGTERM came; the take holds the frames that were done.
    """
    folder = Path(folder)
    report = Report(folder)
    clock = Clock(report.seconds)
    resolved = dump_scenario(scenario)
    if check_folder(folder, resolved, force):
        return _done_before(report)
    with watch_compilation(tell) as compilation:
        clock.watch(compilation)
        _run_watched(folder, scenario, resolved, threads, mocap, force, command, progress, tell, report, clock)
        report.compiled = compilation.count
    return report


def _run_watched(
    folder: Path,
    scenario: Scenario,
    resolved: str,
    threads: int,
    mocap: FileName | None,
    force: bool,
    command: str,
    progress: Progress | None,
    tell: Callable[[str], None] | None,
    report: Report,
    clock: Clock,
) -> None:
    """Run a scenario into a folder that is fit for it, as ``run_to`` does, while what is compiled is watched."""
    from crowdsim.crowd.placement import place_groups

    check_scenario(scenario)
    placed = place_groups(scenario)
    report.notes += map(str, scenario.place(late_events(scenario)))
    policies = load_policies(scenario, mocap, threads, progress)
    expect_outputs(scenario)
    clock.lap("policies")
    if tell is not None:
        warnings = speed_warnings(scenario, {policy.name: policy.statistics for policy in policies})
        for warning in scenario.place(warnings):
            tell(str(warning))
    prepared = prepare(scenario, policies, placed)
    outputs = _plan(folder, scenario, prepared)
    clock.lap("prepare")
    if tell is not None and len(prepared.cast.names) >= LARGE:
        tell(needs(len(prepared.cast.names), prepared.frames, folder))
    with stop_signals() as caught, hold_folder(folder):
        # Another run may have come and gone since the first look.
        if check_folder(folder, resolved, force, locked=True):
            _done_before(report)
            return
        report.notes += claim_folder(folder, _inputs(scenario), outputs)
        clock.lap("prepare")
        try:
            with under_way():
                _run_in(folder, scenario, prepared, resolved, threads, report, clock, command, caught, progress)
        except OSError as error:
            where = error.filename or folder
            raise RunError(f"{where}: cannot be read or written: {error.strerror or error}") from error


def _plan(folder: Path, scenario: Scenario, prepared: Prepared) -> list[str]:
    """Return the names of all files, and folders of takes, that a run writes beside those that it begins with.

    Raises:
        ScenarioError: An output has the place of a file that the scenario reads.
    """
    planned = plan_outputs(scenario, prepared.cast.names.tolist(), prepared.frames, prepared.rate)
    places = {name.split("/")[0] for name in planned} | {TAKE, f"{TAKE}.partial", RESOLVED, MANIFEST}
    for name in _inputs(scenario)[1:]:
        if name.split("/")[0] in places:
            what = f"reads {name!r}, which would lie in {folder} where the run writes; expected another file name"
            raise ScenarioError(f"{scenario.name}: {what}")
    return [*planned, TAKE, f"{TAKE}.partial"]


def _inputs(scenario: Scenario) -> list[str]:
    """Return the names of the files that a run begins with."""
    return [RESOLVED, *(PurePosixPath(name).as_posix() for name in scenario.files)]


def _run_in(
    folder: Path,
    scenario: Scenario,
    prepared: Prepared,
    resolved: str,
    threads: int,
    report: Report,
    clock: Clock,
    command: str,
    caught: list[int],
    progress: Progress | None,
) -> None:
    """Write everything into a folder that is ready for it."""
    write_text(folder / RESOLVED, resolved)
    for name in scenario.files:
        copy_file(scenario.folder / name, folder / name)
    take, timings = record(folder, scenario, prepared, threads, report, clock, caught, progress)

    def watch(stage: str, done: int, total: int) -> None:
        if caught:
            kept = f"the take is finished and kept, its outputs are not: export and render write them, {CHOICES}"
            raise Interrupted(caught[0], folder, kept)
        if progress is not None:
            progress(stage, done, total)

    files = write_outputs(folder, take, prepared.policies, scenario, threads, clock.lap, watch)
    profiled: list[str] = []
    if timings is not None and scenario.outputs.profile is not None:
        from crowdsim.crowd.profile import write_profile

        profiled = [path.name for path in write_profile(folder, timings, take.avatar_count, scenario.outputs.profile)]
        clock.lap("profile")
    for kind, written in files.items():
        if not written:
            # Avatars that never came have no file.
            continue
        # One picture is named, of several the folder they are in.
        place = Path(os.path.commonpath(written)) if kind == "pictures" else written[0].parent
        report.outputs[kind] = (place, len(written), sum(path.stat().st_size for path in written))
    watch("checksums", 0, 1)
    names = [path.relative_to(folder).as_posix() for paths in files.values() for path in paths]
    names += [*_inputs(scenario), *(f"{TAKE}/{name}" for name in walk(folder / TAKE)), *profiled]
    hashes = checksums(folder, names, threads)
    clock.lap("checksums")
    write_manifest(folder, _manifest(scenario, prepared, report, clock, command, threads), hashes)
    remove_journal(folder)
    watch("checksums", 1, 1)


def _manifest(
    scenario: Scenario, prepared: Prepared, report: Report, clock: Clock, command: str, threads: int
) -> dict[str, Any]:
    report.seconds["total"] = clock.total()
    statistics = report.statistics
    return {
        "status": "done",
        "scenario": scenario.name,
        "seed": scenario.seed,
        "command": command,
        "threads": threads,
        "avatars": len(prepared.cast.names),
        "control_frames": prepared.frames,
        "policies": {policy.name: policy.fingerprint for policy in prepared.policies},
        "statistics": {} if statistics is None else asdict(statistics),
        "seconds": {stage: round(value, 6) for stage, value in report.seconds.items()},
        "peak_memory_bytes": peak_memory(),
    }


def _done_before(report: Report) -> Report:
    report.done_before = True
    report.notes += _changed_policies(report.folder)
    return report


def _changed_policies(folder: Path) -> list[str]:
    """Say which policies of a finished run have been trained otherwise since."""
    from crowdsim.policy.bundle import read_document

    notes = []
    for name, fingerprint in read_manifest(folder).get("policies", {}).items():
        try:
            now = read_document(assets.find_bundle(name))["fingerprint"]
        except CrowdsimError:
            continue
        if now != fingerprint:
            notes.append(f"{folder}: policy {name!r} has been trained again since; --force runs with it")
    return notes


class OpenedRun(NamedTuple):
    """A run that was written before: its take, its policies, and what a user should know of it."""

    take: Take
    policies: list[Policy]
    notes: list[str]

    def joint_names(self, avatar: int) -> tuple[str, ...]:
        """Return the names of an avatar's joints, see ``Take.joint_names``."""
        return self.take.joint_names(avatar)

    def joints(self, avatar: int, seconds: ArrayLike) -> Array:
        """Return where an avatar's joints are at one time or several [m], see ``Take.joints``."""
        return self.take.joints(avatar, seconds)

    def strikes(self, landed: bool | None = None) -> Array:
        """Return the strikes as a table, see ``Take.strikes``."""
        return self.take.strikes(landed)


def open_run(folder: FileName) -> OpenedRun:
    """Return a run's take, its policies, and what a user should know of it.

    Raises:
        TakeError: There is no take, or it is damaged.
        PolicyError: A policy is missing, or not the one it was recorded with.
    """
    from crowdsim.policy.bundle import load_policy
    from crowdsim.take.store import open_take

    folder = Path(folder)
    take = open_take(folder)
    policies = [load_policy(assets.find_bundle(name)) for name in take.cast.policy_names]
    notes = []
    if take.status != "done":
        notes.append(f"{folder}: the run was interrupted; {take.frame_count} control frames are there")
    elif not (folder / MANIFEST).exists():
        notes.append(f"{folder}: the run is not finished; its take is, some outputs may be missing")
    return OpenedRun(replace(take, policies=tuple(policies)), policies, notes)

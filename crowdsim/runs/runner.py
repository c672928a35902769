"""One run, from a scenario to its manifest: the only place where crowd, take, export and render meet."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from crowdsim import assets
from crowdsim.compilation import watch_compilation
from crowdsim.core.types import Array, FileName, Progress
from crowdsim.errors import CrowdsimError, RunError, ScenarioError, under_way
from crowdsim.files import walk
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint
from crowdsim.runs.folder import RESOLVED, TAKE, check_folder, claim_folder, copy_file, write_text
from crowdsim.runs.journal import remove_journal
from crowdsim.runs.lock import hold_folder, rebooted
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import checksums, peak_memory, read_manifest, write_manifest
from crowdsim.runs.origin import Origin, origin_of
from crowdsim.runs.outputs import expect_outputs, plan_outputs, write_outputs
from crowdsim.runs.preparation import (
    LARGE,
    Prepared,
    kernel_uses,
    load_policies,
    needs,
    prepare,
    training_notice,
    untrained_policies,
)
from crowdsim.runs.run import Report, Run
from crowdsim.runs.staging import complete_alone
from crowdsim.runs.validation import check_scenario, late_events
from crowdsim.scenario.scenario import Scenario, dump_scenario
from crowdsim.scenario.warnings import policy_warnings
from crowdsim.take.take import Take

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


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
    from crowdsim.runs.recording import record
    from crowdsim.take.memory import TakeCollector

    one = Run(scenario, threads, mocap, progress, order=order)
    if policies is None:
        check_scenario(scenario)
    prepared = _prepare(one) if policies is None else prepare(scenario, policies)
    collector = TakeCollector(prepared.header, prepared.policies)
    record(one, prepared, collector)
    return collector.take()


def run_to(
    folder: FileName,
    scenario: Scenario,
    threads: int = 1,
    mocap: FileName | None = None,
    force: bool = False,
    command: str = "",
    progress: Progress | None = None,
    notify: Callable[[str], None] | None = None,
    policies: Sequence[Policy] | None = None,
) -> Report:
    """Run a scenario into a folder: take, outputs, and the manifest last.

    A finished run of the same resolved scenario is not done again. One that was interrupted goes on where it stopped,
    with the same result as if it had not been. Nothing that a run has computed is removed, unless ``force`` says so;
    then only what a manifest or journal lists. What is wrong with the input is found before the folder is made or
    touched. ``notify`` is called beforehand with what has to be trained, what a large crowd will need, what its
    policies cannot do and where the run goes on, and once when kernels are compiled. ``policies`` are those of a
    scenario that has been checked; they are found, and trained if need be, when None.

    Raises:
        ScenarioError: Not all avatars fit, or behaviours are weighed that are not learned.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        OutputError: The folder cannot be used.
        RunError: The run failed, or an output cannot be written.
        Interrupted: SIGINT or SIGTERM came; the take holds the frames that were done.
    """
    one = Run(scenario, threads, mocap, progress, notify, Path(folder), force, command)
    resolved = dump_scenario(scenario)
    complete_alone(one.folder)
    if check_folder(one.folder, resolved, force):
        return _done_before(one.report)
    uses: list[str] = []
    if policies is None:
        check_scenario(scenario)
        untrained = untrained_policies(scenario, mocap)
        uses = kernel_uses(scenario, untrained)
        if notify is not None:
            for name in untrained:
                notify(training_notice(name, threads))
    with watch_compilation(notify, uses, threads) as compilation:
        one.clock.watch(compilation)
        _run_in_folder(one, resolved, policies)
        one.report.compiled = compilation.count
    return one.report


def _run_in_folder(one: Run, resolved: str, policies: Sequence[Policy] | None) -> None:
    """Run a scenario into a folder that is fit for it, unless another run has done so meanwhile."""
    prepared = _prepare(one) if policies is None else prepare(one.scenario, policies)
    outputs = _plan(one.folder, one.scenario, prepared)
    expect_outputs(one.scenario)
    one.clock.lap("prepare")
    avatars = len(prepared.cast.names)
    if one.notify is not None and avatars >= LARGE:
        one.notify(needs(avatars, prepared.frames, one.folder))
    origin = origin_of(resolved, prepared.policies)
    with one.catch_signals(), hold_folder(one.folder, one.command) as before:
        # Another run may have come and gone since the first look.
        if check_folder(one.folder, resolved, one.force, locked=True):
            _done_before(one.report)
            return
        lost = before is not None and rebooted(before)
        claim = claim_folder(one.folder, _inputs(one.scenario), outputs, origin, prepared.frames, one.force, lost)
        for line in claim.notes:
            one.note(line)
        one.clock.lap("prepare")
        try:
            with under_way():
                _write(one, prepared, origin, claim.begun)
        except OSError as error:
            where = error.filename or one.folder
            raise RunError(f"{where}: cannot be read or written: {error.strerror or error}") from error


def _prepare(one: Run) -> Prepared:
    """Return all that a run of a checked scenario begins with; its policies are found or trained."""
    from crowdsim.crowd.placement import place_groups

    scenario = one.scenario
    placed = place_groups(scenario)
    for finding in scenario.place(late_events(scenario)):
        one.note(str(finding))
    policies = load_policies(scenario, one.mocap, one.threads, one.progress)
    one.clock.lap("policies")
    if one.notify is not None:
        warnings = policy_warnings(scenario, {policy.name: policy.statistics for policy in policies})
        for warning in scenario.place(warnings):
            one.notify(str(warning))
    return prepare(scenario, policies, placed)


def _plan(folder: Path, scenario: Scenario, prepared: Prepared) -> list[str]:
    """Return the names of all files, and folders of takes, that a run writes beside those that it begins with.

    Raises:
        ScenarioError: An output has the name of a file that the scenario reads.
    """
    planned = plan_outputs(scenario, prepared.cast.names.tolist(), prepared.frames, prepared.rate)
    places = {name.split("/")[0] for name in planned} | {TAKE, f"{TAKE}.partial", RESOLVED, MANIFEST, CHECKPOINT}
    for name in _inputs(scenario)[1:]:
        if name.split("/")[0] in places:
            what = f"reads {name!r}, which would lie in {folder} where the run writes; expected another file name"
            raise ScenarioError(f"{scenario.name}: {what}")
    return [*planned, CHECKPOINT, TAKE, f"{TAKE}.partial"]


def _inputs(scenario: Scenario) -> list[str]:
    """Return the names of the files that a run begins with."""
    return [RESOLVED, *(PurePosixPath(name).as_posix() for name in scenario.files)]


def _write(one: Run, prepared: Prepared, origin: Origin, begun: Checkpoint | None) -> None:
    """Write everything into a folder that is ready for it, or what is missing."""
    folder, scenario, report = one.folder, one.scenario, one.report
    write_text(folder / RESOLVED, origin.scenario)
    for name in scenario.files:
        copy_file(scenario.folder / name, folder / name)
    take, timings = _write_take(one, prepared, origin, begun)
    files = write_outputs(one, take, prepared.policies)
    profiled: list[str] = []
    if timings is not None and scenario.outputs.profile is not None:
        from crowdsim.crowd.profile_files import write_profile

        profiled = [path.name for path in write_profile(folder, timings, take.avatar_count, scenario.outputs.profile)]
        one.clock.lap("profile")
    for kind, written in files.items():
        if not written:
            # Avatars that never came have no file.
            continue
        # One picture is named, of several the folder they are in.
        place = Path(os.path.commonpath(written)) if kind == "pictures" else written[0].parent
        report.outputs[kind] = (place, len(written), sum(path.stat().st_size for path in written))
    one.advance_outputs("checksums", 0, 1)
    names = [path.relative_to(folder).as_posix() for paths in files.values() for path in paths]
    names += [CHECKPOINT, *_inputs(scenario), *(f"{TAKE}/{name}" for name in walk(folder / TAKE)), *profiled]
    hashes = checksums(folder, names, one.threads)
    one.clock.lap("checksums")
    write_manifest(folder, _manifest(one, prepared, origin), hashes)
    remove_journal(folder)
    one.advance_outputs("checksums", 1, 1)


def _write_take(one: Run, prepared: Prepared, origin: Origin, begun: Checkpoint | None) -> tuple[Take, Array | None]:
    """Simulate and write the take as it comes; return it, and what control cost where that is wanted."""
    from crowdsim.crowd.statistics import StatisticsCounter
    from crowdsim.runs.resuming import write_take

    path, cast = one.folder / TAKE, prepared.cast
    counter = StatisticsCounter(prepared.policies, cast.policies, cast.widths, prepared.frames)
    take, timings = write_take(one, prepared, origin.checksum, begun, counter)
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    one.report.outputs["take"] = (path, 1, size)
    one.report.statistics = counter.finish()
    one.clock.lap("take")
    return take, timings


def _manifest(one: Run, prepared: Prepared, origin: Origin) -> dict[str, Any]:
    report = one.report
    report.seconds["total"] = one.clock.total()
    statistics = report.statistics
    return {
        "status": "done",
        "scenario": one.scenario.name,
        "seed": one.scenario.seed,
        "command": one.command,
        "threads": one.threads,
        "avatars": len(prepared.cast.names),
        "control_frames": report.statistics.control_frames if report.statistics else prepared.frames,
        "outcome": report.outcome,
        "policies": {policy.name: policy.fingerprint for policy in prepared.policies},
        "inputs": _inputs(one.scenario),
        "origin": origin.document(),
        "statistics": {} if statistics is None else asdict(statistics),
        "seconds": {stage: round(value, 6) for stage, value in report.seconds.items()},
        "peak_memory_bytes": peak_memory(),
    }


def _done_before(report: Report) -> Report:
    report.done_before = True
    report.notes += _changed_policies(report.folder)
    return report


def _changed_policies(folder: Path) -> list[str]:
    """Return a note for each policy of a finished run that has been trained otherwise since."""
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

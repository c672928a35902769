"""One run, from a scenario to its manifest: the only place where crowd, take, export and render meet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from itertools import chain
from os.path import commonpath
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from crowdsim import assets
from crowdsim.compilation import watch_compilation
from crowdsim.core.types import FileName, Progress
from crowdsim.crowd.cuda.device import choose_device
from crowdsim.errors import CrowdsimError, OutputError, RunError, ScenarioError, TakeError, under_way
from crowdsim.files import copy_plain, exists_plain, is_folder, remove_plain, walk, write_plain
from crowdsim.machine import peak_memory
from crowdsim.places.mesh import area_of
from crowdsim.preparation.prepare import (
    LARGE,
    kernel_uses,
    load_policies,
    needs,
    take_header,
    training_notice,
    untrained_policies,
)
from crowdsim.preparation.validation import check_scenario, late_events, output_findings
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from crowdsim.runs.folder import RESOLVED, check_folder, note_extension, other_run, read_resolved
from crowdsim.runs.lock import LOCKS, hold_folder
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import NOTE, OUTPUTS, checksums, read_ledger, read_manifest
from crowdsim.runs.manifest import RUN as STAGE
from crowdsim.runs.provenance import Origin, document_difference, origin_of
from crowdsim.runs.recorded import RecordedRun, shown
from crowdsim.runs.run import Report, Run
from crowdsim.runs.stage import TAKE, complete, complete_alone, open_stage, planned_files, refuse_others
from crowdsim.scenario.output import Extent
from crowdsim.scenario.scenario import Scenario, check_loaded, dump_scenario
from crowdsim.scenario.warnings import policy_warnings
from crowdsim.take.metadata import check_files

if TYPE_CHECKING:
    from crowdsim.crowd.crowd import Crowd
    from crowdsim.policy.policy import Policy

_SIMULATED = {"control", "take", "statistics", "checkpoints"}
"""Stages that are not done again where only outputs differ."""


def run(
    scenario: Scenario,
    policies: Sequence[Policy] | None = None,
    threads: int = 1,
    mocap: FileName | None = None,
    progress: Progress | None = None,
    device: str = "cpu",
) -> RecordedRun:
    """Run a scenario in memory and return its take; nothing is written but policies that had to be trained.

    The command line runs by the same path, see ``run_to``, and gives the same take.

    Args:
        scenario: The scenario, resolved, as ``load_scenario`` gives it.
        policies: Its policies; found, and trained if need be, when None.
        threads: Threads; the take does not depend on them.
        mocap: Folder of capture for policies that are trained from it.
        progress: Called with stage, done and total.
        device: Where control runs: ``cpu``, ``cuda``, or ``auto`` for a GPU where a crowd is large and there is one.

    Raises:
        ScenarioError: Not all avatars fit, or behaviours are weighed that are not learned.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        DeviceError: The device is unknown or missing.
        RunError: The run failed.
    """
    from crowdsim.runs.recording import record
    from crowdsim.take.memory import TakeCollector

    check_loaded(scenario)
    device = choose_device(device, scenario.avatar_count, scenario.opponents.search)
    one = Run(scenario, threads, mocap, progress, device=device)
    if policies is None:
        check_scenario(scenario)
    crowd = _draw(one, policies)
    collector = TakeCollector(take_header(scenario, crowd), crowd.policies)
    record(one, crowd, collector)
    return RecordedRun.of(collector.take(), **shown(scenario, scenario.folder, crowd.rate))


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
    more: tuple[float, bool] | None = None,
    device: str = "cpu",
) -> Report:
    """Run a scenario into a folder: take, outputs, and the manifest last.

    A finished run of the same resolved scenario is not done again; where only its outputs differ, they are written from
    its take. One that was interrupted goes on where it stopped, and a finished one is continued by ``more``: the folder
    then holds what an uninterrupted run of that length would have written. Nothing that a run has computed is removed,
    unless ``force`` says so; then only what a manifest or journal lists. What is wrong with the input is found before
    the folder is made or touched.

    Args:
        folder: The run folder.
        scenario: The scenario, resolved.
        threads: Threads.
        mocap: Folder of capture.
        force: Whether to begin anew whatever a run has left in the folder.
        command: The command, for the manifest.
        progress: Called with stage, done and total.
        notify: Called beforehand with what has to be trained, what a large crowd will need, what its policies cannot do
            and where the run goes on, and once when kernels are compiled.
        policies: Policies of a scenario that has been checked; found, and trained if need be, when None.
        more: Control frames that a finished run is extended by, or seconds, and whether they are seconds. Until
            ``forget_extension``, which follows the report of its end, the same call does not extend the run again.
        device: Where control runs, see ``run``; no file but the manifest depends on it.

    Raises:
        DeviceError: The device is unknown or missing.
        ScenarioError: Not all avatars fit, or behaviours are weighed that are not learned.
        PolicyError: A bundle is foreign or damaged, or capture for it is missing.
        OutputError: The folder cannot be used.
        RunError: The run failed, or an output cannot be written; a run that was finished stays.
        Interrupted: SIGINT or SIGTERM came; the take holds the frames that were done, and the same call goes on.
    """
    check_loaded(scenario)
    device = choose_device(device, scenario.avatar_count, scenario.opponents.search)
    one = Run(scenario, threads, mocap, progress, notify, Path(folder), force, command, more, device=device)
    complete_alone(one.folder)
    if check_folder(one.folder, dump_scenario(scenario), force, more) == "run":
        _note_done(one)
        return one.report
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
        crowd = _draw(one, policies)
        one.scenario.refuse(output_findings(one.scenario, crowd.policies))
        for output in one.scenario.outputs.wanted():
            output.prepare()
        one.clock.lap("prepare")
        if notify is not None and crowd.count >= LARGE:
            notify(needs(crowd.count, crowd.frames, one.folder))
        resolved = dump_scenario(one.scenario)
        origin, plan = origin_of(resolved, crowd.policies), plan_run(one, crowd)
        with one.catch_signals(), hold_folder(one.folder, command):
            complete(one.folder)
            # Another run may have come and gone since the first look.
            held = check_folder(one.folder, resolved, force, more, origin)
            if held == "run":
                _note_done(one)
            else:
                _write(one, crowd, origin, plan, _end_of_finished(one, crowd, origin) if held == "take" else None)
        one.report.compiled = compilation.count
    return one.report


def _end_of_finished(one: Run, crowd: Crowd, origin: Origin) -> Checkpoint:
    """Return the checkpoint of the end of a finished run, from which it goes on unless something has changed since."""
    folder, manifest = one.folder, read_manifest(one.folder, ("origin",))
    difference = document_difference(manifest["origin"], origin.document())
    if difference:
        what = "the same run, but its outputs cannot follow, since something changed"
        if one.more is not None:
            what = "a run that cannot be extended, since something has changed"
        raise other_run(folder, what, difference)
    try:
        if not is_folder(folder, TAKE):
            raise TakeError(f"{folder / TAKE}: is missing, or a link; links are not followed")
        check_files(folder / TAKE)
        begun = read_checkpoint(folder, crowd.count, crowd.frames)
    except TakeError as error:
        raise OutputError(f"the run cannot be continued: {error}") from None
    if begun.origin != replace(origin, scenario=read_resolved(folder)).checksum or begun.frame > crowd.frames:
        raise OutputError(f"the run cannot be continued: {folder / CHECKPOINT} is of another run")
    if one.more is not None:
        note_extension(folder, one.more, crowd.frames)
    else:
        one.report.seconds |= {name: value for name, value in manifest["seconds"].items() if name in _SIMULATED}
        one.tell(
            f"{folder}: only outputs differ; writing them from its take, in place of all outputs and exports there"
        )
    return begun


def _write(one: Run, crowd: Crowd, origin: Origin, plan: set[str], finished: Checkpoint | None) -> None:
    """Write a run into its stage, or what is missing there, and put everything in its place.

    ``plan`` names all files that it writes; ``finished`` is the end of the finished run that it goes on from.
    """
    from crowdsim.runs.exports import write_outputs
    from crowdsim.runs.recording import write_take

    work, scenario, report, inputs = one.work, one.scenario, one.report, _inputs(one.scenario)
    refuse_others(one.folder, plan, read_ledger(one.folder))
    own = {RESOLVED, CHECKPOINT, MANIFEST, TAKE, *(name.split("/")[0] for name in inputs)}
    planned = Counter(top for name in plan if (top := name.split("/")[0]) not in own)
    note = {"origin": origin.document(), "planned": planned}
    survives = (RESOLVED, CHECKPOINT, TAKE, f"{TAKE}.partial")
    stage = open_stage(one.folder, STAGE, origin.checksum, note, one.force, survives)
    if finished is not None and not exists_plain(work, CHECKPOINT):
        for part in walk(one.folder / TAKE):
            # A chunk is never written again.
            is_chunk = part.rpartition("/")[2][0].isdecimal()
            copy_plain(one.folder / TAKE / part, work, f"{TAKE}.partial/{part}", link=is_chunk)
        write_checkpoint(work, replace(finished, origin=origin.checksum))
    # What is half-written.
    remove_plain(work, [name for name in walk(work) if name.endswith((".part", ".partial"))])
    begun = _find_begun(one, crowd, origin) if stage.goes_on or finished is not None else None
    one.clock.lap("prepare")
    try:
        with under_way():
            write_plain(work, RESOLVED, origin.scenario)
            for source, name in zip(scenario.files, inputs[1:], strict=True):
                copy_plain(scenario.folder / source, work, name)
            take, timings = write_take(one, crowd, origin.checksum, begun)
            one.clock.lap("take")
            run = RecordedRun.of(take, policies=tuple(crowd.policies), **shown(scenario, scenario.folder, crowd.rate))
            done = run.outputs_in(work, one.threads, one.advance_outputs, origin.scenario, timings)
            # Files that are there already are whole, and are not written again.
            outputs = write_outputs(done, scenario.outputs.wanted(), one.clock.lap)
            one.advance_outputs("checksums", 0, 1)
            files = {"take": [f"{TAKE}/{name}" for name in walk(work / TAKE)]}
            files |= {kind: [path.relative_to(work).as_posix() for path in paths] for kind, paths in outputs.items()}
            hashes = checksums(work, [*chain(*files.values()), CHECKPOINT, *inputs], one.threads)
            for kind, names in files.items():
                # One file is named, of several the folder that they are in.
                place, count = (TAKE, 1) if kind == "take" else (commonpath(names), len(names))
                report.outputs[kind] = one.folder / place, count, sum(hashes[name]["bytes"] for name in names)
            one.clock.lap("checksums")
            stage.publish(_manifest(one, crowd, origin), hashes)
            one.advance_outputs("checksums", 1, 1)
    except OSError as error:
        what = f"cannot be read or written: {error.strerror or error}"
        raise RunError(f"{error.filename or one.folder}: {what}") from error


def _find_begun(one: Run, crowd: Crowd, origin: Origin) -> Checkpoint | None:
    """Return where an earlier process has left a run; None where it has to start over."""
    try:
        begun = read_checkpoint(one.work, crowd.count, crowd.frames)
        if begun.origin != origin.checksum:
            raise TakeError(f"{one.work / CHECKPOINT}: is of another run")
    except TakeError as error:
        why = f"; {error}" if exists_plain(one.work, CHECKPOINT) else ""
        one.tell(f"{one.folder}: an unfinished run was found; starting over{why}")
        return None
    one.tell(f"{one.folder}: continuing after {begun.frame} control frames")
    return begun


def _draw(one: Run, policies: Sequence[Policy] | None = None) -> Crowd:
    """Return the crowd of a checked scenario; its policies are found or trained once its avatars are placed."""
    from crowdsim.crowd.attachments import attachment_warnings
    from crowdsim.crowd.draw import draw_crowd
    from crowdsim.crowd.placement import place_groups

    if policies is not None:
        return draw_crowd(one.scenario, policies)
    scenario = one.scenario
    placed = place_groups(scenario)
    for event in scenario.place(late_events(scenario)):
        one.tell(str(event))
    policies = load_policies(scenario, one.mocap, one.threads, one.progress)
    for name in (policy.name for policy in policies):
        with suppress(CrowdsimError):
            one.policy_folders[name] = str(assets.find_bundle(name).absolute())
    one.clock.lap("policies")
    if one.notify is not None:
        warnings = policy_warnings(scenario, {policy.name: policy.statistics for policy in policies})
        warnings += attachment_warnings(scenario, {policy.name: policy for policy in policies})
        for warning in scenario.place(warnings):
            one.notify(str(warning))
    if one.more is not None:
        length, is_seconds = one.more
        more = max(1, round(length * (float(policies[0].database.control_rate) if is_seconds else 1.0)))
        frames = int(read_manifest(one.folder, ("control_frames",))["control_frames"])
        one.scenario = scenario.model_copy(update={"duration": frames + more})
    return draw_crowd(one.scenario, policies, placed)


def plan_run(one: Run, crowd: Crowd) -> set[str]:
    """Return the names of all files that a run writes.

    Raises:
        ScenarioError: An output has the name of a file that the scenario reads, or there are too many files.
    """
    from crowdsim.crowd.obstacles import pack_obstacles

    scenario = one.scenario
    names, wanted = crowd.cast.names.tolist(), scenario.outputs.wanted()
    extent = Extent(len(names), crowd.frames, crowd.rate, area_of(pack_obstacles(scenario, None)))
    scenario.refuse([output.place(finding) for output in wanted for finding in output.findings_for(extent)])
    plan = planned_files(wanted, extent, names, scenario.name) | {CHECKPOINT, MANIFEST, RESOLVED, TAKE}
    places = {name.split("/")[0] for name in plan} | {NOTE, OUTPUTS, *LOCKS}
    for name in _inputs(scenario)[1:]:
        if name.split("/")[0] in places:
            what = f"reads {name!r}, which would lie in {one.folder} where the run writes; expected another file name"
            raise ScenarioError(f"{scenario.name}: {what}")
    return plan | set(_inputs(scenario))


def _inputs(scenario: Scenario) -> list[str]:
    """Return the names of the files that a run begins with."""
    return [RESOLVED, *(PurePosixPath(name).as_posix() for name in scenario.files)]


def _manifest(one: Run, crowd: Crowd, origin: Origin) -> dict[str, Any]:
    statistics, seconds = one.report.statistics, one.report.seconds
    seconds["total"] = one.clock.total()
    return {
        "status": "done",
        "scenario": one.scenario.name,
        "seed": one.scenario.seed,
        "command": one.command,
        "threads": one.threads,
        "device": one.device,
        "avatars": crowd.count,
        "control_frames": statistics.control_frames if statistics else crowd.frames,
        "outcome": one.report.outcome,
        "policies": {policy.name: policy.fingerprint for policy in crowd.policies},
        "policy_folders": one.policy_folders,
        "inputs": _inputs(one.scenario),
        "origin": origin.document(),
        "statistics": {} if statistics is None else asdict(statistics),
        "seconds": {stage: round(value, 6) for stage, value in seconds.items()},
        "peak_memory_bytes": peak_memory(),
    }


def _note_done(one: Run) -> None:
    """Report that a run was finished before, and which of its policies have been trained otherwise since."""
    from crowdsim.policy.bundle import read_document

    one.report.done_before = True
    if one.more is not None:
        one.tell(f"{one.folder}: the extension that was interrupted is complete")
    for name, fingerprint in read_manifest(one.folder).get("policies", {}).items():
        with suppress(CrowdsimError):
            if read_document(assets.find_bundle(name))["fingerprint"] != fingerprint:
                one.tell(f"{one.folder}: policy {name!r} has been trained again since; --force runs with it")

"""A finished run that goes on: what it would have been, had it been planned for longer, or with other outputs.

The longer run is written in the stage of the run's folder, from the checkpoint of its end, and takes its place when it
is finished. Until a command has reported the end of an extension, the same command completes that one instead of
beginning another: what the run is extended to is noted in its folder beforehand, and forgotten after the report.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from crowdsim.compilation import watch_compilation
from crowdsim.config.documents import parse_json
from crowdsim.core.types import FileName, Progress
from crowdsim.errors import OutputError, TakeError
from crowdsim.files import copy_plain, read_plain, remove_plain, walk, write_plain
from crowdsim.preparation.prepare import load_policies
from crowdsim.preparation.validation import check_scenario, output_findings
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from crowdsim.runs.folder import has_same_take, other_run, read_resolved, resolved_value
from crowdsim.runs.lock import EXTENDING, hold_folder
from crowdsim.runs.manifest import RUN, checksum, read_manifest, signed_text
from crowdsim.runs.provenance import Origin, origin_difference, origin_of, scenario_difference
from crowdsim.runs.run import Report, Run
from crowdsim.runs.runner import bundle_folders, plan_run, write_run
from crowdsim.runs.stage import TAKE, complete, complete_alone
from crowdsim.scenario.scenario import Scenario, dump_scenario

_SIMULATED = {"control", "take", "statistics", "checkpoints"}
"""Stages that are not done again where only outputs differ."""


def extend_run(
    folder: FileName,
    scenario: Scenario,
    length: tuple[float, bool],
    threads: int = 1,
    mocap: FileName | None = None,
    command: str = "",
    progress: Progress | None = None,
    notify: Callable[[str], None] | None = None,
) -> Report:
    """Continue a finished run; its folder then holds what a run of that length would have written.

    Args:
        folder: The run folder.
        scenario: The scenario, resolved; its duration does not matter.
        length: Control frames to add, or seconds, and whether it is in seconds.
        threads: Threads.
        mocap: Folder of capture.
        command: The command, for the manifest.
        progress: Called with stage, done and total.
        notify: Called with what a user should know beforehand.

    Raises:
        OutputError: The folder holds no finished run of this scenario, policies and versions, or another process
            holds it.
        RunError: The run failed; the finished one stays.
        Interrupted: A signal has come; the same call goes on from there.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise OutputError(f"{folder}: no such folder, expected a finished run to extend")
    one = Run(scenario, threads, mocap, progress, notify, folder, command=command)
    with one.catch_signals(), hold_folder(folder, command):
        if RUN in complete(folder) or _is_extended(folder, length):
            one.report.done_before = True
            one.tell(f"{folder}: the extension that was interrupted is complete")
            return one.report
        with watch_compilation(notify, (), threads) as compilation:
            one.clock.watch(compilation)
            _extend(one, length)
            one.report.compiled = compilation.count
    return one.report


def _extend(one: Run, length: tuple[float, bool]) -> None:
    """Write the longer run.

    Raises:
        OutputError: The folder holds another run, or something has changed since.
    """
    from crowdsim.crowd.draw import draw_crowd

    folder = one.folder
    policies = load_policies(one.scenario, one.mocap, one.threads, one.progress)
    one.policy_folders = bundle_folders([policy.name for policy in policies])
    origin, frames = _finished(folder, one.scenario, origin_of(read_resolved(folder), policies))
    rate = float(policies[0].database.control_rate)
    more = max(1, round(length[0] * (rate if length[1] else 1.0)))
    one.scenario = one.scenario.model_copy(update={"duration": frames + more})
    now = replace(origin, scenario=dump_scenario(one.scenario))
    begun = _end_of(folder, origin)
    note = {"length": list(length), "control_frames": one.scenario.duration}
    write_plain(folder, EXTENDING, signed_text(note))

    def seed(stage: Path) -> None:
        _copy_take(folder, stage, f"{TAKE}.partial")
        write_checkpoint(stage, replace(begun, origin=now.checksum))

    crowd = draw_crowd(one.scenario, policies)
    write_run(one, crowd, now, plan_run(one, crowd), seed)


def rewrite_outputs(
    folder: FileName,
    scenario: Scenario,
    threads: int = 1,
    mocap: FileName | None = None,
    command: str = "",
    progress: Progress | None = None,
    notify: Callable[[str], None] | None = None,
) -> Report | None:
    """Write the outputs of a finished run as another scenario asks for them, without simulating again.

    Args:
        folder: The run folder.
        scenario: The scenario, resolved; but for its cameras and outputs it is that of the run.
        threads: Threads.
        mocap: Folder of capture.
        command: The command, for the manifest.
        progress: Called with stage, done and total.
        notify: Called with what a user should know beforehand.

    Returns:
        What was done; None where the folder holds no such run, its outputs are those already, or they hold a profile
        that was not measured.

    Raises:
        OutputError: The run was made by other policies or versions, or another process holds the folder.
        RunError: An output cannot be written; the run stays as it was.
        Interrupted: A signal has come; the same call goes on from there.
    """
    from crowdsim.crowd.draw import draw_crowd

    folder = Path(folder)
    complete_alone(folder)
    if not has_same_take(folder, scenario, dump_scenario(scenario)):
        return None
    check_scenario(scenario)
    one = Run(scenario, threads, mocap, progress, notify, folder, command=command)
    with one.catch_signals(), hold_folder(folder, command), watch_compilation(notify, (), threads) as compilation:
        one.clock.watch(compilation)
        policies = load_policies(scenario, mocap, threads, progress)
        one.policy_folders = bundle_folders([policy.name for policy in policies])
        scenario.refuse(output_findings(scenario, policies))
        for output in scenario.outputs.wanted():
            output.prepare()
        origin = origin_of(read_resolved(folder), policies)
        manifest = read_manifest(folder, ("origin",))
        difference = origin_difference(manifest["origin"], origin)
        if difference:
            raise other_run(folder, "the same run, but its outputs cannot follow, since something changed", difference)
        begun, now = _end_of(folder, origin), replace(origin, scenario=dump_scenario(scenario))
        if scenario.outputs.profile is not None and begun.timings is None:
            return None
        one.report.seconds.update(
            {stage: manifest["seconds"][stage] for stage in _SIMULATED & set(manifest["seconds"])}
        )
        one.tell(
            f"{folder}: only outputs differ; writing them from its take, in place of all outputs and exports there"
        )

        def seed(stage: Path) -> None:
            _copy_take(folder, stage, TAKE)
            write_checkpoint(stage, replace(begun, origin=now.checksum))

        crowd = draw_crowd(scenario, policies)
        write_run(one, crowd, now, plan_run(one, crowd), seed)
        one.report.compiled = compilation.count
    return one.report


def _copy_take(folder: Path, stage: Path, name: str) -> None:
    """Give the take of a run in a folder a name in a stage."""
    for part in walk(folder / TAKE):
        # A chunk is never written again.
        is_chunk = part.rpartition("/")[2][0].isdecimal()
        copy_plain(folder / TAKE / part, stage, f"{name}/{part}", link=is_chunk)


def forget_extension(folder: Path) -> None:
    """Forget what a run was to be extended to, since its end has been reported; the next extension is another one."""
    with suppress(OSError):
        remove_plain(folder, [EXTENDING])


def _is_extended(folder: Path, length: tuple[float, bool]) -> bool:
    """Whether a run has been extended by a length already, and that has not been reported."""
    try:
        note = parse_json(read_plain(folder, EXTENDING, 1 << 16))
        frames = read_manifest(folder)["control_frames"]
        is_sound = isinstance(note, dict) and note.get("checksum") == checksum(note)
        return is_sound and (note.get("length"), note.get("control_frames")) == (list(length), frames)
    except (OSError, ValueError, KeyError, TakeError):
        return False


def _finished(folder: Path, scenario: Scenario, origin: Origin) -> tuple[Origin, int]:
    """Return what a finished run was made from, and its number of control frames.

    Raises:
        OutputError: The folder holds another run, or something has changed since.
    """
    try:
        manifest = read_manifest(folder, ("control_frames", "origin"))
        given = {**scenario.model_dump(), "duration": resolved_value(folder, "duration")}
        same = Scenario.model_validate(given, context={"folder": scenario.folder}).duration
    except (TakeError, ValueError) as error:
        raise OutputError(f"{folder}: holds no finished run to extend: {error}") from None
    ended = manifest.get("outcome")
    if ended is not None:
        what = f"has come to the end of its scenario, {str(ended.get('kind', '')).replace('_', ' ')}"
        raise OutputError(f"{folder}: {what}; it cannot be extended")
    resolved = dump_scenario(scenario.model_copy(update={"duration": same}))
    if resolved != origin.scenario:
        raise other_run(folder, "another run", scenario_difference(origin.scenario, resolved))
    difference = origin_difference(manifest.get("origin", {}), origin)
    if difference:
        raise other_run(folder, "a run that cannot be extended, since something has changed", difference)
    return origin, int(manifest["control_frames"])


def _end_of(folder: Path, origin: Origin) -> Checkpoint:
    """Return the checkpoint of the end of a finished run.

    Raises:
        OutputError: It has none, or that is damaged or of another run.
    """
    try:
        begun = read_checkpoint(folder)
    except TakeError as error:
        raise OutputError(f"the run cannot be continued: {error}") from None
    if begun.origin != origin.checksum:
        raise OutputError(f"the run cannot be continued: {folder / CHECKPOINT} is of another run")
    return begun

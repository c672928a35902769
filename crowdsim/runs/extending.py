"""A finished run that goes on: what it would have been, had it been planned for longer.

The longer run is written in a folder of its own inside the run's, from the checkpoint of its end, and takes its place
when it is finished. Until then the run stays as it is.

Until a command has reported the end of an extension, the same command completes that one instead of beginning another:
what the run is extended to is noted in its folder beforehand, and forgotten after the report.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from crowdsim.core.types import FileName, Progress
from crowdsim.errors import OutputError, TakeError
from crowdsim.files import open_plain, walk
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import read_checkpoint, write_checkpoint
from crowdsim.runs.folder import RESOLVED, TAKE, other_run, read_resolved, refuse_others, write_text
from crowdsim.runs.journal import EXTENSION, Journal, find_noted, read_journal, write_journal
from crowdsim.runs.lock import EXTENDING, LOCKS, hold_folder
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.origin import Origin, origin_difference, origin_of, scenario_difference
from crowdsim.runs.preparation import load_policies
from crowdsim.runs.resolved import resolved_value
from crowdsim.runs.run import Interrupted, Report
from crowdsim.runs.runner import run_to
from crowdsim.runs.signed_json import checksum, write_signed
from crowdsim.runs.staging import commit, complete, discard, forget
from crowdsim.scenario.scenario import Scenario, dump_scenario


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
    with hold_folder(folder, command):
        if EXTENSION in complete(folder):
            return _completed(folder)
        longer, origin = _plan(folder, scenario, length, threads, mocap, progress)
        if _is_extended(folder, length):
            _tidy(folder)
            return _completed(folder)
        note = {"length": list(length), "control_frames": longer.duration}
        write_signed(folder / EXTENDING, folder / f"{EXTENDING}.part", note)
        staged = folder / EXTENSION
        try:
            _note(folder, {EXTENSION, f"{EXTENSION}.part"})
            _seed(folder, staged, origin, longer)
            report = run_to(staged, longer, threads, mocap, False, command, progress, notify)
            files = set(read_manifest(staged)["files"])
            old = set(read_manifest(folder)["files"])
            _refuse_others(folder, old, files)
            commit(folder, staged, files, old - files)
        except Interrupted as stop:
            raise Interrupted(stop.number, folder, str(stop).partition("interrupted; ")[2]) from None
        except OSError as error:
            raise OutputError(f"{error.filename or folder}: cannot be written: {error.strerror or error}") from None
    report.folder = folder
    report.outputs = {
        kind: (folder / path.relative_to(staged), count, size) for kind, (path, count, size) in report.outputs.items()
    }
    return report


def forget_extension(folder: Path) -> None:
    """Forget what a run was to be extended to, since its end has been reported; the next extension is another one."""
    (folder / EXTENDING).unlink(missing_ok=True)


def _completed(folder: Path) -> Report:
    """Return the report where the same command was killed on its last steps."""
    report = Report(folder, done_before=True)
    report.notes.append(f"{folder}: the extension that was interrupted is complete")
    return report


def _tidy(folder: Path) -> None:
    """Remove what an extension has left that was killed behind its last file.

    Raises:
        OutputError: It cannot be removed.
    """
    staged = folder / EXTENSION
    try:
        if staged.is_dir():
            discard(staged)
    except OSError as error:
        raise OutputError(f"{error.filename or staged}: cannot be removed: {error.strerror or error}") from None
    forget(folder, EXTENSION)


def _is_extended(folder: Path, length: tuple[float, bool]) -> bool:
    """Whether a run has been extended by a length already, and that has not been reported."""
    try:
        with open_plain(folder, EXTENDING) as file:
            note = json.loads(file.read().decode("utf-8"))
        whole = isinstance(note, dict) and note.get("checksum") == checksum(note)
        return whole and (note["length"], note["control_frames"]) == (
            list(length),
            read_manifest(folder)["control_frames"],
        )
    except (OSError, ValueError, KeyError, RecursionError):
        return False


def _plan(
    folder: Path,
    scenario: Scenario,
    length: tuple[float, bool],
    threads: int,
    mocap: FileName | None,
    progress: Progress | None,
) -> tuple[Scenario, Origin]:
    """Return the scenario of the longer run, and what the finished run was made from.

    Raises:
        OutputError: The folder holds another run, or something has changed since.
    """
    try:
        manifest = read_manifest(folder, ("control_frames", "origin"))
        before = read_resolved(folder)
        given = {**scenario.model_dump(), "duration": resolved_value(folder, "duration")}
        same = Scenario.model_validate(given).duration
    except (TakeError, ValueError) as error:
        raise OutputError(f"{folder}: holds no finished run to extend: {error}") from None
    ended = manifest.get("outcome")
    if ended is not None:
        what = f"has come to the end of its scenario, {str(ended.get('kind', '')).replace('_', ' ')}"
        raise OutputError(f"{folder}: {what}; it cannot be extended")
    resolved = dump_scenario(scenario.model_copy(update={"duration": same}))
    if resolved != before:
        raise other_run(folder, "another run", scenario_difference(before, resolved))
    policies = load_policies(scenario, mocap, threads, progress)
    origin = origin_of(before, policies)
    difference = origin_difference(manifest.get("origin", {}), origin)
    if difference:
        raise other_run(folder, "a run that cannot be extended, since something has changed", difference)
    rate = float(policies[0].database.control_rate)
    more = max(1, round(length[0] * (rate if length[1] else 1.0)))
    return scenario.model_copy(update={"duration": int(manifest["control_frames"]) + more}), origin


def _seed(folder: Path, staged: Path, origin: Origin, longer: Scenario) -> None:
    """Make the folder of the longer run as if that had been interrupted where the finished one ended.

    Raises:
        OutputError: The run has no checkpoint.
        OSError: Something cannot be written.
    """
    resolved = dump_scenario(longer)
    if staged.is_dir() and read_resolved(staged) == resolved:
        # It was interrupted, and goes on.
        return
    fresh = folder / f"{EXTENSION}.part"
    for left in (staged, fresh):
        if left.exists():
            discard(left)
    try:
        begun = read_checkpoint(folder)
    except TakeError as error:
        raise OutputError(f"{folder}: cannot be extended: {error}") from None
    if begun.origin != origin.checksum:
        raise OutputError(f"{folder}: cannot be extended: {folder / CHECKPOINT} is of another run")
    now = replace(origin, scenario=resolved)
    fresh.mkdir()
    files = frozenset({CHECKPOINT, TAKE, f"{TAKE}.partial"})
    write_journal(fresh, Journal(frozenset({RESOLVED}), files, origin=now.document()))
    write_text(fresh / RESOLVED, resolved)
    for name in walk(folder / TAKE):
        target = fresh / f"{TAKE}.partial" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        _link_or_copy(folder / TAKE / name, target)
    write_checkpoint(fresh, replace(begun, origin=now.checksum))
    os.replace(fresh, staged)


def _link_or_copy(source: Path, target: Path) -> None:
    """Link a chunk, which is never written again, and copy everything else."""
    if source.name[0].isdecimal():
        try:
            os.link(source, target)
            return
        except OSError:
            # Not every file system has links.
            pass
    shutil.copyfile(source, target)


def _note(folder: Path, names: set[str]) -> None:
    """Note staging folders in a run's journal."""
    journal = read_journal(folder) or Journal()
    write_journal(folder, replace(journal, exports=journal.exports | names))


def _refuse_others(folder: Path, old: set[str], files: set[str]) -> None:
    """Refuse files of others in the places of the longer run's."""
    journal: Any = read_journal(folder) or Journal()
    held = set(walk(folder)) - LOCKS
    own = find_noted(folder, journal.names, held) | (held & old)
    refuse_others(folder, held, own, {*journal.names, *old}, files)

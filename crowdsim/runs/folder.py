"""The folder of a run: found finished or not, and made ready to begin or go on, without touching files of others."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from crowdsim.errors import OutputError, TakeError
from crowdsim.files import open_plain, remove_empty, remove_plain, stat_plain, walk
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.checkpoint import Checkpoint, read_checkpoint
from crowdsim.runs.journal import NAME as JOURNAL
from crowdsim.runs.journal import Journal, Noted, find_noted, read_journal, write_journal
from crowdsim.runs.lock import LOCKS, hold_folder
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.origin import Origin, origin_difference, scenario_difference

RESOLVED = "scenario.resolved.yaml"
TAKE = "take.zarr"
_CHOICES = "--force replaces it, --out names another folder"
_OTHERS = "expected an empty folder or a run's; --out names another"


def check_folder(folder: Path, resolved: str, force: bool, locked: bool = False) -> bool:
    """Say whether the run of a resolved scenario is finished in a folder; nothing is written.

    Args:
        folder: The run folder.
        resolved: The resolved scenario, as text.
        force: Whether what a run has left there may go.
        locked: Whether this process holds the folder.

    Raises:
        OutputError: The path is a file, cannot be written, holds something that is no run, another run (the message
            then shows how they differ), or an unfinished run.
    """
    above = folder
    try:
        while not above.exists():
            above = above.parent
        if not above.is_dir():
            where = "is a file, expected a folder for the run"
            raise OutputError(
                f"{folder}: {where}" if above == folder else f"{folder}: cannot be made: {above} is a file"
            )
        held = sorted(path.name for path in folder.iterdir()) if above == folder else []
        held = [name for name in held if name not in {*LOCKS, f"{JOURNAL}.part"}]
        if not os.access(above, os.W_OK | os.X_OK):
            raise OutputError(f"{folder}: cannot be written, expected a folder with write permission")
        if not held:
            return False
        if MANIFEST in held:
            return _check_finished(folder, resolved, force)
        journal = read_journal(folder)
        if journal is None:
            raise OutputError(f"{folder}: holds {held[0]!r}, which is no run's; {_OTHERS}")
        computed = find_noted(folder, journal.files | journal.exports)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {error.strerror or error}") from None
    if computed and not force:
        if not locked:
            # It may be unfinished because it is still going.
            with hold_folder(folder):
                pass
        before = read_resolved(folder)
        if before and before != resolved:
            raise other_run(folder, "an unfinished run of another scenario", scenario_difference(before, resolved))
    return False


def other_run(folder: Path, what: str, difference: list[str]) -> OutputError:
    """Return the error of a folder that holds another run, with the lines in which that one differs."""
    return OutputError("\n".join([f"{folder}: holds {what}; {_CHOICES}", *difference]))


def _check_finished(folder: Path, resolved: str, force: bool) -> bool:
    try:
        document = read_manifest(folder)
    except TakeError as error:
        raise OutputError(f"{error}; {_OTHERS}") from None
    if force:
        return False
    before = read_resolved(folder)
    if before == resolved and document.get("status") == "done":
        return True
    raise other_run(folder, "another run", scenario_difference(before, resolved))


@dataclass(frozen=True)
class Claim:
    """A folder that is ready for a run.

    Attributes:
        begun: Where an earlier process has left the run; None where it begins anew.
        notes: What a user should know of that.
    """

    begun: Checkpoint | None = None
    notes: tuple[str, ...] = ()


def claim_folder(
    folder: Path,
    inputs: Iterable[str],
    planned: Iterable[str],
    origin: Origin,
    frames: int,
    force: bool,
    lost: bool = False,
) -> Claim:
    """Make a folder that ``check_folder`` passed ready for a run, and note what the run writes.

    What an earlier process has finished of the same run stays. Else what it has left is removed: only files that a
    manifest or a journal of this program lists. Where other files are in the way, nothing is removed at all.

    Args:
        folder: The run folder.
        inputs: Names of the files that the run begins with.
        planned: Names of all others that it writes; of the take its folders.
        origin: What the run is made from.
        frames: Control frames that it has.
        force: Whether it begins anew in any case.
        lost: Whether outputs that are there cannot be trusted, since the machine went down while they were written.

    Raises:
        OutputError: Something is in the way, cannot be removed, or is no regular file; or the unfinished run that is
            there was made from something else.
    """
    begin, rest = frozenset(inputs), frozenset(planned)
    try:
        held = set(walk(folder)) - LOCKS
        journal = read_journal(folder) or Journal()
        old = find_noted(folder, {*journal.names, MANIFEST, JOURNAL}, held) - {JOURNAL}
        claim = Claim()
        if MANIFEST in held:
            old |= held.intersection(read_manifest(folder)["files"])
        elif old and not force:
            claim = _find_begun(folder, journal, origin, old)
        for name in old:
            stat_plain(folder, name)
        refuse_others(folder, held, old, journal.files | journal.exports, begin | rest)
        gone = old - {MANIFEST}
        if claim.begun is not None:
            finished = (folder / TAKE).is_dir() and claim.begun.frame == frames
            gone = _leftovers(gone, Noted([*begin, *rest]), Noted(journal.exports), not lost and finished)
        # Noted before the manifest goes, so that they are recognised should this process end here.
        noted = Journal(journal.inputs | begin, journal.files | rest | old, journal.exports, origin.document())
        write_journal(folder, noted)
        remove_plain(folder, [MANIFEST])
        remove_plain(folder, sorted(gone))
        if claim.begun is None:
            remove_empty(folder, [name for tree in Noted(journal.names).trees for name in _folders(folder, tree)])
        write_journal(folder, Journal(begin, rest, origin=origin.document()))
    except OSError as error:
        raise OutputError(f"{error.filename or folder}: cannot be replaced: {error.strerror or error}") from None
    return claim


def _find_begun(folder: Path, journal: Journal, origin: Origin, old: set[str]) -> Claim:
    """Return where an earlier process has left a run.

    Raises:
        OutputError: That run was made from something else.
    """
    difference = origin_difference(dict(journal.origin), origin)
    if CHECKPOINT in old and difference:
        raise other_run(folder, "an unfinished run that cannot be continued, since something has changed", difference)
    try:
        begun = read_checkpoint(folder)
        if begun.origin != origin.checksum:
            raise TakeError(f"{folder / CHECKPOINT}: is of another run")
    except TakeError as error:
        why = f"; {error}" if CHECKPOINT in old else ""
        return Claim(None, (f"{folder}: an unfinished run was found ({_tops(old)}); starting over{why}",))
    return Claim(begun, (f"{folder}: continuing after {begun.frame} control frames",))


def _leftovers(old: set[str], planned: Noted, exported: Noted, kept: bool) -> set[str]:
    """Return which files of an unfinished run are half-written, or outputs that the run has not written so.

    Args:
        old: Names of all its files.
        planned: What the run writes.
        exported: What exports and renderings wrote.
        kept: Whether outputs are kept, since they are of the finished take.
    """
    left = set()
    for name in old:
        if planned.tree_of(name) is not None:
            is_whole = not name.endswith((".part", ".partial"))
        else:
            is_output = name not in (RESOLVED, CHECKPOINT)
            is_whole = planned.names(name) and not (is_output and (not kept or exported.names(name)))
        left |= set() if is_whole else {name}
    return left


def refuse_others(folder: Path, held: set[str], own: set[str], noted: Iterable[str], planned: Iterable[str]) -> None:
    """Refuse files that were not written by this program where it is about to write, and links above it.

    Args:
        folder: The run folder.
        held: Names of all files in it.
        own: Names of those that this program has written.
        noted: What its journal lists.
        planned: Names of what is about to be written.

    Raises:
        OutputError: There is one.
    """
    plan, known = Noted(planned), set(noted)
    found = None
    for other in sorted(held - own):
        parts = other.split("/")
        way = ["/".join(parts[:depth]) for depth in range(1, len(parts) + 1)]
        found = next((part for part in way if plan.names(part)), None)
        if found is None and (other in plan.folders or other in plan.trees or plan.tree_of(other) is not None):
            found = other
        if found is not None:
            break
    else:
        taken: set[str | None] = {name for name in plan.files if (folder / name).is_dir()}
        taken |= {tree for tree in plan.trees if tree not in known and _holds_something(folder / tree)}
        taken -= {plan.tree_of(name) for name in own}
        found = min(filter(None, taken), default=None)
    if found is not None:
        what = "is in the way of what is to be written, and no run has written it"
        raise OutputError(f"{folder / found}: {what}; move it, or name another folder with --out")


def _holds_something(folder: Path) -> bool:
    return folder.is_dir() and next(walk(folder), None) is not None


def _folders(folder: Path, tree: str) -> list[str]:
    """Return the names of a folder in a folder and of all folders in it; links are not followed."""
    return [Path(above).relative_to(folder).as_posix() for above, _, _ in os.walk(folder / tree)]


def _tops(names: Iterable[str]) -> str:
    return ", ".join(sorted({name.split("/")[0] for name in names}))


def read_resolved(folder: Path) -> str:
    """Return the resolved scenario of a run; nothing where it cannot be read."""
    try:
        with open_plain(folder, RESOLVED) as file:
            return file.read().decode("utf-8")
    except (OSError, ValueError):
        return ""


def write_text(path: Path, text: str) -> None:
    """Write a small file under a temporary name and rename it.

    Raises:
        OutputError: It cannot be written.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


def copy_file(source: Path, path: Path) -> None:
    """Copy a file under a temporary name and rename it; folders above it are made.

    Raises:
        OutputError: It cannot be copied.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, partial)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None

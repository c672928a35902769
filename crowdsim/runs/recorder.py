"""Files that exports and renderings write into a run's folder: noted before, recorded in its manifest after."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from crowdsim.errors import OutputError, TakeError
from crowdsim.files import exists_plain, remove_plain, walk
from crowdsim.runs.folder import refuse_others
from crowdsim.runs.journal import NAME as JOURNAL
from crowdsim.runs.journal import Journal, Noted, find_noted, read_journal, remove_journal, write_journal
from crowdsim.runs.lock import LOCKS, hold_folder
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import ForeignManifestError, read_manifest, update_manifest
from crowdsim.runs.staging import complete


class Recorder:
    """Records files that are written into a folder in the manifest of the run that the folder is in.

    Args:
        run: The run folder; None where the folder is in none, and nothing is recorded.
        folder: The folder that is written into.
    """

    def __init__(self, run: Path | None, folder: Path) -> None:
        self._run, self._folder = run, folder

    def names(self, paths: Iterable[Path]) -> list[str]:
        """Return the names of files, which lie in the folder, in the run's."""
        if self._run is None:
            return []
        above = Path(os.path.realpath(self._folder)).relative_to(self._run)
        return [(above / path.relative_to(self._folder)).as_posix() for path in paths]

    def base(self, folder: Path) -> tuple[Path, Path]:
        """Return the run folder, or where there is none a folder itself, and the way from there to the folder."""
        if self._run is None:
            return folder, Path()
        return self._run, Path(os.path.realpath(folder)).relative_to(self._run)

    def settle(self, kind: str, written: Sequence[Path], result: Mapping[str, Any], threads: int = 1) -> None:
        """Record files that have been written; a run that has no manifest yet keeps them in its journal.

        Args:
            kind: Folder of these files in the folder, or another word for them.
            written: The files.
            result: What a reader should know of them.
            threads: Threads that sum up files.

        Raises:
            TakeError: The manifest is damaged.
            OutputError: It cannot be written.
        """
        if self._run is None or not exists_plain(self._run, MANIFEST):
            return
        (name,) = self.names([self._folder / kind])
        try:
            update_manifest(self._run, name, self.names(written), result, threads)
        except OSError as error:
            raise OutputError(f"{error.filename or self._run}: cannot be recorded: {error.strerror or error}") from None


@contextmanager
def record_files(folder: Path, planned: Iterable[Path], staging: Iterable[str] = ()) -> Iterator[Recorder]:
    """Note files that are about to be written into a folder in the journal of the run that it is in, if it is in one.

    Args:
        folder: The folder that is written into.
        planned: All files that may be written, in it or in folders in it.
        staging: Names of staging folders in the run folder.

    Raises:
        TakeError: The run's manifest is damaged.
        OutputError: The run's folder is in use by a run, or holds other files where these go.
    """
    run = find_run(folder)
    recorder = Recorder(run, folder)
    if run is None:
        yield recorder
        return
    names = {*recorder.names(planned), *staging}
    with hold_folder(run):
        complete(run)
        note_files(run, names)
        try:
            yield recorder
        finally:
            _forget(run, names)


def find_run(folder: Path) -> Path | None:
    """Return the run folder that a folder is, or is in, without links; None where there is none.

    Raises:
        TakeError: There is one whose manifest is damaged.
    """
    here = Path(os.path.realpath(folder))
    for above in (here, *here.parents):
        if exists_plain(above, MANIFEST):
            try:
                read_manifest(above)
                return above
            except ForeignManifestError:
                continue
            except TakeError:
                # Further up, files may belong to others.
                if above == here:
                    raise
        elif exists_plain(above, JOURNAL) and read_journal(above) is not None:
            return above
    return None


def note_files(run: Path, names: Iterable[str], of_run: bool = False) -> None:
    """Note names of files that are about to be written in a run's journal.

    Args:
        run: The run folder, which this process holds.
        names: The names.
        of_run: Whether the run itself writes them, not an export or a rendering of what there is of it.

    Raises:
        TakeError: The run's manifest is damaged.
        OutputError: The folder holds others in their place, or the journal cannot be written.
    """
    planned = frozenset(names)
    journal = read_journal(run) or Journal()
    noted = journal.names
    try:
        held = set(walk(run)) - LOCKS
        own = find_noted(run, noted, held)
    except OSError as error:
        raise OutputError(f"{error.filename or run}: cannot be read: {error.strerror or error}") from None
    if MANIFEST in held:
        own |= held.intersection(read_manifest(run)["files"])
    refuse_others(run, held, own, noted, planned)
    remove_plain(run, _halves(held, Noted({*noted, *planned})))
    key = "files" if of_run else "exports"
    write_journal(run, replace(journal, **{key: getattr(journal, key) | planned}))


def _halves(held: set[str], noted: Noted) -> list[str]:
    """Return the half-written files; no process is writing them, since this one holds the folder."""
    return sorted(name for name in held if noted.covers(name) and not noted.names(name) and not noted.tree_of(name))


def _forget(run: Path, names: set[str]) -> None:
    """Take names of files out of a finished run's journal, unless some are there that the manifest does not list."""
    if not exists_plain(run, MANIFEST):
        return
    journal = read_journal(run)
    if journal is None:
        return
    recorded = read_manifest(run)["files"]
    exports = journal.exports - names
    if find_noted(run, names).difference(recorded):
        exports |= names.difference(recorded)
    if exports or journal.files or journal.inputs:
        write_journal(run, replace(journal, exports=exports))
    else:
        remove_journal(run)

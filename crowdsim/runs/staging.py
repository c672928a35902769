"""Files that take the place of others all together: written apart, committed by one note, and then moved.

A staging folder lies in the folder that its files go to. Until the note ``commit.json`` is in it, nothing has changed.
From then on the files are moved, those that they replace removed, and the manifest comes last; where the process ends
on the way, the next command completes it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from crowdsim.config.documents import parse_json
from crowdsim.errors import OutputError
from crowdsim.files import is_inside, open_plain, remove_plain
from crowdsim.runs.journal import find_noted, read_journal, remove_journal, write_journal
from crowdsim.runs.lock import hold_folder
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.signed_json import checksum, write_signed

NAME = "commit.json"
FORMAT = "crowdsim-commit"


def commit(folder: Path, staged: Path, names: Iterable[str], stale: Iterable[str]) -> None:
    """Put staged files in their places, all or, should this process end before the note is written, none.

    Args:
        folder: The folder that they go to.
        staged: The staging folder in it. Where it holds a manifest, that one comes last.
        names: Names of the files, in both.
        stale: Names of files that are removed.

    Raises:
        OutputError: The note cannot be written, and nothing has changed; or the files cannot be moved, which the next
            command does then.
    """
    document = {"format": FORMAT, "names": sorted(names), "stale": sorted(stale)}
    write_signed(staged / NAME, staged / f".{NAME}.part", document)
    complete(folder)


def complete(folder: Path) -> list[str]:
    """Complete what was committed in a folder and not moved yet; return the names of its staging folders.

    Raises:
        OutputError: Files cannot be moved, or there is a link in their way.
    """
    found = []
    try:
        for staged in [path for path in folder.glob(".*") if path.is_dir() and not path.is_symlink()]:
            document = _read_commit(folder, staged.name)
            if document is not None:
                _move(folder, staged, document)
                forget(folder, staged.name)
                found.append(staged.name)
    except OSError as error:
        raise OutputError(f"{error.filename or folder}: cannot be replaced: {error.strerror or error}") from None
    return found


def complete_alone(folder: Path) -> None:
    """Complete what was committed in a folder, for a command that does not hold it.

    Raises:
        OutputError: Files cannot be moved, or another process holds the folder.
    """
    if any(_read_commit(folder, path.name) for path in folder.glob(".*") if path.is_dir()):
        with hold_folder(folder):
            complete(folder)


def discard(staged: Path) -> None:
    """Remove a staging folder; the note goes last.

    Raises:
        OSError: It cannot be removed.
    """
    for path in list(staged.iterdir()):
        if path.name != NAME:
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    shutil.rmtree(staged)


def _move(folder: Path, staged: Path, document: dict[str, Any]) -> None:
    for name in document["names"]:
        source, target = staged / name, folder / name
        if source.exists():
            _make_parents(folder, name)
            os.replace(source, target)
    remove_plain(folder, document["stale"])
    if (staged / MANIFEST).exists():
        os.replace(staged / MANIFEST, folder / MANIFEST)
    discard(staged)


def forget(folder: Path, staged: str) -> None:
    """Take a staging folder out of the journal of a run, and exports that the manifest lists all.

    Raises:
        OutputError: The journal cannot be written.
    """
    journal = read_journal(folder)
    if journal is None:
        return
    exports = journal.exports - {staged, f"{staged}.part"}
    if (folder / MANIFEST).exists() and find_noted(folder, exports) <= set(read_manifest(folder)["files"]):
        exports = frozenset()
    journal = replace(journal, exports=exports)
    if journal.names:
        write_journal(folder, journal)
    else:
        remove_journal(folder)


def _make_parents(folder: Path, name: str) -> None:
    """Make the folders above a file inside a folder; none may be a link."""
    above = folder
    for part in name.split("/")[:-1]:
        above = above / part
        if above.is_symlink():
            raise OutputError(f"{above}: is a symbolic link, expected a folder; links are not followed")
        above.mkdir(exist_ok=True)


def _read_commit(folder: Path, staged: str) -> dict[str, Any] | None:
    """Return the note of a staging folder; None where there is none, or it is damaged."""
    try:
        with open_plain(folder, f"{staged}/{NAME}") as file:
            document = parse_json(file.read().decode("utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        return None
    lists = [document.get("names"), document.get("stale")]
    is_sound = all(isinstance(names, list) and all(map(is_inside, names)) for names in lists)
    return document if is_sound and document.get("checksum") == checksum(document) else None

"""The folder of a run: made ready, found finished or unfinished, and cleared, without touching what is no run's."""

from __future__ import annotations

import difflib
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from crowdsim.errors import OutputError, TakeError
from crowdsim.files import make_folder, open_plain, remove_empty, remove_plain, stat_plain, walk
from crowdsim.runs.journal import NAME as JOURNAL
from crowdsim.runs.journal import Journal, Noted, find_noted, read_journal, write_journal
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest

RESOLVED = "scenario.resolved.yaml"
TAKE = "take.zarr"
_DIFFERENCE_LINES = 40
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
        if not os.access(above, os.W_OK | os.X_OK):
            raise OutputError(f"{folder}: cannot be written, expected a folder with write permission")
        if not held:
            return False
        if MANIFEST in held:
            return _check_finished(folder, resolved, force)
        journal = read_journal(folder)
        if journal is None:
            raise OutputError(f"{folder}: holds {held[0]!r}, which is no run's; {_OTHERS}")
        computed = find_noted(folder, journal.files)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {error.strerror or error}") from None
    if computed and not force:
        if not locked:
            # It may be unfinished because it is still going.
            with hold_folder(folder):
                pass
        choice = "--force starts over, --out names another folder"
        raise OutputError(f"{folder}: holds an unfinished run, which is kept ({_tops(computed)}); {choice}")
    return False


def _check_finished(folder: Path, resolved: str, force: bool) -> bool:
    try:
        document = read_manifest(folder)
    except TakeError as error:
        raise OutputError(f"{error}; {_OTHERS}") from None
    if force:
        return False
    before = _read(folder)
    if before == resolved and document.get("status") == "done":
        return True
    lines = difflib.unified_diff(before.splitlines(), resolved.splitlines(), "run there", "asked for", "", "", 0, "")
    change = "\n".join(list(lines)[:_DIFFERENCE_LINES])
    raise OutputError(f"{folder}: holds another run; --force replaces it, --out names another folder\n{change}")


@contextmanager
def hold_folder(folder: Path, shared: bool = False) -> Iterator[None]:
    """Make a folder and keep other runs out of it; nothing of that stays, however this process ends.

    Args:
        folder: The run folder.
        shared: Whether others that share it may hold it too: exports and renderings of one run.

    Raises:
        OutputError: It cannot be made, or another process holds it.
    """
    make_folder(folder)
    try:
        import fcntl
    except ImportError:
        yield
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"{folder}: is in use by another run; wait for it, or name another with --out") from None
        except OSError:
            # Some network file systems lock no folders.
            pass
        yield
    finally:
        os.close(number)


def claim_folder(folder: Path, inputs: Iterable[str], planned: Iterable[str]) -> list[str]:
    """Remove what an earlier run has left in a folder that ``check_folder`` passed, and note what the next one writes.

    Only files go that a manifest or a journal of this program lists. Where other files are in the way of the next run,
    nothing goes at all.

    Args:
        folder: The run folder.
        inputs: Names of the files that the run begins with.
        planned: Names of all others that it writes; of the take its folders.

    Returns:
        What a user should know: what was found unfinished.

    Raises:
        OutputError: Something is in the way, cannot be removed, or is no regular file.
    """
    begin, rest = frozenset(inputs), frozenset(planned)
    try:
        held = set(walk(folder))
        journal = read_journal(folder) or Journal()
        old = find_noted(folder, {*journal.inputs, *journal.files, MANIFEST, JOURNAL}, held) - {JOURNAL}
        if MANIFEST in held:
            old |= held.intersection(read_manifest(folder)["files"])
        for name in old:
            stat_plain(folder, name)
        refuse_others(folder, held, old, journal.files, begin | rest)
        # Noted before the manifest goes, so that they are recognised should this process end here.
        write_journal(folder, Journal(journal.inputs | begin, journal.files | rest | old))
        remove_plain(folder, [MANIFEST])
        remove_plain(folder, sorted(old - {MANIFEST}))
        remove_empty(folder, [name for tree in Noted(journal.files).trees for name in _folders(folder, tree)])
        write_journal(folder, Journal(begin, rest))
    except OSError as error:
        raise OutputError(f"{error.filename or folder}: cannot be replaced: {error.strerror or error}") from None
    if MANIFEST in held or not old:
        return []
    return [f"{folder}: an unfinished run was found ({_tops(old)}); starting clean"]


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
        taken |= {tree for tree in plan.trees if tree not in known and (folder / tree).is_dir()}
        taken -= {plan.tree_of(name) for name in own}
        found = min(filter(None, taken), default=None)
    if found is not None:
        what = "is in the way of what is to be written, and no run has written it"
        raise OutputError(f"{folder / found}: {what}; move it, or name another folder with --out")


def _folders(folder: Path, tree: str) -> list[str]:
    """Return the names of a folder in a folder and of all folders in it; links are not followed."""
    return [Path(above).relative_to(folder).as_posix() for above, _, _ in os.walk(folder / tree)]


def _tops(names: Iterable[str]) -> str:
    return ", ".join(sorted({name.split("/")[0] for name in names}))


def _read(folder: Path) -> str:
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


def describe_run(folder: Path) -> dict[str, Any]:
    """Return what became of a run: its ``state``, and of a finished one ``avatars``, ``control_frames``, ``seconds``.

    The state is ``done``, ``interrupted``, ``unfinished`` (killed, failed or still going), ``damaged``, or ``none``
    where the folder is no run's.
    """
    from crowdsim.take.store import open_take

    try:
        held = [path.name for path in folder.iterdir()]
        if MANIFEST in held:
            report = read_manifest(folder)
            numbers = {name: report[name] for name in ("avatars", "control_frames")}
            return {"state": "done", **numbers, "seconds": report["seconds"]["total"]}
        if TAKE in held:
            take = open_take(folder)
            state = "interrupted" if take.status == "interrupted" else "unfinished"
            return {"state": state, "avatars": take.avatar_count, "control_frames": take.frame_count}
    except (TakeError, OSError) as error:
        return {"state": "damaged", "why": str(error)}
    return {"state": "unfinished" if JOURNAL in held and read_journal(folder) is not None else "none"}
